// SPDX-License-Identifier: Apache-2.0
// The paper's tables measured by our own runtime. Datasets are scanned (scan.c); the tables are
// laid out as rows that name the runs they average over (plan.c); the runs are lines of shell
// (run.c, jobs.c) whose results stay in OUT/runs (result.c); then rows are averaged and compared
// (rows.c) and written as Markdown, CSV, plots and contact sheets.
#ifndef SV_TOOLS_TABLES_TABLES_H
#define SV_TOOLS_TABLES_TABLES_H

#include <stdio.h>

#include "tools/lab/lab.h"

#define TABLES_CAP_SCENES   96
#define TABLES_CAP_FILES    24  // angular baselines of one device
#define TABLES_CAP_NAME     48  // of a scene
#define TABLES_CAP_KEY      160 // a run's folder
#define TABLES_CAP_SETTINGS (3 * SV_TRANSFORMS_CAP_PATH)
#define TABLES_THETA_DEG    10 // of the paper's tables
// times as many Gaussians in the comparison of counts, as in the paper
#define TABLES_MANY 5

// TABLES_RIG: all cameras of a recording of one's own; only tables of real cameras have it.
enum {
  TABLES_MONO,
  TABLES_PHONE,
  TABLES_STEREO,
  TABLES_LIGHTFIELD,
  TABLES_MULTIPLEXED,
  TABLES_RIG,
  TABLES_N_DEVICES
};
enum { TABLES_NEAR, TABLES_TEST, TABLES_N_SPLITS };
enum { TABLES_PSNR, TABLES_SSIM, TABLES_LPIPS, TABLES_ABS_REL, TABLES_RMSE, TABLES_N_FIGURES };

extern const char *const tables_device_names[TABLES_N_DEVICES]; // as in file names
extern const char *const tables_device_words[TABLES_N_DEVICES]; // as in sentences
extern const char *const tables_split_names[TABLES_N_SPLITS];
extern const char *const tables_figure_words[TABLES_N_FIGURES];

typedef struct {
  double of[TABLES_N_FIGURES]; // NAN: not known
} tables_figures;

// --- datasets (scan.c) --------------------------------------------------------------------
// Kinds of scenes, each with tables of its own: five devices and true depth; one exposure of real
// cameras; videos of real cameras; moving scenes; one sensor without held-out views.
typedef enum {
  TABLES_SYNTHETIC,
  TABLES_STATIC,
  TABLES_CASUAL,
  TABLES_DYNAMIC,
  TABLES_SENSOR,
  TABLES_N_KINDS
} tables_kind;
extern const char *const tables_kind_names[TABLES_N_KINDS];

typedef struct {
  char transforms[SV_TRANSFORMS_CAP_PATH];
  double theta_deg; // below 0: the name does not say
  int n_only;       // it is for runs of so many exposures (_Nviews in its name); 0: for all
  int n_exposures;
  uint64_t digest; // of the file
} tables_file;

typedef struct {
  tables_file files[TABLES_CAP_FILES]; // by angle
  // n 0: the dataset has no such device; i_main: that of the tables
  int n, i_main;
} tables_capture;

typedef struct {
  char folder[SV_CAP_PATH]; // without links
  char name[TABLES_CAP_NAME];
  int n_views[TABLES_N_SPLITS], width_px, height_px; // held out
  bool has_depth;
  tables_kind kind;
  // of names KIND_SCENE_CAPTURE: the scene, and what it was recorded with
  char subject[TABLES_CAP_NAME], capture[16];
  uint64_t digest; // of a held-out image of each split
  tables_capture of[TABLES_N_DEVICES];
} tables_scene;

// --- runs ----------------------------------------------------------------------------------------
typedef struct {
  int i_scene, device, i_file, n_exposures;
  long n_gaussians;
  bool is_cube, is_tv_off;
} tables_setting;

typedef struct {
  tables_figures score[TABLES_N_SPLITS];
  double seconds, wall_s; // of the training; with loading and scoring
  double arena_bytes, peak_rss_bytes;
  long steps, gaussians;
  int threads;
  char isa[16], digest[24], build[24]; // build: digest of the program that made it
} tables_result;

typedef struct {
  tables_setting set;
  bool needs[TABLES_N_SPLITS];
  bool has_views; // renders the near views and keeps the model
  bool is_done, is_other_build;
  double cost; // seconds on a nominal machine
  char key[TABLES_CAP_KEY];
  tables_result result;
} tables_run;

// --- tables --------------------------------------------------------------------------------------
#define TABLES_CAP_ROW_RUNS (TABLES_CAP_SCENES * TABLES_N_DEVICES)
typedef struct {
  char label[96];  // what the row is about, beside device and exposures
  int device;      // -1: all of them
  int n_exposures; // in each run
  double x;        // of the curve: angle or number of exposures
  int split;
  int runs[TABLES_CAP_ROW_RUNS], n_runs; // averaged over; of one device in the order of the scenes
  bool has_paper;                        // its figures stand beside ours
} tables_row;

typedef enum {
  TABLE_SUMMARY,
  TABLE_DEPTH,
  TABLE_ANGLE,
  TABLE_EXPOSURES,
  TABLE_INIT,
  TABLE_TV,
  TABLE_COUNT,
  N_TABLES
} tables_id;

