// SPDX-License-Identifier: Apache-2.0
// The tables `dynamic`: moving scenes, each device against its own monocular stream, in both forms
// of motion. Every model is scored on the held-out cameras over all times, and on the held-out
// times of the camera that all devices share, the monocular one (the paper's protocol).
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/str.h"
#include "tools/tables/plot.h"

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
  int n, i_now;
  const char *doing;
  char threads[24]; // empty: all
  char out[16 << 10], folder[SV_CAP_PATH], log[SV_CAP_PATH], model[SV_CAP_PATH];
} job;

static void tick(void *self) {
  const job *j = self;
  const row *r = &j->rows[j->i_now];
  const sv_console *c = &j->t->session.console;
  char line[200];
  snprintf(line, sizeof line, "run %d of %d: %s, %s, %s: %s", j->i_now + 1, j->n,
           j->t->scenes[r->i_scene].name, tables_device_words[r->device], mode_names[r->mode], j->doing);
  c->log(c->self, SV_LOG_LIVE, line);
}

static const char *file_of(const tables *t, int i_scene, int device) {
  const tables_capture *c = &t->scenes[i_scene].of[device];
  return c->files[c->i_main].transforms;
}

// Runs a command of this program, or takes what it printed when it was run before; kept in
// FOLDER/name.
static sv_status child(job *j, const char *name, char **argv, const char *doing, sv_err *err) {
  char path[SV_CAP_PATH];
  void *text;
  size_t bytes;
  j->doing = doing;
  sv_status s = sv_path_join(path, sizeof path, j->folder, name, err);
  if (s == SV_OK && sv_path_exists(path) && sv_file_read(path, &text, &bytes, err) == SV_OK) {
    size_t n = bytes < sizeof j->out - 1 ? bytes : sizeof j->out - 1;
    memcpy(j->out, text, n);
    j->out[n] = 0;
    free(text);
    return SV_OK;
  }
  tables_child c = {j->t->program, j->log, argv, &j->t->session, tick, j};
  if (s == SV_OK) s = tables_child_run(&c, j->out, sizeof j->out, err);
  return s == SV_OK ? sv_file_write(path, j->out, strlen(j->out), err) : s;
}

// An option that was given is passed on; returns what follows it.
static const char **pass_on(const char **to, const char *option, const char *value) {
  if (!value || !*value) return to;
  to[0] = option;
  to[1] = value;
  to[2] = NULL;
  return to + 2;
}

static sv_status train(job *j, row *r, sv_err *err) {
  const tables *t = j->t;
  char n_gaussians[24], n_steps[24], seed[24];
  snprintf(n_gaussians, sizeof n_gaussians, "%ld", t->n_gaussians);
  snprintf(n_steps, sizeof n_steps, "%ld", t->n_steps);
  snprintf(seed, sizeof seed, "%ld", t->seed);
  const char *argv[30] = {"subview-lab",  "train",
                          "--data",       t->scenes[r->i_scene].folder,
                          "--transforms", file_of(t, r->i_scene, r->device),
                          "--model",      "4dgs",
                          "--motion",     mode_names[r->mode],
                          "--gaussians",  n_gaussians,
                          "--steps",      n_steps,
                          "--seed",       seed,
                          "--eval",       "--lpips",
                          "--json",       "--out",
                          j->folder};
  const char **more = argv;
  while (*more) more++;
  more = pass_on(more, "--noise", t->o->noise);
  pass_on(more, "--threads", j->threads);
  sv_status s = child(j, "train.out.json", (char **)(uintptr_t)argv, "training", err);
  if (s == SV_OK) s = tables_result_train(&r->train, j->out, err);
  return s == SV_OK ? tables_result_eval(&r->novel, j->out, err) : s;
}

static sv_status score_time(job *j, row *r, sv_err *err) {
  const tables *t = j->t;
  const char *argv[] = {"subview-lab",
                        "eval",
                        "--data",
                        t->scenes[r->i_scene].folder,
                        "--transforms",
                        file_of(t, r->i_scene, TABLES_MONO),
                        "--model",
                        j->model,
                        "--split",
                        "test_time",
                        "--lpips",
                        "--json",
                        *j->threads ? "--threads" : NULL,
                        j->threads,
                        NULL};
  sv_status s = child(j, "time.out.json", (char **)(uintptr_t)argv, "scoring held-out times", err);
  return s == SV_OK ? tables_result_eval(&r->time, j->out, err) : s;
}

