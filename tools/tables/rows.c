// SPDX-License-Identifier: Apache-2.0
// Averages over runs, and the paper's figures to stand beside them.
#include <math.h>
#include <stdio.h>

#include "src/base/str.h"
#include "tools/tables/tables.h"

tables_mean tables_row_mean(const tables *t, const tables_row *r) {
  tables_mean m = {.steps = 0};
  for (int i = 0; i < r->n_runs; i++) {
    const tables_result *v = &t->runs[r->runs[i]].result;
    for (int f = 0; f < TABLES_N_FIGURES; f++) m.figures.of[f] += v->score[r->split].of[f] / r->n_runs;
    m.seconds += v->seconds / r->n_runs;
    m.wall_s += v->wall_s / r->n_runs;
    if (v->arena_bytes > m.arena_bytes) m.arena_bytes = v->arena_bytes;
    if (v->peak_rss_bytes > m.peak_rss_bytes) m.peak_rss_bytes = v->peak_rss_bytes;
    if (i == 0) {
      m.steps = v->steps;
      m.gaussians = v->gaussians;
    }
  }
  return m;
}

double tables_summary_figure(const tables *t, int i_scene, int device, int n_exposures, int figure) {
  const tables_table *b = &t->tables[TABLE_SUMMARY];
  for (int i = 0; i < b->n; i++) {
    const tables_row *r = &b->rows[i];
    if (r->device != device || r->n_exposures != n_exposures) continue;
    for (int k = 0; k < r->n_runs; k++)
      if (t->runs[r->runs[k]].set.i_scene == i_scene)
        return t->runs[r->runs[k]].result.score[r->split].of[figure];
  }
  return NAN;
}

void tables_format(char *out, size_t cap, int figure, double v) {
  static const int digits[TABLES_N_FIGURES] = {2, 3, 3, 4, 4};
  if (isnan(v)) sv_copy(out, cap, "-");
  else snprintf(out, cap, "%.*f", digits[figure], v);
}

// --- the paper -----------------------------------------------------------------------------------

typedef struct {
  int n_exposures, device;
  double of[3];
} paper_row;

static const paper_row paper_images[] = {
#define PAPER_SUMMARY(exposures, device, psnr, ssim, lpips) {exposures, TABLES_##device, {psnr, ssim, lpips}},
#include "tools/tables/paper_figures.inc"
};
static const paper_row paper_depths[] = {
#define PAPER_DEPTH(exposures, device, abs_rel, rmse) {exposures, TABLES_##device, {abs_rel, rmse, 0}},
#include "tools/tables/paper_figures.inc"
};
static const struct {
  int figure, n_exposures, device;
  double of[8];
} paper_scenes[] = {
#define PAPER_SCENE(figure, exposures, device, a, b, c, d, e, f, g, h)                                       \
  {TABLES_##figure, exposures, TABLES_##device, {a, b, c, d, e, f, g, h}},
#include "tools/tables/paper_figures.inc"
};
#define N_OF(array) (sizeof(array) / sizeof *(array))

tables_figures tables_paper(int n_exposures, int device) {
  tables_figures f = {{NAN, NAN, NAN, NAN, NAN}};
  for (size_t i = 0; i < N_OF(paper_images); i++)
    if (paper_images[i].n_exposures == n_exposures && paper_images[i].device == device)
      for (int k = 0; k < 3; k++) f.of[TABLES_PSNR + k] = paper_images[i].of[k];
  for (size_t i = 0; i < N_OF(paper_depths); i++)
    if (paper_depths[i].n_exposures == n_exposures && paper_depths[i].device == device)
      for (int k = 0; k < 2; k++) f.of[TABLES_ABS_REL + k] = paper_depths[i].of[k];
  return f;
}

void tables_paper_range(int figure, int n_exposures, int device, double range[2]) {
  range[0] = range[1] = NAN;
  for (size_t i = 0; i < N_OF(paper_scenes); i++) {
    if (paper_scenes[i].figure != figure || paper_scenes[i].n_exposures != n_exposures ||
        paper_scenes[i].device != device)
      continue;
    for (size_t k = 0; k < N_OF(paper_scenes[i].of); k++) {
      double v = paper_scenes[i].of[k];
      if (!(v >= range[0])) range[0] = v;
      if (!(v <= range[1])) range[1] = v;
    }
  }
}