typedef struct {
  const char *name, *title; // name: of the CSV
  char text[600];           // below the title
  tables_row *rows;
  int n, cap;
} tables_table;

typedef struct {
  const lab_options *o;
  lab_session session;
  tables_scene *scenes; // [TABLES_CAP_SCENES]
  int n_scenes;
  long n_gaussians, n_steps, seed;
  long n_threads, n_jobs; // of each job; at a time
  tables_run *runs;
  int n_runs, cap_runs, n_missing; // missing: with --collect
  int n_all_runs, n_all_missing;   // of the kinds of scenes that are done
  char out[SV_CAP_PATH];           // --out, without links
  tables_table tables[N_TABLES];
  char program[SV_CAP_PATH], build[24]; // this program and its digest
} tables;

// FNV-1a, 64 bits; begin with TABLES_HASH.
#define TABLES_HASH 0xcbf29ce484222325u
uint64_t tables_hash(uint64_t h, const void *data, size_t bytes);
sv_status tables_hash_file(uint64_t *h, const char *path, sv_err *err) SV_MUST_USE;

// Finds the datasets' devices, angles and exposures; every file that a run will need is looked at.
// `list` is DIR[,DIR...]; a DIR that is no dataset stands for the datasets in it.
sv_status tables_scan(tables *t, const char *list, sv_err *err) SV_MUST_USE;

// --sub-views: makes datasets of the recordings of --data in OUT/data (sub_views.c), each for its
// first sub-view alone and for all of them; out is that folder.
sv_status tables_sub_views(tables *t, char out[SV_CAP_PATH], sv_err *err) SV_MUST_USE;

// Lays out all tables and the runs they need, each once.
sv_status tables_plan(tables *t, sv_err *err) SV_MUST_USE;
void tables_free(tables *t);
// "gears, light field, 10 degrees, 3 exposures, 20000 Gaussians"
void tables_describe(const tables *t, const tables_run *r, char *out, size_t cap);
// The file of a capture for runs of n exposures; -1: there is none.
int tables_main_file(const tables_capture *c, int n_exposures);
const tables_file *tables_file_of(const tables *t, const tables_setting *s);

// Makes the runs that have no result yet. E_INTERRUPTED when a stop was requested: what is done
// stays. With --plan only their lines are written, with --collect only results are read.
sv_status tables_run_all(tables *t, sv_err *err) SV_MUST_USE;

// The tables of moving scenes, instead of all others: OUT/tables.md, OUT/dynamic.csv and plots of
// PSNR in OUT/plots. What was run before is taken from OUT/runs.
sv_status tables_dynamic(tables *t, sv_err *err) SV_MUST_USE;
// Those of real cameras, static or casual: OUT/tables.md and OUT/real.csv (real.c).
sv_status tables_real(tables *t, sv_err *err) SV_MUST_USE;
// That of a sensor without held-out views: OUT/tables.md and OUT/sensor.csv (sensor.c).
sv_status tables_sensor(tables *t, sv_err *err) SV_MUST_USE;
// All jobs of a table that is not of tables_plan's form: with --plan their lines are written, with
// --collect nothing is run. look(of, f, &n_done) reads the finished runs, and writes the lines of
// the others to f unless it is NULL.
typedef sv_status tables_look_fn(void *of, FILE *f, int *n_done, sv_err *err);
sv_status tables_make_jobs(tables *t, tables_look_fn *look, void *of, int n, sv_err *err) SV_MUST_USE;

// Figures from what `train --json` and `eval --json` print. *wall_s is increased.
sv_status tables_result_train(tables_result *r, const char *text, sv_err *err) SV_MUST_USE;
sv_status tables_result_eval(tables_figures *f, double *wall_s, const char *text, sv_err *err) SV_MUST_USE;
sv_status tables_result_measured(double *psnr, const char *text, sv_err *err) SV_MUST_USE;
tables_result tables_no_result(void); // no figure is known

// --- averages (rows.c) --------------------------------------------------------------------
typedef struct {
  tables_figures figures;             // means; a figure that one run lacks is NAN
  double seconds, wall_s;             // means
  double arena_bytes, peak_rss_bytes; // largest
  long steps, gaussians;              // of the first run
} tables_mean;
tables_mean tables_row_mean(const tables *t, const tables_row *r);
// The paper's means for a device; NAN where it has none.
tables_figures tables_paper(int n_exposures, int device);
// Smallest and largest over its scenes, NAN for depth.
void tables_paper_range(int figure, int n_exposures, int device, double range[2]);
// The figure of the summary's run on one scene; NAN without it.
double tables_summary_figure(const tables *t, int i_scene, int device, int n_exposures, int figure);
void tables_format(char *out, size_t cap, int figure, double v); // "-" for NAN

// --- writers: files in OUT -----------------------------------------------------------------------
sv_status tables_write_csv(const tables *t, sv_err *err) SV_MUST_USE;
// Contact sheets OUT/sheet_SCENE.png: one near view of each scene, a row for each device.
sv_status tables_write_sheets(tables *t, sv_err *err) SV_MUST_USE;
// OUT/plots: scripts, and images when there is gnuplot; *has_pictures tells.
sv_status tables_write_plots(tables *t, bool *has_pictures, sv_err *err) SV_MUST_USE;
sv_status tables_write_markdown(const tables *t, bool has_plots, sv_err *err) SV_MUST_USE;

#endif
