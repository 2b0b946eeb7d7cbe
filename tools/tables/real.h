// SPDX-License-Identifier: Apache-2.0
// Rows of the tables of real cameras: a scene's device, or its single camera, by one method. It
// owns nothing; it never trains.
#ifndef SV_TOOLS_TABLES_REAL_H
#define SV_TOOLS_TABLES_REAL_H

#include "tools/tables/tables.h"

typedef enum { TABLES_PLAIN, TABLES_FSGS, TABLES_SPARSEGS, TABLES_PRIOR, TABLES_N_METHODS } tables_method;
extern const char *const tables_method_words[TABLES_N_METHODS];

// Scores over the pixels that training views see: those of the device itself, or those that the
// device and its single camera both see.
enum { TABLES_OWN, TABLES_SHARED, TABLES_N_MASKS };
typedef struct {
  double coverage, of[3]; // PSNR, SSIM, LPIPS; NAN: not known
} tables_masked;

typedef struct {
  int i_scene, device; // device: TABLES_MONO or the capture's
  tables_method method;
  bool is_done;
  tables_figures whole; // of the held-out views
  tables_masked masked[TABLES_N_MASKS];
  tables_result train;
} tables_real_row;

typedef struct {
  tables *t;
  tables_real_row *rows;
  int n;
} tables_real_job;

// The device of a recording beside mono; -1: it has none.
int tables_capture_device(const tables_scene *sc);
// The paper's figure of a scene; over_scenes: the mean over its eight. NAN: it has none.
double tables_paper_real(const tables_scene *sc, int device, tables_method method, int figure,
                         bool over_scenes);
// Masked scores of what `eval --json` printed.
sv_status tables_result_masked(tables_masked m[TABLES_N_MASKS], const char *text, sv_err *err) SV_MUST_USE;

// OUT/tables.md, OUT/real.csv, OUT/plots.
sv_status tables_real_write(const tables_real_job *j, sv_err *err) SV_MUST_USE;

#endif
