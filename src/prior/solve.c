// SPDX-License-Identifier: Apache-2.0
#include "src/prior/solve.h"

#include <math.h>

#include "src/base/mathx.h"
#include "src/prior/align.h"
#include "src/prior/methods.h"

#define CELLS       12     // of the correction, along each side: smooth over a sixth of the picture
#define FEW_SAMPLES 2.0f   // in a cell: the correction is halved there
#define MAD_SIGMA   1.48f  // median absolute deviation to a standard deviation
#define CAUCHY      2.4f   // standard deviations at which a weight is a half
#define TRUSTED     0.004f // relative spread of the residuals at which trust is a half

// --- samples -------------------------------------------------------------------------------------

int sv_prior_stride(const sv_prior_depth *d) {
  int step = 1, n_known = 0;
  for (int i = 0; i < d->width_px * d->height_px; i++) n_known += d->map[i] >= 0.0f;
  while (n_known / (step * step) > SV_PRIOR_SAMPLES) step++;
  return step;
}

float sv_prior_line_value(const sv_prior_depth *d, float map) {
  return d->kind == SV_PRIOR_ALIGNED && d->is_of_depth ? 1.0f / sv_maxf(map, 1e-6f) : map;
}

int sv_prior_add_sample(sv_prior_samples *s, const sv_prior_depth *d, int x, int y, float z) {
  const bool is_of_depth = d->kind == SV_PRIOR_RELATIVE || d->is_of_depth;
  if (s->n >= SV_PRIOR_SAMPLES) return -1;
  s->map[s->n] = sv_prior_line_value(d, d->map[(size_t)y * (size_t)d->width_px + (size_t)x]);
  s->low[s->n] = is_of_depth ? z : 1.0f / z;
  s->at[s->n][0] = (float)x / (float)d->width_px;
  s->at[s->n][1] = (float)y / (float)d->height_px;
  return s->n++;
}

// --- smooth correction ---------------------------------------------------------------------------

typedef struct { // values at the corners of cells
  float v[CELLS + 1][CELLS + 1];
} grid;

typedef struct { // of a place, 0 to 1 along both sides
  int i, j;
  float weight[4]; // of the corners (i, j), (i + 1, j), (i, j + 1), (i + 1, j + 1)
} place;

static place place_at(float x, float y) {
  const float u = x * CELLS, v = y * CELLS;
  const int i = sv_mini((int)u, CELLS - 1), j = sv_mini((int)v, CELLS - 1);
  const float a = u - (float)i, b = v - (float)j;
  return (place){i, j, {(1 - a) * (1 - b), a * (1 - b), (1 - a) * b, a * b}};
}

static void spread_to(grid *g, const place *p, float value) {
  for (int c = 0; c < 4; c++) g->v[p->j + c / 2][p->i + c % 2] += p->weight[c] * value;
}

static float value_of(const grid *g, const place *p) {
  float sum = 0.0f;
  for (int c = 0; c < 4; c++) sum += p->weight[c] * g->v[p->j + c / 2][p->i + c % 2];
  return sum;
}

// Binomial, along both sides; nothing lies outside.
static void blur(grid *g) {
  for (int axis = 0; axis < 2; axis++)
    for (int i = 0; i <= CELLS; i++) {
      float before = 0.0f;
      for (int j = 0; j <= CELLS; j++) {
        float *here = axis ? &g->v[j][i] : &g->v[i][j];
        const float next = j == CELLS ? 0.0f : axis ? g->v[j + 1][i] : g->v[i][j + 1], old = *here;
        *here = 0.25f * before + 0.5f * old + 0.25f * next;
        before = old;
      }
    }
}

// Weighted mean of the residuals around each corner, drawn to 0 where samples are few.
static void smooth_residuals(const sv_prior_samples *s, const float *residual, float sigma, grid *sum) {
  grid n = {0};
  *sum = (grid){0};
  for (int k = 0; k < s->n; k++) {
    const place p = place_at(s->at[k][0], s->at[k][1]);
    const float e = sigma > 0.0f ? residual[k] / (CAUCHY * sigma) : 0.0f, w = 1.0f / (1.0f + e * e);
    spread_to(sum, &p, w * residual[k]);
    spread_to(&n, &p, w);
  }
  for (int k = 0; k < 2; k++) {
    blur(sum);
    blur(&n);
  }
  for (int j = 0; j <= CELLS; j++)
    for (int i = 0; i <= CELLS; i++) sum->v[j][i] /= n.v[j][i] + FEW_SAMPLES;
}

static void correct(sv_prior_depth *d, const grid *g, float least) {
  for (int y = 0; y < d->height_px; y++)
    for (int x = 0; x < d->width_px; x++) {
      float *m = &d->map[(size_t)y * (size_t)d->width_px + (size_t)x];
      const place p = place_at((float)x / (float)d->width_px, (float)y / (float)d->height_px);
      if (*m >= 0.0f) *m = sv_maxf(*m + value_of(g, &p), least);
    }
}

// --- a map ---------------------------------------------------------------------------------------

void sv_prior_apply_line(sv_prior_depth *d, float scale, float shift, float least) {
  const bool is_of_depth = d->kind == SV_PRIOR_RELATIVE || d->is_of_depth;
  for (int i = 0; i < d->width_px * d->height_px; i++) {
    if (d->map[i] < 0.0f) continue;
    const float y = scale * sv_prior_line_value(d, d->map[i]) + shift;
    d->map[i] = is_of_depth ? 1.0f / sv_clampf(y, 1e-6f, 1.0f / least) : sv_maxf(y, least);
  }
  d->kind = SV_PRIOR_ALIGNED;
  d->is_of_depth = is_of_depth;
}

// Standard deviation of n residuals but for strays, by their median; sorts their magnitudes.
static float deviation(float *residual, int n) {
  for (int k = 0; k < n; k++) residual[k] = fabsf(residual[k]);
  sv_prior_sort(residual, n);
  return MAD_SIGMA * residual[n / 2];
}

bool sv_prior_solve(sv_prior_samples *s, sv_prior_depth *d, float least) {
  const sv_prior_fit f = {s->map, s->low, s->low, s->n};
  float *residual = s->work, *sorted = s->work + s->n;
  float scale, shift;
  grid g;
  if (!sv_prior_fit_line(&f, s->work, &scale, &shift)) return false;
  sv_prior_apply_line(d, scale, shift, least);
  for (int k = 0; k < s->n; k++) {
    const float y = scale * s->map[k] + shift;
    const float now = d->is_of_depth ? 1.0f / sv_clampf(y, 1e-6f, 1.0f / least) : sv_maxf(y, least);
    residual[k] = (d->is_of_depth ? 1.0f / s->low[k] : s->low[k]) - now;
    sorted[k] = residual[k];
  }
  smooth_residuals(s, residual, deviation(sorted, s->n), &g);
  correct(d, &g, least);
  for (int k = 0; k < s->n; k++) {
    const place p = place_at(s->at[k][0], s->at[k][1]);
    residual[k] -= value_of(&g, &p);
  }
  const float spread = deviation(residual, s->n) / (d->unit * TRUSTED);
  d->trust = 1.0f / (1.0f + spread * spread);
  return true;
}