// What was made with other noise is another run's.
static void name_run(const tables *t, const row *r, char *out, size_t cap) {
  const tables_capture *c = &t->scenes[r->i_scene].of[r->device];
  char noise[80] = "";
  if (t->o->noise)
    snprintf(noise, sizeof noise, "_noise%s_%.9g_%.9g", t->o->is_noise_on_prediction ? "_prediction" : "",
             (double)t->o->noise_read, (double)t->o->noise_shot);
  snprintf(out, cap, "runs/dynamic_%s_%s_%s_g%ld_s%ld_seed%ld%s_%08x", t->scenes[r->i_scene].name,
           tables_device_names[r->device], mode_names[r->mode], t->n_gaussians, t->n_steps, t->seed, noise,
           (unsigned)c->files[c->i_main].digest);
}

static sv_status measure(job *j, row *r, sv_err *err) {
  const tables *t = j->t;
  char name[300];
  name_run(t, r, name, sizeof name);
  sv_status s = sv_path_join(j->folder, sizeof j->folder, t->o->out, name, err);
  if (s == SV_OK) s = sv_path_make_folder(j->folder, err);
  if (s == SV_OK) s = sv_path_join(j->log, sizeof j->log, j->folder, "log.txt", err);
  if (s == SV_OK) s = sv_path_join(j->model, sizeof j->model, j->folder, "model.ply", err);
  if (s == SV_OK) s = train(j, r, err);
  if (s == SV_OK) s = score_time(j, r, err);
  if (s == SV_OK)
    lab_say(&j->t->session,
            "run %d of %d: %s, %s, %s: held-out cameras %.2f dB, held-out times %.2f dB, %.1f s",
            j->i_now + 1, j->n, t->scenes[r->i_scene].name, tables_device_words[r->device],
            mode_names[r->mode], r->novel.of[TABLES_PSNR], r->time.of[TABLES_PSNR], r->train.seconds);
  return s;
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
  char v[12][32];
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
  for (int k = 0; k < 12; k++) fprintf(f, "%s%s", sep, v[k]);
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
                                     "MB"};
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
      "set style histogram clustered gap 1\nset style fill solid 0.8\nset yrange [0:*]\n"
      "set xtics rotate by -30 noenhanced\nset key outside right\nset datafile missing '?'\n$bars << EOD\n",
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
        "the time of training, `MB` its one memory block.\n\n",
        j->t->n_gaussians, j->t->n_steps);
  put_all(f, j, is_csv);
  if (!is_csv) tables_put_plots(f, j->t, has_plots);
  return sv_stream_save(f, err);
}

sv_status tables_dynamic(tables *t, int *n_runs, sv_err *err) {
  job *j = calloc(1, sizeof *j);
  if (j) j->rows = calloc((size_t)t->n_scenes * N_MODES * TABLES_N_DEVICES, sizeof *j->rows);
  if (!j || !j->rows) {
    free(j);
    return sv_fail(err, SV_E_NOMEM, "no memory for the runs");
  }
  j->t = t;
  if (t->o->threads > 0) snprintf(j->threads, sizeof j->threads, "%ld", t->o->threads);
  for (int i = 0; i < t->n_scenes; i++)
    for (int m = 0; m < N_MODES; m++)
      for (int d = 0; d < N_DEVICES; d++)
        if (t->scenes[i].of[devices[d]].n)
          j->rows[j->n++] = (row){.i_scene = i, .device = devices[d], .mode = m};
  sv_status s = SV_OK;
  for (j->i_now = 0; j->i_now < j->n && s == SV_OK; j->i_now++) s = measure(j, &j->rows[j->i_now], err);
  bool has_pictures = false;
  if (s == SV_OK) s = write_file(j, "dynamic.csv", true, false, err);
  if (s == SV_OK) s = write_plots(j, &has_pictures, err);
  if (s == SV_OK) s = write_file(j, "tables.md", false, has_pictures, err);
  *n_runs = j->n;
  free(j->rows);
  free(j);
  return s;
}
