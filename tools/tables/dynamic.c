// SPDX-License-Identifier: Apache-2.0
// The tables `dynamic`: moving scenes, each device against its own monocular stream, in both forms
// of motion. Every model is scored on the held-out cameras over all times, and on the held-out
// times of the camera that all devices share, the monocular one (the paper's protocol).
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/str.h"
#include "tools/tables/jobs.h"
#include "tools/tables/plot.h"
#include "tools/tables/real.h"

enum { MODE_CLIP, MODE_FIELD, N_MODES };
static const char *const mode_names[N_MODES] = {"clip", "field"};
static const int devices[] = {TABLES_MONO, TABLES_STEREO, TABLES_PHONE};
#define N_DEVICES ((int)(sizeof devices / sizeof *devices))

typedef struct {
  int i_scene, device, mode;
  tables_figures novel, time;
  tables_result train;
} row;

typedef struct {
  tables *t;
  row *rows;
  int n;
} job;

#define TRAIN "train.out.json"
#define TIME  "time.out.json"

static const char *file_of(const tables *t, int i_scene, int device) {
  const tables_capture *c = &t->scenes[i_scene].of[device];
  return c->files[c->i_main].transforms;
}

// Whether views of held-out cameras are scored; recordings have held-out times only.
static bool has_cameras(const tables *t, int i_scene) { return t->scenes[i_scene].n_views[TABLES_TEST] > 0; }

// What was made with other noise is another run's.
static void name_run(const tables *t, const row *r, char out[TABLES_CAP_KEY]) {
  const tables_capture *c = &t->scenes[r->i_scene].of[r->device];
  char noise[80] = "";
  if (t->o->noise && *t->o->noise)
    snprintf(noise, sizeof noise, "_noise%s_%.9g_%.9g", t->o->is_noise_on_prediction ? "_prediction" : "",
             (double)t->o->noise_read, (double)t->o->noise_shot);
  snprintf(out, TABLES_CAP_KEY, "dynamic_%s_%s_%s_g%ld_s%ld_seed%ld%s_%08x", t->scenes[r->i_scene].name,
           tables_device_names[r->device], mode_names[r->mode], t->n_gaussians, t->n_steps, t->seed, noise,
           (unsigned)c->files[c->i_main].digest);
}

typedef struct {
  char n_gaussians[24], n_steps[24], seed[24], threads[24];
} numbers;

static sv_status job_of(tables_job *j, const tables *t, const row *r, numbers *n, sv_err *err) {
  char key[TABLES_CAP_KEY];
  const char *data = t->scenes[r->i_scene].folder;
  name_run(t, r, key);
  sv_status st = tables_job_begin(j, t, key, err);
  if (st != SV_OK) return st;
  j->is_model_kept = true;
  snprintf(j->what, sizeof j->what, "%s, %s, %s", t->scenes[r->i_scene].name, tables_device_words[r->device],
           mode_names[r->mode]);
  snprintf(n->n_gaussians, sizeof n->n_gaussians, "%ld", t->n_gaussians);
  snprintf(n->n_steps, sizeof n->n_steps, "%ld", t->n_steps);
  snprintf(n->seed, sizeof n->seed, "%ld", t->seed);
  snprintf(n->threads, sizeof n->threads, "%ld", t->n_threads);
  tables_step *s = tables_job_step(j, TRAIN, "train");
  s->must_have_steps = t->n_steps;
  tables_job_add(s, "--data", data);
  tables_job_add(s, "--transforms", file_of(t, r->i_scene, r->device));
  tables_job_add(s, "--model", "4dgs");
  tables_job_add(s, "--motion", mode_names[r->mode]);
  tables_job_add(s, "--gaussians", n->n_gaussians);
  tables_job_add(s, "--steps", n->n_steps);
  tables_job_add(s, "--seed", n->seed);
  if (has_cameras(t, r->i_scene)) {
    tables_job_add(s, "--eval", NULL);
    tables_job_add(s, "--lpips", NULL);
  }
  if (t->o->noise && *t->o->noise) tables_job_add(s, "--noise", t->o->noise);
  tables_job_add(s, "--threads", n->threads);
  tables_job_add(s, "--json", NULL);
  tables_job_add(s, "--out", "$d");
  s = tables_job_step(j, TIME, "eval");
  tables_job_add(s, "--data", data);
  tables_job_add(s, "--transforms", file_of(t, r->i_scene, TABLES_MONO));
  tables_job_add(s, "--model", "$d/model.ply");
  tables_job_add(s, "--split", "test_time");
  tables_job_add(s, "--lpips", NULL);
  tables_job_add(s, "--threads", n->threads);
  tables_job_add(s, "--json", NULL);
  return SV_OK;
}

