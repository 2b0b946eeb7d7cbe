// SPDX-License-Identifier: Apache-2.0
#include "src/train/appearance_matrix.h"

#include <string.h>

#include "src/base/cholesky.h"
#include "src/base/mathx.h"

#define N_ROUNDS 8
// Relative residuals from here on count less, in the first round and, halved each round, in the
// end: strong colors, which tell most, are far from what the gains alone predict.
#define FIRST_SPREAD 2.0
#define SPREAD       0.1
#define MIN_SEEN     64
#define LEAST        0.1 // of a value: less is no expectation
// Of a share of a row: it is 0 +- 0.1 before anything is seen; in observations, as in
// appearance_start.c.
#define PRIOR 0.1

// Light of what a view shows of a point, as camera 0 and the first exposure would show it but for
// the camera's matrix.
static void light_of(const sv_appearance_seen *s, const sv_appearance_view *v, double out[3]) {
  const double q = (double)s->r2, falloff = q * (v->f1 + q * v->f2);
  for (int k = 0; k < 3; k++) out[k] = sv_exp((double)s->log_value[k] - falloff - v->exposure[k]);
}

// Mean over the views of camera 0; false: none shows the point.
static bool reference_of(const sv_appearance_points *p, const sv_appearance_view *view,
                         const sv_appearance_seen *seen, double out[3]) {
  int n = 0;
  out[0] = out[1] = out[2] = 0;
  for (int k = 0; k < p->n_views; k++) {
    double x[3];
    if (seen[k].r2 < 0 || view[k].i_camera != 0) continue;
    light_of(&seen[k], &view[k], x);
    for (int c = 0; c < 3; c++) out[c] += x[c];
    n++;
  }
  for (int c = 0; c < 3 && n > 0; c++) out[c] /= n;
  return n > 0;
}

typedef struct {
  double a[9], b[3], x[3]; // of one row, as shares of its gain
  double sum_w, sum_we2;
  int n;
} row;

// One equation: gain (m . x) = y, relative to what is expected. (Relative to y, dark errors of y
// would count more than bright ones.)
static void add(row *r, const double x[3], double y, double gain, double spread) {
  const double expected = gain * (r->x[0] * x[0] + r->x[1] * x[1] + r->x[2] * x[2]);
  if (!(expected > LEAST * y)) return;
  const double e = y / expected - 1, q = e / spread, w = 1 / ((1 + q * q) * (1 + q * q));
  double h[3];
  for (int i = 0; i < 3; i++) h[i] = gain * x[i] / expected;
  for (int i = 0; i < 3; i++) {
    r->b[i] += w * h[i] * y / expected;
    for (int j = 0; j < 3; j++) r->a[3 * i + j] += w * h[i] * h[j];
  }
  r->sum_w += w;
  r->sum_we2 += w * e * e;
  r->n++;
}

static void begin_round(row *r, int channel) {
  memset(r->a, 0, sizeof r->a);
  memset(r->b, 0, sizeof r->b);
  r->sum_w = r->sum_we2 = 0;
  r->n = 0;
  for (int i = 0; i < 3; i++) r->a[4 * i] = i == channel ? 1e-9 : PRIOR;
}

static void sigma_of(const row *r, double gain, double sigma[3]) {
  for (int i = 0; i < 3; i++) {
    double unit[3] = {0};
    unit[i] = 1;
    sv_cholesky_solve(r->a, 3, unit);
    sigma[i] = gain * sqrt(SV_APPEARANCE_ALIKE * r->sum_we2 / r->sum_w * unit[i]);
  }
}

bool sv_appearance_matrix_solve(const sv_appearance_points *p, const sv_appearance_view *view, int i_camera,
                                const double gain[3], sv_appearance_matrix *out) {
  row rows[3] = {{.x = {1, 0, 0}}, {.x = {0, 1, 0}}, {.x = {0, 0, 1}}};
  double spread = FIRST_SPREAD;
  for (int round = 0; round < N_ROUNDS; round++, spread = sv_maxd(0.5 * spread, SPREAD)) {
    for (int c = 0; c < 3; c++) begin_round(&rows[c], c);
    for (int i = 0; i < p->n_points; i++) {
      const sv_appearance_seen *seen = p->seen + i * p->n_views;
      double x[3], y[3];
      if (!reference_of(p, view, seen, x)) continue;
      for (int k = 0; k < p->n_views; k++) {
        if (seen[k].r2 < 0 || view[k].i_camera != i_camera) continue;
        light_of(&seen[k], &view[k], y);
        for (int c = 0; c < 3; c++) add(&rows[c], x, y[c], gain[c], spread);
      }
    }
    if (rows[0].n < MIN_SEEN) return false;
    for (int c = 0; c < 3; c++) {
      if (!sv_cholesky(rows[c].a, 3)) return false;
      memcpy(rows[c].x, rows[c].b, sizeof rows[c].x);
      sv_cholesky_solve(rows[c].a, 3, rows[c].x);
    }
  }
  out->n = rows[0].n;
  for (int c = 0; c < 3; c++) {
    sigma_of(&rows[c], gain[c], out->sigma + 3 * c);
    for (int i = 0; i < 3; i++) out->m[3 * c + i] = gain[c] * rows[c].x[i];
  }
  return true;
}
