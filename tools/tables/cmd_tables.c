// SPDX-License-Identifier: Apache-2.0
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "src/base/str.h"
#include "tools/tables/tables.h"

// A full run over four scenes of 400x400 takes about an hour on two cores, a quick one about three
// minutes.
#define STEPS           2000 // the paper: about 3,000
#define GAUSSIANS       20000
#define QUICK_STEPS     400
#define QUICK_GAUSSIANS 8000

// Which program this is: results of another one are told apart.
static sv_status know_program(tables *t, sv_err *err) {
  uint64_t h = TABLES_HASH;
  ssize_t n = readlink("/proc/self/exe", t->program, sizeof t->program - 1);
  if (n <= 0) return sv_fail(err, SV_E_DEVICE, "cannot find this program through /proc/self/exe");
  t->program[n] = 0;
  sv_status s = tables_hash_file(&h, t->program, err);
  snprintf(t->build, sizeof t->build, "%016llx", (unsigned long long)h);
  return s;
}

// Noise on the prediction is for multiplexed measurements, and its figures mean another thing than
// noise on pictures.
static sv_status leave_multiplexed(tables *t, sv_err *err) {
  int n_multiplexed = 0, n_others = 0;
  for (int i = 0; i < t->n_scenes; i++)
    for (int d = 0; d < TABLES_N_DEVICES; d++) {
      int *n = &t->scenes[i].of[d].n;
      *(d == TABLES_MULTIPLEXED ? &n_multiplexed : &n_others) += *n;
      if (d != TABLES_MULTIPLEXED) *n = 0;
    }
  if (!n_multiplexed)
    return sv_fail(
        err, SV_E_ARG,
        "%s: no transforms_train_multiplexed.json; --noise prediction needs them; use read=V,shot=V",
        t->o->data);
  if (n_others)
    lab_say(&t->session, "--noise prediction needs multiplexed measurements: skipping other devices");
  return SV_OK;
}

// Lines of jobs have its whole path.
static sv_status open_out(tables *t, sv_err *err) {
  sv_status s = lab_session_folder(&t->session, t->o->out, err);
  if (s != SV_OK) return s;
  char *real = realpath(t->o->out, NULL);
  if (!real || !sv_copy(t->out, sizeof t->out, real))
    s = sv_fail(err, SV_E_RANGE, "%.200s: its whole path is too long", t->o->out);
  free(real);
  return s;
}

static sv_status work(tables *t, sv_err *err) {
  bool has_plots = false;
  sv_status s = sv_linux_catch_signals(err);
  if (s == SV_OK) s = know_program(t, err);
  if (s == SV_OK) s = tables_scan(t, t->o->data, err);
  if (s == SV_OK && t->o->is_noise_on_prediction) s = leave_multiplexed(t, err);
  int n_dynamic = 0;
  for (int i = 0; s == SV_OK && i < t->n_scenes; i++) n_dynamic += t->scenes[i].is_dynamic;
  if (n_dynamic > 0 && n_dynamic < t->n_scenes)
    return sv_fail(err, SV_E_UNSUPPORTED, "%s: moving and still scenes have different tables; name one kind",
                   t->o->data);
  if (n_dynamic > 0) {
    s = open_out(t, err);
    return s == SV_OK ? tables_dynamic(t, err) : s;
  }
  if (s == SV_OK) s = tables_plan(t, err);
  if (s == SV_OK && t->n_runs == 0)
    s = sv_fail(err, SV_E_NOT_FOUND, "%s: no device has an exposure to train on", t->o->data);
  if (s == SV_OK) s = open_out(t, err);
  if (s == SV_OK) s = tables_run_all(t, err);
  if (t->o->plan) return s;
  if (s == SV_OK) s = tables_write_csv(t, err);
  if (s == SV_OK) s = tables_write_sheets(t, err);
  if (s == SV_OK) s = tables_write_plots(t, &has_plots, err);
  return s == SV_OK ? tables_write_markdown(t, has_plots, err) : s;
}

int lab_cmd_tables(const lab_options *o) {
  sv_err err = {0};
  int code = LAB_EXIT_OK;
  tables *t = calloc(1, sizeof *t);
  if (!t) return LAB_EXIT_FAILED;
  t->o = o;
  t->n_gaussians = o->gaussians > 0 ? o->gaussians : o->is_quick ? QUICK_GAUSSIANS : GAUSSIANS;
  t->n_steps = o->steps > 0 ? o->steps : o->is_quick ? QUICK_STEPS : STEPS;
  t->seed = o->seed >= 0 ? o->seed : 1;
  const long n_cpus = sysconf(_SC_NPROCESSORS_ONLN);
  t->n_threads = o->threads > 0 ? o->threads : 1;
  t->n_jobs = o->n_jobs > 0 ? o->n_jobs : n_cpus > t->n_threads ? n_cpus / t->n_threads : 1;
  // the runs have threads, not we
  sv_status s = lab_session_start(&t->session, 1, o->is_quiet, &err);
  if (s == SV_OK) s = work(t, &err);
  sv_linux_console_finish(&t->session.lines);
  if (s != SV_OK) code = lab_failed(&t->session, &err);
  else if (o->plan)
    lab_say(&t->session, "%s: %d jobs, one a line; then subview-lab tables --collect", o->plan, t->n_missing);
  else
    lab_say(&t->session, "%s/tables.md: %d runs; also CSV files%s", o->out, t->n_runs,
            t->n_scenes > 0 && t->scenes[0].is_dynamic ? " and plots" : ", plots and contact sheets");
  lab_session_stop(&t->session);
  tables_free(t);
  free(t);
  return code;
}
