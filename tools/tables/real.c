// SPDX-License-Identifier: Apache-2.0
// The tables of real cameras: each device against its own single camera, on one exposure with three
// methods, or on videos with and without an external prior. Every model is scored on the same
// held-out views under two masks: the authors' (what its own training views see), and the pixels
// that the device and its single camera both see.
#include "tools/tables/real.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/str.h"
#include "tools/tables/jobs.h"

#define TRAIN "train.out.json"
#define SCORE "test.out.json"

const char *const tables_method_words[TABLES_N_METHODS] = {"3DGS", "FSGS", "SparseGS", "prior"};
static const char *const method_options[TABLES_N_METHODS] = {NULL, "fsgs", "sparsegs", NULL};

int tables_capture_device(const tables_scene *sc) {
  for (int d = TABLES_MONO + 1; d < TABLES_N_DEVICES; d++)
    if (sc->of[d].n) return d;
  return -1;
}

// --- the paper -----------------------------------------------------------------------------------

static const struct {
  int kind, figure, capture, device, method;
  double of[8];
} paper[] = {
#define PAPER_REAL(kind, figure, capture, device, method, a, b, c, d, e, f, g, h)                            \
  {TABLES_##kind,   TABLES_##figure, TABLES_##capture,                                                       \
   TABLES_##device, TABLES_##method, {a, b, c, d, e, f, g, h}},
#include "tools/tables/paper_real.inc"
};
static const char *const paper_scenes[2][8] = {
    {"action-figure", "ball", "chicken", "dog", "espresso", "optics", "salt-pepper", "shelf"},
    {"ball", "coffee", "orange", "roll", "spinner", "sugar", "scissors", "tissue"}};

double tables_paper_real(const tables_scene *sc, int device, tables_method method, int figure,
                         bool over_scenes) {
  for (size_t i = 0; i < sizeof paper / sizeof *paper; i++) {
    double sum = 0;
    if (paper[i].kind != (int)sc->kind || paper[i].figure != figure || paper[i].device != device ||
        paper[i].method != (int)method || paper[i].capture != tables_capture_device(sc))
      continue;
    for (int k = 0; k < 8; k++) {
      sum += paper[i].of[k] / 8;
      if (!over_scenes && sv_str_eq(paper_scenes[sc->kind == TABLES_DYNAMIC][k], sc->subject))
        return paper[i].of[k];
    }
    if (over_scenes) return sum;
  }
  return NAN;
}

// --- jobs ----------------------------------------------------------------------------------------

typedef struct {
  char n_gaussians[24], n_steps[24], seed[24], threads[24];
} numbers;

static const tables_file *file_of(const tables *t, int i_scene, int device) {
  const tables_capture *c = &t->scenes[i_scene].of[device];
  return &c->files[c->i_main];
}

static const char *prior_of(const tables *t, const tables_real_row *r) {
  return r->method == TABLES_PRIOR ? t->o->prior : method_options[r->method];
}

static void name_run(const tables *t, const tables_real_row *r, char out[TABLES_CAP_KEY]) {
  const tables_scene *sc = &t->scenes[r->i_scene];
  const tables_file *f = file_of(t, r->i_scene, r->device);
  char settings[TABLES_CAP_SETTINGS + 400];
  const int other = r->device == TABLES_MONO ? tables_capture_device(sc) : TABLES_MONO;
  sv_fmt(settings, sizeof settings,
         "file %s %016llx; other %016llx; views %016llx; prior %s; gaussians %ld; steps %ld; seed %ld; noise "
         "%s",
         f->transforms, (unsigned long long)f->digest,
         (unsigned long long)file_of(t, r->i_scene, other)->digest, (unsigned long long)sc->digest,
         prior_of(t, r) ? prior_of(t, r) : "none", t->n_gaussians, t->n_steps, t->seed,
         t->o->noise && *t->o->noise ? t->o->noise : "none");
  const uint64_t h = tables_hash(TABLES_HASH, settings, strlen(settings));
  sv_fmt(out, TABLES_CAP_KEY, "%s_%s_%s_g%ld_s%ld_%08x", sc->name, tables_device_names[r->device],
         tables_method_words[r->method], t->n_gaussians, t->n_steps, (unsigned)(h ^ h >> 32));
}

static void add_score(tables_job *j, const tables *t, const tables_real_row *r, const numbers *n) {
  const tables_scene *sc = &t->scenes[r->i_scene];
  const int other = r->device == TABLES_MONO ? tables_capture_device(sc) : TABLES_MONO;
  tables_step *s = tables_job_step(j, SCORE, "eval");
  tables_job_add(s, "--data", sc->folder);
  tables_job_add(s, "--model", "$d/model.ply");
  tables_job_add(s, "--split", "test");
  tables_job_add(s, "--mask", "covisible");
  tables_job_add(s, "--mask-with", file_of(t, r->i_scene, other)->transforms);
  tables_job_add(s, "--lpips", NULL);
  tables_job_add(s, "--threads", n->threads);
  tables_job_add(s, "--json", NULL);
}

static sv_status job_of(tables_job *j, const tables *t, const tables_real_row *r, numbers *n, sv_err *err) {
  const tables_scene *sc = &t->scenes[r->i_scene];
  char key[TABLES_CAP_KEY];
  name_run(t, r, key);
  sv_status st = tables_job_begin(j, t, key, err);
  if (st != SV_OK) return st;
  snprintf(j->what, sizeof j->what, "%s, %s, %s, %ld Gaussians", sc->name, tables_device_words[r->device],
           tables_method_words[r->method], t->n_gaussians);
  snprintf(n->n_gaussians, sizeof n->n_gaussians, "%ld", t->n_gaussians);
  snprintf(n->n_steps, sizeof n->n_steps, "%ld", t->n_steps);
  snprintf(n->seed, sizeof n->seed, "%ld", t->seed);
  snprintf(n->threads, sizeof n->threads, "%ld", t->n_threads);
  tables_step *s = tables_job_step(j, TRAIN, "train");
  s->must_have_steps = t->n_steps;
  tables_job_add(s, "--data", sc->folder);
  tables_job_add(s, "--transforms", file_of(t, r->i_scene, r->device)->transforms);
  tables_job_add(s, "--gaussians", n->n_gaussians);
  tables_job_add(s, "--steps", n->n_steps);
  tables_job_add(s, "--seed", n->seed);
  if (prior_of(t, r)) tables_job_add(s, "--prior", prior_of(t, r));
  if (t->o->noise && *t->o->noise) tables_job_add(s, "--noise", t->o->noise);
  tables_job_add(s, "--threads", n->threads);
  tables_job_add(s, "--json", NULL);
  tables_job_add(s, "--out", "$d");
  add_score(j, t, r, n);
  return SV_OK;
}

// --- results -------------------------------------------------------------------------------------

static void forget(tables_real_row *r) {
  r->is_done = false;
  r->train = tables_no_result();
  r->whole = r->train.score[0];
  for (int m = 0; m < TABLES_N_MASKS; m++) r->masked[m] = (tables_masked){NAN, {NAN, NAN, NAN}};
}

static bool take(const tables_real_job *j, tables_real_row *r, const tables_job *from, const char *file) {
  char *text;
  sv_err err;
  double wall_s = 0;
  sv_status s = tables_job_read(from, file, &text, &err);
  const bool is_train = strcmp(file, TRAIN) == 0;
  if (s == SV_OK && is_train) s = tables_result_train(&r->train, text, &err);
  if (s == SV_OK && !is_train) s = tables_result_eval(&r->whole, &wall_s, text, &err);
  if (s == SV_OK && !is_train) s = tables_result_masked(r->masked, text, &err);
  free(text);
  if (s != SV_OK && s != SV_E_NOT_FOUND) tables_job_drop(from, j->t, file, &err);
  return s == SV_OK;
}

static sv_status look(void *of, FILE *f, int *n_done, sv_err *err) {
  const tables_real_job *j = of;
  *n_done = 0;
  for (int i = 0; i < j->n; i++) {
    tables_real_row *r = &j->rows[i];
    numbers n;
    tables_job one;
    sv_status s = job_of(&one, j->t, r, &n, err);
    if (s != SV_OK) return s;
    forget(r);
    const bool is_trained = take(j, r, &one, TRAIN), is_scored = take(j, r, &one, SCORE);
    r->is_done = is_trained && is_scored;
    if (r->is_done) ++*n_done;
    else {
      forget(r);
      if (f) tables_job_line(&one, j->t, f);
    }
  }
  return SV_OK;
}

// Static scenes: three methods; casual ones: without, and with the external prior that was given.
static bool has_method(const tables *t, tables_kind kind, tables_method m) {
  if (kind == TABLES_STATIC) return m != TABLES_PRIOR;
  return m == TABLES_PLAIN || (m == TABLES_PRIOR && t->o->prior);
}

sv_status tables_real(tables *t, sv_err *err) {
  tables_real_job j = {.t = t};
  j.rows = calloc((size_t)t->n_scenes * 2 * TABLES_N_METHODS, sizeof *j.rows);
  if (!j.rows) return sv_fail(err, SV_E_NOMEM, "no memory for the runs");
  for (int i = 0; i < t->n_scenes; i++) {
    const tables_scene *sc = &t->scenes[i];
    if (tables_capture_device(sc) < 0 || !sc->of[TABLES_MONO].n) {
      free(j.rows);
      return sv_fail(err, SV_E_NOT_FOUND, "%.150s: needs transforms_train_mono.json and that of one device",
                     sc->folder);
    }
    const int both[] = {TABLES_MONO, tables_capture_device(sc)};
    for (int d = 0; d < 2; d++)
      for (int m = 0; m < TABLES_N_METHODS; m++)
        if (has_method(t, sc->kind, (tables_method)m))
          j.rows[j.n++] = (tables_real_row){.i_scene = i, .device = both[d], .method = (tables_method)m};
  }
  t->n_runs = j.n;
  sv_status s = tables_make_jobs(t, look, &j, j.n, err);
  if (s == SV_OK && !t->o->plan) s = tables_real_write(&j, err);
  free(j.rows);
  return s;
}
