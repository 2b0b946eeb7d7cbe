// SPDX-License-Identifier: Apache-2.0
// The runs of the tables of still scenes as jobs: each trains, is scored and, for the contact
// sheet, renders its near views, in OUT/runs/KEY, whose name has a hash of settings and data.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tools/tables/jobs.h"

#define TRAIN "train.out.json"
#define VIEWS "views.out"

static const char *const score_files[TABLES_N_SPLITS] = {"near.out.json", "test.out.json"};

// The numbers of a line, as text.
typedef struct {
  char n_exposures[24], n_gaussians[24], n_steps[24], seed[24], threads[24];
} numbers;

static const char *text_of(char out[24], long v) {
  snprintf(out, 24, "%ld", v);
  return out;
}

static void add_threads(tables_step *s, const tables *t, numbers *n) {
  tables_job_add(s, "--threads", text_of(n->threads, t->n_threads));
}

static void add_train(tables_job *j, const tables *t, const tables_run *r, numbers *n) {
  const tables_setting *set = &r->set;
  tables_step *s = tables_job_step(j, TRAIN, "train");
  s->must_have_steps = t->n_steps;
  tables_job_add(s, "--data", t->scenes[set->i_scene].folder);
  tables_job_add(s, "--transforms", tables_file_of(t, set)->transforms);
  tables_job_add(s, "--exposures", text_of(n->n_exposures, set->n_exposures));
  tables_job_add(s, "--gaussians", text_of(n->n_gaussians, set->n_gaussians));
  tables_job_add(s, "--steps", text_of(n->n_steps, t->n_steps));
  tables_job_add(s, "--seed", text_of(n->seed, t->seed));
  tables_job_add(s, "--init", set->is_cube ? "cube" : "sphere");
  if (set->is_tv_off) tables_job_add(s, "--loss", "tv=0,tv_novel=0");
  if (t->o->noise && *t->o->noise) tables_job_add(s, "--noise", t->o->noise);
  add_threads(s, t, n);
  tables_job_add(s, "--json", NULL);
  tables_job_add(s, "--out", "$d");
}

static void add_score(tables_job *j, const tables *t, const tables_run *r, int split, numbers *n) {
  tables_step *s = tables_job_step(j, score_files[split], "eval");
  tables_job_add(s, "--data", t->scenes[r->set.i_scene].folder);
  tables_job_add(s, "--model", "$d/model.ply");
  tables_job_add(s, "--split", tables_split_names[split]);
  if (t->scenes[r->set.i_scene].has_depth) tables_job_add(s, "--depth", NULL);
  tables_job_add(s, "--lpips", NULL);
  add_threads(s, t, n);
  tables_job_add(s, "--json", NULL);
}

static void add_render(tables_job *j, const tables *t, const tables_run *r, numbers *n) {
  tables_step *s = tables_job_step(j, VIEWS, "render");
  tables_job_add(s, "--data", t->scenes[r->set.i_scene].folder);
  tables_job_add(s, "--model", "$d/model.ply");
  tables_job_add(s, "--split", tables_split_names[TABLES_NEAR]);
  tables_job_add(s, "--depth", NULL);
  add_threads(s, t, n);
  tables_job_add(s, "--out", "$d/views");
}

static sv_status job_of(tables_job *j, const tables *t, const tables_run *r, numbers *n, sv_err *err) {
  sv_status s = tables_job_begin(j, t, r->key, err);
  if (s != SV_OK) return s;
  tables_describe(t, r, j->what, sizeof j->what);
  j->is_model_kept = r->has_views;
  add_train(j, t, r, n);
  for (int k = 0; k < TABLES_N_SPLITS; k++)
    if (r->needs[k]) add_score(j, t, r, k, n);
  if (r->has_views) add_render(j, t, r, n);
  return SV_OK;
}

// --- finished runs -------------------------------------------------------------------------------

static sv_status take(const tables_job *j, const char *file, tables_run *r, int split, sv_err *err) {
  char *text;
  sv_status s = tables_job_read(j, file, &text, err);
  if (s == SV_OK)
    s = split < 0 ? tables_result_train(&r->result, text, err)
                  : tables_result_eval(&r->result.score[split], &r->result.wall_s, text, err);
  free(text);
  return s;
}

