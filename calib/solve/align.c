// SPDX-License-Identifier: Apache-2.0
#include "calib/solve/align.h"

#include <math.h>
#include <string.h>

#define SIDE      (2 * SV_ALIGN_RADIUS_PX + 1)
#define N_PX      (SIDE * SIDE)
#define N         8 // unknowns: place 2, map 4, gain, offset
#define CAP_STEPS 30
#define N_PLACE   4    // first steps move the place only
#define SETTLED   2e-3 // pixels
#define CAP_STEP  3.0  // pixels that the place may move in one step
#define MIN_SLOPE 1e-9 // of a pivot to the largest: less is no structure

// Keys' cubic convolution (R. Keys 1981, a = -1/2).
static void weights(double f, double w[4]) {
  w[0] = ((-0.5 * f + 1) * f - 0.5) * f;
  w[1] = (1.5 * f - 2.5) * f * f + 1;
  w[2] = ((-1.5 * f + 2) * f + 0.5) * f;
  w[3] = (0.5 * f - 0.5) * f * f;
}

static bool sample(const sv_align_image *im, double x, double y, double *out) {
  double fx = floor(x), fy = floor(y), wx[4], wy[4], sum = 0;
  if (!(fx >= 1 && fy >= 1 && fx < im->width_px - 2 && fy < im->height_px - 2)) return false;
  weights(x - fx, wx);
  weights(y - fy, wy);
  const uint8_t *p = im->grey + ((size_t)fy - 1) * (size_t)im->width_px + (size_t)fx - 1;
  for (int j = 0; j < 4; j++, p += im->width_px)
    sum += wy[j] * (wx[0] * p[0] + wx[1] * p[1] + wx[2] * p[2] + wx[3] * p[3]);
  *out = sum;
  return true;
}

// The window of an image about uv through a map, with mean 0 and deviation 1 under the weights.
static bool window(const sv_align_image *im, const double uv[2], const double g[4], const double *w,
                   double *out) {
  double sum = 0, sq = 0;
  for (int i = 0; i < N_PX; i++) {
    double x = i % SIDE - SV_ALIGN_RADIUS_PX, y = i / SIDE - SV_ALIGN_RADIUS_PX;
    if (!sample(im, uv[0] + g[0] * x + g[1] * y, uv[1] + g[2] * x + g[3] * y, &out[i])) return false;
    sum += w[i] * out[i];
  }
  for (int i = 0; i < N_PX; i++) {
    out[i] -= sum;
    sq += w[i] * out[i] * out[i];
  }
  if (!(sq > 1)) return false; // less than a gray level: nothing but noise
  for (int i = 0; i < N_PX; i++) out[i] /= sqrt(sq);
  return true;
}

typedef struct {
  double w[N_PX], t[N_PX];       // weights, template
  double sd[N_PX][N];            // steepest descent images
  double h[N][N], h_place[N][N]; // Cholesky factors: of all, of place, gain and offset
} model;

static bool factor(double h[N][N]) {
  double most = 0;
  for (int j = 0; j < N; j++) most = fmax(most, h[j][j]);
  for (int j = 0; j < N; j++) {
    double d = h[j][j];
    for (int k = 0; k < j; k++) d -= h[j][k] * h[j][k];
    if (!(d > MIN_SLOPE * most)) return false;
    h[j][j] = sqrt(d);
    for (int i = j + 1; i < N; i++) {
      for (int k = 0; k < j; k++) h[i][j] -= h[i][k] * h[j][k];
      h[i][j] /= h[j][j];
    }
  }
  return true;
}

static void substitute(double h[N][N], double x[N]) {
  for (int i = 0; i < N; i++) {
    for (int k = 0; k < i; k++) x[i] -= h[i][k] * x[k];
    x[i] /= h[i][i];
  }
  for (int i = N; i-- > 0;) {
    for (int k = i + 1; k < N; k++) x[i] -= h[k][i] * x[k];
    x[i] /= h[i][i];
  }
}

