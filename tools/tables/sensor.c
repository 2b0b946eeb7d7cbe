// SPDX-License-Identifier: Apache-2.0
// The table of sensors with overlapping lens images that have no held-out views, as the paper's
// real one: how well the model predicts the measurement it was trained on, with TV and without.
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/str.h"
#include "tools/tables/jobs.h"

#define TRAIN "train.out.json"

typedef struct {
  int i_scene;
  bool is_tv_off;
  double psnr;
  tables_result train;
} row;

typedef struct {
  tables *t;
  row *rows;
  int n;
} job;

static const tables_file *file_of(const tables *t, const row *r) {
  const tables_capture *c = &t->scenes[r->i_scene].of[TABLES_MULTIPLEXED];
  return &c->files[c->i_main];
}

typedef struct {
  char n_gaussians[24], n_steps[24], seed[24], threads[24];
} numbers;

static sv_status job_of(tables_job *j, const tables *t, const row *r, numbers *n, sv_err *err) {
  char key[TABLES_CAP_KEY];
  const tables_scene *sc = &t->scenes[r->i_scene];
  snprintf(key, sizeof key, "sensor_%s%s_g%ld_s%ld_seed%ld_%08x", sc->name, r->is_tv_off ? "_notv" : "",
           t->n_gaussians, t->n_steps, t->seed, (unsigned)file_of(t, r)->digest);
  sv_status st = tables_job_begin(j, t, key, err);
  if (st != SV_OK) return st;
  j->is_model_kept = true;
  snprintf(j->what, sizeof j->what, "%s, multiplexed%s", sc->name, r->is_tv_off ? ", without TV" : "");
  snprintf(n->n_gaussians, sizeof n->n_gaussians, "%ld", t->n_gaussians);
  snprintf(n->n_steps, sizeof n->n_steps, "%ld", t->n_steps);
  snprintf(n->seed, sizeof n->seed, "%ld", t->seed);
  snprintf(n->threads, sizeof n->threads, "%ld", t->n_threads);
  tables_step *s = tables_job_step(j, TRAIN, "train");
  s->must_have_steps = t->n_steps;
  tables_job_add(s, "--data", sc->folder);
  tables_job_add(s, "--transforms", file_of(t, r)->transforms);
  tables_job_add(s, "--gaussians", n->n_gaussians);
  tables_job_add(s, "--steps", n->n_steps);
  tables_job_add(s, "--seed", n->seed);
  if (r->is_tv_off) tables_job_add(s, "--loss", "tv=0,tv_novel=0");
  tables_job_add(s, "--threads", n->threads);
  tables_job_add(s, "--json", NULL);
  tables_job_add(s, "--out", "$d");
  return SV_OK;
}

static sv_status look(void *of, FILE *f, int *n_done, sv_err *err) {
  const job *j = of;
  *n_done = 0;
  for (int i = 0; i < j->n; i++) {
    row *r = &j->rows[i];
    numbers n;
    tables_job one;
    char *text;
    sv_err why;
    sv_status s = job_of(&one, j->t, r, &n, err);
    if (s != SV_OK) return s;
    r->train = tables_no_result();
    r->psnr = NAN;
    s = tables_job_read(&one, TRAIN, &text, &why);
    if (s == SV_OK) s = tables_result_train(&r->train, text, &why);
    if (s == SV_OK) s = tables_result_measured(&r->psnr, text, &why);
    free(text);
    if (s != SV_OK && s != SV_E_NOT_FOUND) tables_job_drop(&one, j->t, TRAIN, &why);
    if (s == SV_OK) ++*n_done;
    else if (f) tables_job_line(&one, j->t, f);
  }
  return SV_OK;
}

static sv_status write_file(const job *j, const char *name, bool is_csv, sv_err *err) {
  char path[SV_CAP_PATH];
  const tables *t = j->t;
  sv_status s = sv_path_join(path, sizeof path, t->o->out, name, err);
  if (s != SV_OK) return s;
  FILE *f = sv_stream_open(path, err);
  if (!f) return SV_E_IO;
  if (is_csv) fprintf(f, "scene,tv,measurement_psnr,seconds,megabytes\n");
  else
    fprintf(
        f,
        "# Multiplexed sensor without held-out views\n\nWritten by `subview-lab tables`: %ld Gaussians, %ld "
        "steps. PSNR is that of the predicted measurement, in display values, against the one that was "
        "trained on: it tells the fit, not the quality of views. The paper shows views of its real sensor "
        "without numbers.\n\n**What differs from the paper.** No learned gain, no 2D Gaussian Splatting, no "
        "support hull.\n\n| scene | TV | PSNR of the measurement | s | MB |\n|---|---|--:|--:|--:|\n",
        t->n_gaussians, t->n_steps);
  for (int i = 0; i < j->n; i++) {
    const row *r = &j->rows[i];
    char psnr[40];
    tables_format(psnr, sizeof psnr, TABLES_PSNR, r->psnr);
    fprintf(f, is_csv ? "%s,%s,%s,%.1f,%.1f\n" : "| %s | %s | %s | %.1f | %.1f |\n",
            t->scenes[r->i_scene].name, r->is_tv_off ? "off" : "on", psnr, r->train.seconds,
            r->train.arena_bytes * 1e-6);
  }
  return sv_stream_save(f, err);
}

sv_status tables_sensor(tables *t, sv_err *err) {
  job j = {.t = t};
  j.rows = calloc((size_t)t->n_scenes * 2, sizeof *j.rows);
  if (!j.rows) return sv_fail(err, SV_E_NOMEM, "no memory for the runs");
  for (int i = 0; i < t->n_scenes; i++)
    for (int k = 0; k < 2; k++) j.rows[j.n++] = (row){.i_scene = i, .is_tv_off = k == 1};
  t->n_runs = j.n;
  sv_status s = tables_make_jobs(t, look, &j, j.n, err);
  if (s == SV_OK && !t->o->plan) s = write_file(&j, "sensor.csv", true, err);
  if (s == SV_OK && !t->o->plan) s = write_file(&j, "tables.md", false, err);
  free(j.rows);
  return s;
}
