// SPDX-License-Identifier: Apache-2.0
// The runs: each trains, is scored and, for the contact sheet, renders its near views, in
// OUT/runs/KEY. result.json is written last, so what a stopped command leaves unfinished is done
// again and nothing else is.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "src/base/str.h"
#include "tools/tables/tables.h"

#define MAX_ARGS  40
#define CAP_JSON  (16 << 10)
#define TRUSTED_S 15.0 // the nominal speed counts as much as this many seconds of measurements

// What the commands of one run share.
typedef struct {
  tables *t;
  tables_run *r;
  char folder[SV_CAP_PATH], model[SV_CAP_PATH], log[SV_CAP_PATH], result[SV_CAP_PATH], views[SV_CAP_PATH];
  char out[CAP_JSON];
  double t0_s;
  const char *doing;
  double *done_cost, *done_s; // of the runs of this session
  int i_run, n_left;
} job;

// --- progress ------------------------------------------------------------------------------------

static double left_s(const job *j, double into_s) {
  double cost = 0, speed = (TRUSTED_S + *j->done_s) / (TRUSTED_S + *j->done_cost);
  for (int i = 0; i < j->t->n_runs; i++)
    if (!j->t->runs[i].is_done) cost += j->t->runs[i].cost;
  cost = cost * speed - into_s;
  return cost > 0 ? cost : 0;
}

static void clock_text(char *out, size_t cap, double s) {
  long v = (long)(s + 0.5);
  if (v >= 3600) snprintf(out, cap, "%ld:%02ld:%02ld", v / 3600, v / 60 % 60, v % 60);
  else snprintf(out, cap, "%ld:%02ld", v / 60, v % 60);
}

static void tick(void *self) {
  const job *j = self;
  const sv_console *c = &j->t->session.console;
  char line[400], what[200], eta[40];
  double into = lab_seconds(&j->t->session) - j->t0_s;
  tables_describe(j->t, j->r, what, sizeof what);
  clock_text(eta, sizeof eta, left_s(j, into));
  snprintf(line, sizeof line, "run %d of %d: %s: %s, %.0f s, ETA %s", j->i_run, j->t->n_runs, what, j->doing,
           into, eta);
  c->log(c->self, SV_LOG_LIVE, line);
}

static void say_done(const job *j) {
  char what[200], eta[40];
  int split = j->r->needs[TABLES_NEAR] ? TABLES_NEAR : TABLES_TEST;
  tables_describe(j->t, j->r, what, sizeof what);
  clock_text(eta, sizeof eta, left_s(j, 0));
  lab_say(&j->t->session, "run %d of %d: %s: PSNR %.2f dB, %.1f s, ETA %s", j->i_run, j->t->n_runs, what,
          j->r->result.score[split].of[TABLES_PSNR], j->r->result.wall_s, eta);
}

// --- commands ------------------------------------------------------------------------------------

typedef struct {
  char *v[MAX_ARGS];
  int n;
  char numbers[8][24];
  int n_numbers;
} words;

static void add(words *w, const char *word) {
  if (w->n < MAX_ARGS - 1) w->v[w->n++] = (char *)(uintptr_t)word; // execv does not write to them
  w->v[w->n] = NULL;
}

static void add_number(words *w, const char *option, long v) {
  char *to = w->numbers[w->n_numbers++];
  snprintf(to, sizeof w->numbers[0], "%ld", v);
  add(w, option);
  add(w, to);
}

// Name, command and what all commands share.
static words begin(const job *j, const char *command) {
  words w = {.n = 0};
  add(&w, "subview-lab");
  add(&w, command);
  add(&w, "--data");
  add(&w, j->t->scenes[j->r->set.i_scene].folder);
  return w;
}

static sv_status run_child(job *j, words *w, const char *doing, sv_err *err) {
  tables_child c = {j->t->program, j->log, w->v, &j->t->session, tick, j};
  j->doing = doing;
  return tables_child_run(&c, j->out, sizeof j->out, err);
}

