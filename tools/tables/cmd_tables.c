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

// The paper adds Gaussian-Poisson noise to simulated measurements and does not print its variances.
// Its release has a standard deviation of 0.01 + 0.01 x; these variances are the same at black and
// at white.
#define PAPER_NOISE "read=0.0001,shot=0.0003"
#define PAPER_READ  1e-4f
#define PAPER_SHOT  3e-4f

static sv_status synthetic_with(tables *t, sv_err *err) {
  bool has_plots = false;
  sv_status s = tables_plan(t, err);
  if (s == SV_OK && t->n_runs == 0)
    s = sv_fail(err, SV_E_NOT_FOUND, "%s: no device has an exposure to train on", t->o->data);
  if (s == SV_OK) s = tables_run_all(t, err);
  if (t->o->plan) return s;
  if (s == SV_OK) s = tables_write_csv(t, err);
  if (s == SV_OK) s = tables_write_sheets(t, err);
  if (s == SV_OK) s = tables_write_plots(t, &has_plots, err);
  return s == SV_OK ? tables_write_markdown(t, has_plots, err) : s;
}

static sv_status synthetic(tables *t, sv_err *err) {
  const lab_options *given = t->o;
  lab_options o = *given;
  if (!o.noise) {
    o.noise = PAPER_NOISE;
    o.noise_read = PAPER_READ;
    o.noise_shot = PAPER_SHOT;
  }
  t->o = &o;
  sv_status s = synthetic_with(t, err);
  t->o = given;
  return s;
}

static sv_status work_kind(tables *t, tables_kind kind, sv_err *err) {
  switch (kind) {
  case TABLES_DYNAMIC: return tables_dynamic(t, err);
  case TABLES_STATIC:
  case TABLES_CASUAL: return tables_real(t, err);
  case TABLES_SENSOR: return tables_sensor(t, err);
  default: return synthetic(t, err);
  }
}

// One kind of several: its tables go to a folder of OUT, its jobs to a file of that folder.
static sv_status work_part(tables *t, tables_kind kind, tables_scene *scenes, sv_err *err) {
  const tables whole = *t;
  lab_options o = *t->o;
  char out[SV_CAP_PATH], plan[SV_CAP_PATH];
  int n = 0;
  for (int i = 0; i < whole.n_scenes; i++)
    if (whole.scenes[i].kind == kind) scenes[n++] = whole.scenes[i];
  if (n == 0) return SV_OK;
  sv_status s = sv_path_join(out, sizeof out, whole.out, tables_kind_names[kind], err);
  if (s == SV_OK) s = sv_path_make_folder(out, err);
  if (s == SV_OK) s = sv_path_join(plan, sizeof plan, out, "plan.txt", err);
  if (s != SV_OK) return s;
  o.out = out;
  if (o.plan) o.plan = plan;
  t->o = &o;
  t->scenes = scenes;
  t->n_scenes = n;
  sv_copy(t->out, sizeof t->out, out);
  lab_say(&t->session, "%s: %d datasets", tables_kind_names[kind], n);
  s = work_kind(t, kind, err);
  for (int i = 0; i < N_TABLES; i++) free(t->tables[i].rows);
  memset(t->tables, 0, sizeof t->tables);
  free(t->runs);
  t->runs = NULL;
  t->n_all_runs += t->n_runs;
  t->n_all_missing += t->n_missing;
  t->n_runs = t->cap_runs = t->n_missing = 0;
  t->o = whole.o;
  t->scenes = whole.scenes;
  t->n_scenes = whole.n_scenes;
  sv_copy(t->out, sizeof t->out, whole.out);
  return s;
}

// The jobs of all kinds in one file.
static sv_status join_plans(const tables *t, sv_err *err) {
  FILE *f = sv_stream_open(t->o->plan, err);
  if (!f) return SV_E_IO;
  sv_status s = SV_OK;
  for (int k = 0; k < TABLES_N_KINDS && s == SV_OK; k++) {
    char path[SV_CAP_PATH], name[40];
    void *data;
    size_t bytes;
    snprintf(name, sizeof name, "%s/plan.txt", tables_kind_names[k]);
    s = sv_path_join(path, sizeof path, t->out, name, err);
    if (s != SV_OK || !sv_path_exists(path)) continue;
    s = sv_file_read(path, &data, &bytes, err);
    if (s != SV_OK) break;
    fwrite(data, 1, bytes, f);
    free(data);
    remove(path);
  }
  const sv_status saved = sv_stream_save(f, err);
  return s == SV_OK ? saved : s;
}

static sv_status work_all(tables *t, sv_err *err) {
  tables_scene *scenes = calloc((size_t)t->n_scenes, sizeof *scenes);
  sv_status s = scenes ? SV_OK : sv_fail(err, SV_E_NOMEM, "no memory for the datasets");
  for (int k = 0; k < TABLES_N_KINDS && s == SV_OK; k++) s = work_part(t, (tables_kind)k, scenes, err);
  free(scenes);
  t->n_runs = t->n_all_runs;
  t->n_missing = t->n_all_missing;
  return s == SV_OK && t->o->plan ? join_plans(t, err) : s;
}

static sv_status work(tables *t, sv_err *err) {
  sv_status s = sv_linux_catch_signals(err);
  if (s == SV_OK) s = know_program(t, err);
  char made[SV_CAP_PATH];
  const bool is_made = t->o->is_sub_views;
  if (s == SV_OK && is_made) s = open_out(t, err);
  if (s == SV_OK && is_made) s = tables_sub_views(t, made, err);
  if (s == SV_OK) s = tables_scan(t, is_made ? made : t->o->data, err);
  if (s == SV_OK && t->o->is_noise_on_prediction) s = leave_multiplexed(t, err);
  if (s == SV_OK && !is_made) s = open_out(t, err);
  if (s != SV_OK) return s;
  for (int i = 0; i < t->n_scenes; i++)
    if (t->scenes[i].kind != t->scenes[0].kind) return work_all(t, err);
  return work_kind(t, t->scenes[0].kind, err);
}

int lab_cmd_tables(const lab_options *o) {
  sv_err err = {0};
  int code = LAB_EXIT_OK;
  tables *t = calloc(1, sizeof *t);
  if (!t) return LAB_EXIT_FAILED;
  lab_options own = *o;
  if (own.noise && sv_str_eq(own.noise, "none")) own.noise = "";
  t->o = &own;
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
  else lab_say(&t->session, "%s: tables.md, CSV files and plots of %d runs", o->out, t->n_runs);
  lab_session_stop(&t->session);
  tables_free(t);
  free(t);
  return code;
}
