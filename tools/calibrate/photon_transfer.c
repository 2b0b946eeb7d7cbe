// SPDX-License-Identifier: Apache-2.0
#include "tools/calibrate/photon_transfer.h"

#include <math.h>
#include <string.h>

#define MAX_CLIPPED 1e-5 // share of a level's samples
#define MIN_FREEDOM 200  // of a level
#define MIN_LEVELS  4
#define N_ROUNDS    8   // weights follow the fit
#define MAX_SIGMA   0.2 // of shot noise, relative

static double linear_of(uint16_t code) {
  const double v = code / 65535.0;
  return v <= 0.04045 ? v / 12.92 : pow((v + 0.055) / 1.055, 2.4); // IEC 61966-2-1
}

void ptc_add(ptc *p, const uint16_t *a, const uint16_t *b, size_t n) {
  static const ptc_bin none;
  ptc_bin pair[PTC_BINS];
  double sum_d[PTC_BINS] = {0};
  for (int i = 0; i < PTC_BINS; i++) pair[i] = none;
  for (size_t i = 0; i < n; i++) {
    const double x = linear_of(a[i]), y = linear_of(b[i]), mean = 0.5 * (x + y), d = x - y;
    const int at = (int)fmin(PTC_BINS * sqrt(mean), PTC_BINS - 1);
    pair[at].n++;
    pair[at].n_clipped += a[i] == 0 || b[i] == 0 || a[i] == UINT16_MAX || b[i] == UINT16_MAX;
    pair[at].sum_x += mean;
    pair[at].sum_squares += d * d;
    sum_d[at] += d;
  }
  for (int i = 0; i < PTC_BINS; i++) {
    const ptc_bin *from = &pair[i];
    if (from->n < 2) continue;
    p->bin[i].n += from->n;
    p->bin[i].n_clipped += from->n_clipped;
    p->bin[i].sum_x += from->sum_x;
    p->bin[i].sum_squares += from->sum_squares - sum_d[i] * sum_d[i] / from->n; // light may flicker
    p->bin[i].freedom += from->n - 1;
  }
  p->n_pairs++;
}

typedef struct {
  double x, variance, freedom;
} level;

static int levels_of(const ptc *p, level *out) {
  int n = 0;
  for (int i = 0; i < PTC_BINS; i++) {
    const ptc_bin *b = &p->bin[i];
    if (b->freedom < MIN_FREEDOM || b->n_clipped > MAX_CLIPPED * b->n) continue;
    out[n++] = (level){b->sum_x / b->n, 0.5 * b->sum_squares / b->freedom, b->freedom};
  }
  return n;
}

// Weighted least squares. The variance of a variance v is 2 v^2 / freedom.
static void fit(const level *l, int n, bool has_read, ptc_result *r) {
  double read = 0, shot = 0;
  for (int round = 0; round < N_ROUNDS; round++) {
    double w = 0, wx = 0, wxx = 0, wy = 0, wxy = 0;
    for (int i = 0; i < n; i++) {
      const double v = round ? fmax(read + shot * l[i].x, 1e-3 * l[i].variance) : l[i].variance,
                   k = l[i].freedom / (2 * v * v + 1e-300);
      w += k;
      wx += k * l[i].x;
      wxx += k * l[i].x * l[i].x;
      wy += k * l[i].variance;
      wxy += k * l[i].x * l[i].variance;
    }
    const double det = w * wxx - wx * wx;
    shot = has_read ? (w * wxy - wx * wy) / det : wxy / wxx;
    read = has_read ? (wxx * wy - wx * wxy) / det : 0;
    r->sigma_shot = sqrt(has_read ? w / det : 1 / wxx);
    r->sigma_read = has_read ? sqrt(wxx / det) : 0;
  }
  r->noise = (sv_sensor_noise){read, shot};
}

sv_status ptc_solve(const ptc *p, ptc_result *out, sv_err *err) {
  level l[PTC_BINS];
  const int n = levels_of(p, l);
  *out = (ptc_result){.n_pairs = p->n_pairs, .n_levels = n};
  if (n < MIN_LEVELS)
    return sv_fail(err, SV_E_RANGE,
                   "%d levels of brightness without clipped pixels, expected %d: take flat frames at several "
                   "exposure times, two at each, or frames of a still scene with light and dark parts",
                   n, MIN_LEVELS);
  fit(l, n, true, out);
  if (out->noise.read < 0) fit(l, n, false, out); // too small to be told
  if (!(out->noise.shot > 0 && out->sigma_shot < MAX_SIGMA * out->noise.shot))
    return sv_fail(err, SV_E_RANGE,
                   "the noise does not grow with the light (%.3g +- %.3g): expected raw frames of a still "
                   "scene, neither denoised nor compressed",
                   out->noise.shot, out->sigma_shot);
  return SV_OK;
}