static sv_status train(job *j, sv_err *err) {
  const tables *t = j->t;
  const tables_setting *s = &j->r->set;
  words w = begin(j, "train");
  add(&w, "--transforms");
  add(&w, tables_file_of(t, s)->transforms);
  add_number(&w, "--exposures", s->n_exposures);
  add_number(&w, "--gaussians", s->n_gaussians);
  add_number(&w, "--steps", t->n_steps);
  add_number(&w, "--seed", t->seed);
  add(&w, "--init");
  add(&w, s->is_cube ? "cube" : "sphere");
  if (s->is_tv_off) {
    add(&w, "--loss");
    add(&w, "tv=0,tv_novel=0");
  }
  if (t->o->noise) {
    add(&w, "--noise");
    add(&w, t->o->noise);
  }
  if (t->o->threads > 0) add_number(&w, "--threads", t->o->threads);
  add(&w, "--json");
  add(&w, "--out");
  add(&w, j->folder);
  sv_status st = run_child(j, &w, "training", err);
  if (st == SV_OK) st = tables_result_train(&j->r->result, j->out, err);
  if (st == SV_OK && j->r->result.steps != t->n_steps)
    return sv_fail(err, SV_E_INTERRUPTED, "train ended after %ld of %ld steps", j->r->result.steps,
                   t->n_steps);
  return st;
}

static sv_status score(job *j, int split, sv_err *err) {
  words w = begin(j, "eval");
  add(&w, "--model");
  add(&w, j->model);
  add(&w, "--split");
  add(&w, tables_split_names[split]);
  if (j->t->scenes[j->r->set.i_scene].has_depth) add(&w, "--depth");
  add(&w, "--lpips");
  if (j->t->o->threads > 0) add_number(&w, "--threads", j->t->o->threads);
  add(&w, "--json");
  sv_status s = run_child(j, &w, "scoring", err);
  return s == SV_OK ? tables_result_eval(&j->r->result.score[split], j->out, err) : s;
}

static sv_status render(job *j, sv_err *err) {
  words w = begin(j, "render");
  add(&w, "--model");
  add(&w, j->model);
  add(&w, "--split");
  add(&w, tables_split_names[TABLES_NEAR]);
  add(&w, "--depth");
  if (j->t->o->threads > 0) add_number(&w, "--threads", j->t->o->threads);
  add(&w, "--out");
  add(&w, j->views);
  return run_child(j, &w, "rendering", err);
}

// --- one run -------------------------------------------------------------------------------------

static sv_status find_paths(job *j, sv_err *err) {
  char name[TABLES_CAP_KEY + 8];
  snprintf(name, sizeof name, "runs/%s", j->r->key);
  sv_status s = sv_path_join(j->folder, sizeof j->folder, j->t->o->out, name, err);
  if (s == SV_OK) s = sv_path_join(j->model, sizeof j->model, j->folder, "model.ply", err);
  if (s == SV_OK) s = sv_path_join(j->log, sizeof j->log, j->folder, "log.txt", err);
  if (s == SV_OK) s = sv_path_join(j->result, sizeof j->result, j->folder, "result.json", err);
  if (s == SV_OK) s = sv_path_join(j->views, sizeof j->views, j->folder, "views", err);
  return s;
}

// Whether there is a whole result of these settings. Says so when there is one that cannot be used.
static bool is_there(job *j, sv_err *err) {
  char list[SV_CAP_PATH];
  bool has_views =
      !j->r->has_views || (sv_path_join(list, sizeof list, j->views, "views.json", err) == SV_OK &&
                           sv_path_exists(list) && sv_path_exists(j->model));
  sv_status s = tables_result_read(j->r, j->result, err);
  if (s == SV_OK && has_views) return true;
  if (s == SV_OK) lab_say(&j->t->session, "%s: its images are missing; measuring again", j->folder);
  else if (s != SV_E_NOT_FOUND) lab_say(&j->t->session, "%s; measuring again", err->text);
  return false;
}