// Whether all of a run is there; what is damaged is told and, unless --collect, removed.
static bool read_run(tables *t, tables_run *r, const tables_job *j) {
  bool is_whole = true;
  sv_err err;
  char *text, path[SV_CAP_PATH];
  r->result = tables_no_result();
  for (int i = 0; i < j->n; i++) {
    const char *file = j->step[i].file;
    int split = i - 1;
    for (int k = 0; k < TABLES_N_SPLITS; k++)
      if (strcmp(file, score_files[k]) == 0) split = k;
    sv_status s = SV_OK;
    if (strcmp(file, VIEWS) != 0) s = take(j, file, r, split, &err);
    else if ((s = tables_job_read(j, file, &text, &err)) == SV_OK) {
      free(text);
      s = sv_path_join(path, sizeof path, j->folder, "views/views.json", &err);
      if (s == SV_OK && !sv_path_exists(path)) s = sv_fail(&err, SV_E_FORMAT, "its images are missing");
    }
    if (s != SV_OK && s != SV_E_NOT_FOUND) tables_job_drop(j, t, file, &err);
    is_whole &= s == SV_OK;
  }
  if (tables_job_read(j, "build", &text, &err) == SV_OK)
    sv_copy(r->result.build, sizeof r->result.build, text);
  free(text);
  if (!is_whole) r->result = tables_no_result(); // half a run would be half a row
  return is_whole;
}

static int read_all(tables *t, sv_err *err) {
  numbers n;
  tables_job j;
  int n_done = 0;
  for (int i = 0; i < t->n_runs; i++) {
    tables_run *r = &t->runs[i];
    if (job_of(&j, t, r, &n, err) != SV_OK) return -1;
    r->is_done = read_run(t, r, &j);
    r->is_other_build = r->is_done && !sv_str_eq(r->result.build, t->build);
    n_done += r->is_done;
  }
  return n_done;
}

// --- the command ---------------------------------------------------------------------------------

static sv_status write_lines(const tables *t, const char *path, sv_err *err) {
  numbers n;
  tables_job j;
  sv_status s = SV_OK;
  FILE *f = sv_stream_open(path, err);
  if (!f) return SV_E_IO;
  for (int i = 0; i < t->n_runs && s == SV_OK; i++) {
    if (t->runs[i].is_done) continue;
    s = job_of(&j, t, &t->runs[i], &n, err);
    if (s == SV_OK) tables_job_line(&j, t, f);
  }
  const sv_status saved = sv_stream_save(f, err);
  return s == SV_OK ? saved : s;
}

static const tables_run *first_missing(const tables *t) {
  for (int i = 0; i < t->n_runs; i++)
    if (!t->runs[i].is_done) return &t->runs[i];
  return NULL;
}

// The sentence of the job that failed.
static sv_status fail_job(const tables *t, sv_err *err) {
  const sv_err why = *err;
  for (int i = 0; i < t->n_runs; i++) {
    char what[200], said[200] = "", path[SV_CAP_PATH];
    numbers n;
    tables_job j;
    if (t->runs[i].is_done || job_of(&j, t, &t->runs[i], &n, err) != SV_OK) continue;
    if (sv_path_join(path, sizeof path, j.folder, "log.txt", err) != SV_OK || !sv_path_exists(path)) continue;
    lab_last_line(path, said, sizeof said);
    tables_describe(t, &t->runs[i], what, sizeof what);
    return sv_fail(err, SV_E_DEVICE, "run %d (%s): %s", i + 1, what, *said ? said : why.text);
  }
  *err = why;
  return SV_E_DEVICE;
}

static double cost_left_s(const tables *t) {
  double s = 0;
  for (int i = 0; i < t->n_runs; i++)
    if (!t->runs[i].is_done) s += t->runs[i].cost;
  return s;
}

static void say_state(tables *t, int n_done) {
  int n_other = 0;
  for (int i = 0; i < t->n_runs; i++) n_other += t->runs[i].is_other_build;
  lab_say(&t->session, "%d runs, %d already done; the others take about %.0f s on two cores", t->n_runs,
          n_done, cost_left_s(t));
  if (n_other)
    lab_say(&t->session,
            "%d results come from another build of this program; remove %s/runs to measure them again",
            n_other, t->o->out);
}

static sv_status run_missing(tables *t, sv_err *err) {
  char path[SV_CAP_PATH];
  sv_status s = sv_path_join(path, sizeof path, t->out, "jobs.txt", err);
  if (s == SV_OK) s = write_lines(t, path, err);
  if (s != SV_OK) return s;
  s = tables_jobs_run(t, path, err);
  sv_err other;
  const int n_done = read_all(t, &other);
  if (s == SV_E_INTERRUPTED)
    return sv_fail(err, s,
                   "stopped by request with %d of %d runs done; run the same command again to continue",
                   n_done, t->n_runs);
  return s == SV_OK && n_done == t->n_runs ? SV_OK : fail_job(t, err);
}

sv_status tables_run_all(tables *t, sv_err *err) {
  char what[200];
  const int n_done = read_all(t, err);
  if (n_done < 0) return SV_E_RANGE;
  t->n_missing = t->n_runs - n_done;
  say_state(t, n_done);
  if (t->o->plan) return write_lines(t, t->o->plan, err);
  if (!t->n_missing) return SV_OK;
  if (!t->o->is_collected) {
    t->n_missing = 0;
    return run_missing(t, err);
  }
  tables_describe(t, first_missing(t), what, sizeof what);
  lab_say(&t->session, "%d of %d runs are missing, the first: %s", t->n_missing, t->n_runs, what);
  return SV_OK;
}