static bool take(const job *j, row *r, const tables_job *from, const char *file) {
  char *text;
  sv_err err;
  double wall_s = 0;
  sv_status s = tables_job_read(from, file, &text, &err);
  const bool is_train = strcmp(file, TRAIN) == 0;
  if (s == SV_OK && is_train) s = tables_result_train(&r->train, text, &err);
  const bool is_scored = !is_train || has_cameras(j->t, r->i_scene);
  if (!is_scored) r->novel = tables_no_result().score[0];
  if (s == SV_OK && is_scored) s = tables_result_eval(is_train ? &r->novel : &r->time, &wall_s, text, &err);
  free(text);
  if (s != SV_OK && s != SV_E_NOT_FOUND) tables_job_drop(from, j->t, file, &err);
  return s == SV_OK;
}

// How many runs are there; with f, the lines of the others.
static sv_status look(void *of, FILE *f, int *n_done, sv_err *err) {
  const job *j = of;
  *n_done = 0;
  for (int i = 0; i < j->n; i++) {
    row *r = &j->rows[i];
    numbers n;
    tables_job one;
    sv_status s = job_of(&one, j->t, r, &n, err);
    if (s != SV_OK) return s;
    const bool is_trained = take(j, r, &one, TRAIN), is_scored = take(j, r, &one, TIME);
    if (is_trained && is_scored) ++*n_done;
    else {
      r->train = tables_no_result();
      r->novel = r->time = r->train.score[0];
      if (f) tables_job_line(&one, j->t, f);
    }
  }
  return SV_OK;
}

// --- what is written -----------------------------------------------------------------------------

static const row *row_of(const job *j, int i_scene, int mode, int device) {
  for (int i = 0; i < j->n; i++)
    if (j->rows[i].i_scene == i_scene && j->rows[i].mode == mode && j->rows[i].device == device)
      return &j->rows[i];
  return NULL;
}

static void put_row(FILE *f, const job *j, const row *r, bool is_csv) {
  const char *sep = is_csv ? "," : " | ";
  const row *m = row_of(j, r->i_scene, r->mode, TABLES_MONO);
  char v[15][32];
  for (int k = 0; k < 4; k++) tables_format(v[k], sizeof v[k], k, r->novel.of[k]);
  for (int k = 0; k < 3; k++) tables_format(v[4 + k], sizeof v[0], k, r->time.of[k]);
  bool has_mono = m && m != r;
  tables_format(v[7], sizeof v[7], TABLES_PSNR, has_mono ? r->novel.of[0] - m->novel.of[0] : NAN);
  tables_format(v[8], sizeof v[8], TABLES_PSNR, has_mono ? r->time.of[0] - m->time.of[0] : NAN);
  tables_format(v[9], sizeof v[9], TABLES_PSNR,
                has_mono ? r->novel.of[TABLES_ABS_REL] / m->novel.of[TABLES_ABS_REL] : NAN);
  snprintf(v[10], sizeof v[10], "%.1f", r->train.seconds);
  snprintf(v[11], sizeof v[11], "%.1f", r->train.arena_bytes * 1e-6);
  fprintf(f, "%s%s%s%s%s%s", is_csv ? "" : "| ", j->t->scenes[r->i_scene].name, sep,
          tables_device_words[r->device], sep, mode_names[r->mode]);
  for (int k = 0; k < 3; k++)
    tables_format(v[12 + k], sizeof v[0], k,
                  r->mode == MODE_FIELD
                      ? tables_paper_real(&j->t->scenes[r->i_scene], r->device, TABLES_PLAIN, k, false)
                      : NAN);
  for (int k = 0; k < 15; k++) fprintf(f, "%s%s", sep, v[k]);
  fprintf(f, is_csv ? "\n" : " |\n");
}

static void put_all(FILE *f, const job *j, bool is_csv) {
  static const char *const head[] = {"scene",
                                     "device",
                                     "motion",
                                     "cameras PSNR",
                                     "SSIM",
                                     "LPIPS",
                                     "AbsRel",
                                     "times PSNR",
                                     "SSIM",
                                     "LPIPS",
                                     "cameras dB over mono",
                                     "times dB over mono",
                                     "AbsRel of mono's",
                                     "s",
                                     "MB",
                                     "paper's PSNR",
                                     "paper's SSIM",
                                     "paper's LPIPS"};
  const int n = sizeof head / sizeof *head;
  for (int k = 0; k < n; k++)
    fprintf(f, "%s%s%s", is_csv ? (k ? "," : "") : "| ", head[k], is_csv ? "" : " ");
  fprintf(f, is_csv ? "\n" : "|\n");
  for (int k = 0; k < n && !is_csv; k++) fprintf(f, k < 3 ? "|---" : "|--:");
  if (!is_csv) fprintf(f, "|\n");
  for (int i = 0; i < j->n; i++) put_row(f, j, &j->rows[i], is_csv);
}