static bool prepare(model *m, const sv_align_image *from, const double at[2]) {
  static const double one[4] = {1, 0, 0, 1};
  const double r = SV_ALIGN_RADIUS_PX, deviation = 0.5 * r;
  double sum = 0, px[2][N_PX];
  for (int i = 0; i < N_PX; i++) {
    double x = i % SIDE - r, y = i / SIDE - r;
    sum += m->w[i] = exp(-0.5 * (x * x + y * y) / (deviation * deviation));
  }
  for (int i = 0; i < N_PX; i++) m->w[i] /= sum;
  if (!window(from, at, one, m->w, m->t)) return false;
  // Slopes of the template in its own units: differences of windows half a pixel apart, before they
  // were evened out.
  for (int a = 0; a < 2; a++)
    for (int i = 0; i < N_PX; i++) {
      double lo, hi;
      double x = at[0] + i % SIDE - r;
      double y = at[1] + i / SIDE - r;
      double dx = a ? 0 : 0.5;
      double dy = a ? 0.5 : 0;
      if (!sample(from, x - dx, y - dy, &lo) || !sample(from, x + dx, y + dy, &hi)) return false;
      px[a][i] = hi - lo;
    }
  double mean = 0, sq = 0, v;
  for (int pass = 0; pass < 2; pass++) // the scale by which window() divided
    for (int i = 0; i < N_PX; i++) {
      if (!sample(from, at[0] + i % SIDE - r, at[1] + i / SIDE - r, &v)) return false;
      if (pass == 0) mean += m->w[i] * v;
      else sq += m->w[i] * (v - mean) * (v - mean);
    }
  for (int i = 0; i < N_PX; i++) {
    double x = i % SIDE - r, y = i / SIDE - r, gx = px[0][i] / sqrt(sq), gy = px[1][i] / sqrt(sq);
    // the map's unknowns are scaled by the radius, so that all slopes are alike
    double d[N] = {gx, gy, m->t[i], 1, gx * x / r, gx * y / r, gy * x / r, gy * y / r};
    memcpy(m->sd[i], d, sizeof d);
  }
  memset(m->h, 0, sizeof m->h);
  for (int i = 0; i < N_PX; i++)
    for (int a = 0; a < N; a++)
      for (int b = 0; b < N; b++) m->h[a][b] += m->w[i] * m->sd[i][a] * m->sd[i][b];
  memcpy(m->h_place, m->h, sizeof m->h);
  for (int a = 4; a < N; a++)
    for (int b = 0; b < N; b++) m->h_place[a][b] = m->h_place[b][a] = a == b;
  return factor(m->h) && factor(m->h_place);
}

// The map g and place uv after the step's inverse: d' = (I + A)^-1 (d - t).
static bool compose(const double step[N], double uv[2], double g[4]) {
  const double r = SV_ALIGN_RADIUS_PX;
  double a = 1 + step[4] / r, b = step[5] / r, c = step[6] / r, d = 1 + step[7] / r, det = a * d - b * c;
  if (!(det > 0.25)) return false;
  double m[4] = {d / det, -b / det, -c / det, a / det};
  double n[4] = {g[0] * m[0] + g[1] * m[2], g[0] * m[1] + g[1] * m[3], g[2] * m[0] + g[3] * m[2],
                 g[2] * m[1] + g[3] * m[3]};
  for (int k = 0; k < 2; k++) uv[k] -= n[2 * k] * step[0] + n[2 * k + 1] * step[1];
  memcpy(g, n, sizeof n);
  return true;
}

double sv_align_patch(const sv_align_image *from, const double at[2], const sv_align_image *to, double uv[2],
                      double warp[4]) {
  model m;
  double seen[N_PX], last = 0;
  if (!prepare(&m, from, at)) return -1;
  for (int it = 0; it < CAP_STEPS; it++) {
    double step[N] = {0}, correlation = 0;
    if (!window(to, uv, warp, m.w, seen)) return -1;
    for (int i = 0; i < N_PX; i++) {
      correlation += m.w[i] * seen[i] * m.t[i];
      for (int a = 0; a < N; a++) step[a] += m.w[i] * m.sd[i][a] * (seen[i] - m.t[i]);
    }
    for (int a = 4; a < N && it < N_PLACE; a++) step[a] = 0;
    substitute(it < N_PLACE ? m.h_place : m.h, step);
    last = hypot(step[0], step[1]);
    if (!(last < CAP_STEP) || !compose(step, uv, warp)) return -1;
    if (it >= N_PLACE && last < SETTLED) return correlation;
  }
  return -1;
}