static sv_status measure(job *j, sv_err *err) {
  tables_run *r = j->r;
  j->t0_s = lab_seconds(&j->t->session);
  memset(&r->result, 0, sizeof r->result);
  sv_status s = sv_path_make_folder(j->folder, err);
  if (s != SV_OK) return s;
  unlink(j->log);
  unlink(j->result);
  s = train(j, err);
  for (int k = 0; k < TABLES_N_SPLITS && s == SV_OK; k++)
    if (r->needs[k]) s = score(j, k, err);
  if (s == SV_OK && r->has_views) s = render(j, err);
  if (s != SV_OK) return s;
  if (!r->has_views) unlink(j->model); // a hundred of them would fill a disk
  r->result.wall_s = lab_seconds(&j->t->session) - j->t0_s;
  sv_copy(r->result.build, sizeof r->result.build, j->t->build);
  s = tables_result_write(r, j->result, err);
  // What is read back is what a later command will see: the same digits.
  return s == SV_OK ? tables_result_read(r, j->result, err) : s;
}

static sv_status fail_run(const job *j, sv_status s, sv_err *err) {
  char what[200];
  sv_err cause = *err;
  int n_done = 0;
  for (int i = 0; i < j->t->n_runs; i++) n_done += j->t->runs[i].is_done;
  if (s == SV_E_INTERRUPTED)
    return sv_fail(err, s,
                   "stopped by request with %d of %d runs done; run the same command again to continue",
                   n_done, j->t->n_runs);
  tables_describe(j->t, j->r, what, sizeof what);
  return sv_fail(err, s, "run %d (%s): %s", j->i_run, what, cause.text);
}

static void say_start(const job *j) {
  char eta[40];
  int n_other = 0;
  clock_text(eta, sizeof eta, left_s(j, 0));
  for (int i = 0; i < j->t->n_runs; i++) n_other += j->t->runs[i].is_done && j->t->runs[i].is_other_build;
  lab_say(&j->t->session, "%d runs, %d already done; about %s on two cores", j->t->n_runs,
          j->t->n_runs - j->n_left, eta);
  if (n_other)
    lab_say(&j->t->session,
            "%d results come from another build of this program; remove %s/runs to measure them again",
            n_other, j->t->o->out);
}

sv_status tables_run_all(tables *t, sv_err *err) {
  double done_cost = 0, done_s = 0;
  job *j = calloc(1, sizeof *j);
  if (!j) return sv_fail(err, SV_E_NOMEM, "no memory for a run");
  *j = (job){.t = t, .done_cost = &done_cost, .done_s = &done_s};
  sv_status s = SV_OK;
  for (int i = 0; i < t->n_runs && s == SV_OK; i++) {
    j->r = &t->runs[i];
    if ((s = find_paths(j, err)) != SV_OK) break;
    j->r->is_done = is_there(j, err);
    j->r->is_other_build = j->r->is_done && !sv_str_eq(j->r->result.build, t->build);
    j->n_left += !j->r->is_done;
  }
  if (s == SV_OK) say_start(j);
  for (int i = 0; i < t->n_runs && s == SV_OK; i++) {
    j->r = &t->runs[i];
    j->i_run = i + 1;
    if (j->r->is_done) continue;
    if ((s = find_paths(j, err)) == SV_OK) s = measure(j, err);
    if (t->session.console.is_stop_requested(t->session.console.self)) s = SV_E_INTERRUPTED;
    if (s != SV_OK) {
      s = fail_run(j, s, err);
      break;
    }
    j->r->is_done = true;
    done_cost += j->r->cost;
    done_s += j->r->result.wall_s;
    say_done(j);
  }
  free(j);
  return s;
}