// A group of bars for each scene and form of motion, a bar for each device.
static sv_status write_bars(const job *j, const char *name, bool is_time, sv_err *err) {
  char text[1000];
  sv_str plot = sv_str_make(text, sizeof text);
  FILE *f = tables_script_open(j->t, name, err);
  if (!f) return SV_E_IO;
  fprintf(
      f,
      "set title \"Moving scenes, %s\"\nset ylabel 'PSNR (dB)'\nset grid y\nset style data histograms\n"
      "set style histogram clustered gap 1\nset style fill solid 0.8\nset offsets 0, 0, graph 0.15, graph "
      "0.15\n"
      "set xtics rotate by -30 noenhanced\nset key inside top left\nset datafile missing '?'\n$bars << EOD\n",
      is_time ? "held-out frames of the camera that all devices share" : "held-out cameras over all times");
  const row *last = NULL;
  for (int i = 0; i < j->n; last = &j->rows[i++]) {
    const row *r = &j->rows[i];
    if (last && last->i_scene == r->i_scene && last->mode == r->mode) continue;
    fprintf(f, "\"%s, %s\"", j->t->scenes[r->i_scene].name, mode_names[r->mode]);
    for (int d = 0; d < N_DEVICES; d++) {
      const row *of = row_of(j, r->i_scene, r->mode, devices[d]);
      double v = of ? (is_time ? &of->time : &of->novel)->of[TABLES_PSNR] : NAN;
      if (isnan(v)) fprintf(f, " ?");
      else fprintf(f, " %.7g", v);
    }
    fprintf(f, "\n");
  }
  fprintf(f, "EOD\n");
  for (int d = 0; d < N_DEVICES; d++)
    sv_str_add(&plot, "%s$bars using %d%s lc rgb '#%06x' title '%s'", d ? ", " : "plot ", 2 + d,
               d ? "" : ":xtic(1)", (unsigned)tables_device_colours[devices[d]],
               tables_device_words[devices[d]]);
  return tables_script_close(f, name, text, err);
}

static sv_status write_plots(const job *j, bool *has_pictures, sv_err *err) {
  static const char *const names[] = {"dynamic_cameras_psnr", "dynamic_frames_psnr"};
  tables_drawing d;
  sv_status s = tables_drawing_begin(j->t, &d, err);
  for (int i = 0; i < 2 && s == SV_OK; i++)
    if ((s = write_bars(j, names[i], i == 1, err)) == SV_OK) tables_draw(j->t, &d, names[i]);
  *has_pictures = s == SV_OK && d.n_drawn > 0;
  return s;
}

static sv_status write_file(const job *j, const char *name, bool is_csv, bool has_plots, sv_err *err) {
  char path[SV_CAP_PATH];
  sv_status s = sv_path_join(path, sizeof path, j->t->o->out, name, err);
  if (s != SV_OK) return s;
  FILE *f = sv_stream_open(path, err);
  if (!f) return SV_E_IO;
  if (!is_csv)
    fprintf(
        f,
        "# Moving scenes: one camera, stereo, phone\n\n"
        "Written by `subview-lab tables`: %ld Gaussians, %ld steps; devices with several cameras start from "
        "their own depth maps. \"Cameras\": held-out "
        "cameras "
        "over all times. \"Times\": held-out frames of the camera that all devices share. \"clip\": each "
        "Gaussian has its own motion; \"field\": one deformation field (HexPlane and layers), as in 4DGS. "
        "`s` is "
        "the time of training, `MB` its one memory block. The paper's figures are of 4DGS (our \"field\") on "
        "the "
        "held-out frames of the same recordings; its LPIPS is that of VGG, which is not comparable with ours "
        "of "
        "SqueezeNet, and its poses vary over time.\n\n",
        j->t->n_gaussians, j->t->n_steps);
  put_all(f, j, is_csv);
  if (!is_csv) tables_put_plots(f, j->t, has_plots);
  return sv_stream_save(f, err);
}

sv_status tables_dynamic(tables *t, sv_err *err) {
  job *j = calloc(1, sizeof *j);
  if (j) j->rows = calloc((size_t)t->n_scenes * N_MODES * TABLES_N_DEVICES, sizeof *j->rows);
  if (!j || !j->rows) {
    free(j);
    return sv_fail(err, SV_E_NOMEM, "no memory for the runs");
  }
  j->t = t;
  for (int i = 0; i < t->n_scenes; i++)
    for (int m = 0; m < N_MODES; m++)
      for (int d = 0; d < N_DEVICES; d++)
        if (t->scenes[i].of[devices[d]].n)
          j->rows[j->n++] = (row){.i_scene = i, .device = devices[d], .mode = m};
  t->n_runs = j->n;
  sv_status s = tables_make_jobs(t, look, j, j->n, err);
  bool has_pictures = false;
  if (s != SV_OK || t->o->plan) {
    free(j->rows);
    free(j);
    return s;
  }
  s = write_file(j, "dynamic.csv", true, false, err);
  if (s == SV_OK) s = write_plots(j, &has_pictures, err);
  if (s == SV_OK) s = write_file(j, "tables.md", false, has_pictures, err);
  free(j->rows);
  free(j);
  return s;
}
