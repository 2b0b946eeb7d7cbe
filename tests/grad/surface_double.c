// SPDX-License-Identifier: Apache-2.0
#include "tests/grad/surface_double.h"

#include <math.h>
#include <stdint.h>
#include <string.h>

#include "src/base/rng.h"
#include "src/loss/reproject.h"
#include "src/loss/smooth.h"
#include "tests/common/test.h"

static _Alignas(64) uint8_t block[1 << 20];

static void run_backwards(void *self, sv_task_fn fn, void *arg, int n_tasks) {
  (void)self;
  for (int i = n_tasks; i-- > 0;) fn(arg, i, i % 3);
}

// --- smoothness ----------------------------------------------------------------------------------

enum { SMOOTH_W = 9, SMOOTH_H = 37, SMOOTH_S = 16, SMOOTH_ROWS = 48, SMOOTH_N = SMOOTH_S * SMOOTH_ROWS };

static double inverse_of(const double *d, const double *t, int i) {
  const double alpha = 1 - t[i];
  return alpha >= 0.5 && d[i] > 0 ? alpha / d[i] : 0;
}

static double smooth_pair(const double *d, const double *t, const float *colour, double mean, int i, int j) {
  const double a = inverse_of(d, t, i), b = inverse_of(d, t, j), off = fabs(a - b);
  double contrast = 0;
  for (int c = 0; c < 3; c++)
    contrast += fabs((double)colour[c * SMOOTH_N + i] - (double)colour[c * SMOOTH_N + j]);
  return !(a > 0) || !(b > 0) || off > 0.05 * mean ? 0 : off / (1 + 10 * contrast);
}

// Of a given mean inverse depth, and the number of pixels that have one.
static double smooth_double(const double *d, const double *t, const float *colour, double mean, int n) {
  double sum = 0;
  for (int y = 0; y < SMOOTH_H; y++)
    for (int x = 0; x < SMOOTH_W; x++) {
      const int i = y * SMOOTH_S + x;
      if (x + 1 < SMOOTH_W) sum += smooth_pair(d, t, colour, mean, i, i + 1);
      if (y + 1 < SMOOTH_H) sum += smooth_pair(d, t, colour, mean, i, i + SMOOTH_S);
    }
  return 0.3 * sum / (mean * n);
}

static void check_smooth_gradient(double *v, const float *got, const char *what, const double *d,
                                  const double *t, const float *colour, double mean, int n) {
  const double step = 1e-7;
  for (int i = 0; i < SMOOTH_N; i++) {
    const double keep = v[i];
    if (i % SMOOTH_S >= SMOOTH_W || i / SMOOTH_S >= SMOOTH_H) {
      if (got[i] != 0) fail_msg("smooth: %s %g in the padding", what, (double)got[i]);
      continue;
    }
    v[i] = keep + step;
    const double plus = smooth_double(d, t, colour, mean, n);
    v[i] = keep - step;
    const double numeric = (plus - smooth_double(d, t, colour, mean, n)) / (2 * step);
    v[i] = keep;
    if (fabs(numeric - (double)got[i]) > 1e-6 + 1e-3 * fabs(numeric))
      fail_msg("smooth pixel %d: %s %.8g, numeric %.8g", i, what, (double)got[i], numeric);
  }
}

void check_smooth(void) {
  static float depth[SMOOTH_N], trans[SMOOTH_N], colour[3 * SMOOTH_N], again[2 * SMOOTH_N];
  static double d[SMOOTH_N], t[SMOOTH_N];
  double mean = 0;
  int n = 0;
  sv_arena a = sv_arena_make(block, sizeof block);
  sv_rng r = sv_rng_make(8, 1);
  sv_smooth s;
  const sv_pool serial = sv_pool_serial(), backwards = {NULL, 3, run_backwards};
  for (int i = 0; i < SMOOTH_N; i++) {
    const float inverse = 0.4f + 0.02f * sv_rng_f(&r) + (i % 11 == 0 ? 0.3f : 0.0f); // some edges
    trans[i] = i % 7 == 3 ? 0.6f : 0.3f * sv_rng_f(&r);                              // some holes
    depth[i] = (1 - trans[i]) / inverse;
    d[i] = (double)depth[i];
    t[i] = (double)trans[i];
    for (int c = 0; c < 3; c++) colour[c * SMOOTH_N + i] = sv_rng_f(&r);
    if (i % SMOOTH_S >= SMOOTH_W || i / SMOOTH_S >= SMOOTH_H) continue;
    mean += inverse_of(d, t, i);
    n += inverse_of(d, t, i) > 0;
  }
  mean /= n;
  const sv_smooth_input in = {.depth = depth,
                              .trans = trans,
                              .colour = {colour, colour + SMOOTH_N, colour + 2 * SMOOTH_N},
                              .width_px = SMOOTH_W,
                              .height_px = SMOOTH_H,
                              .stride = SMOOTH_S,
                              .rows_padded = SMOOTH_ROWS,
                              .alpha_min = 0.5f,
                              .weight = 0.3f};
  assert_int_equal(sv_smooth_init(&s, &(sv_smooth_cfg){SMOOTH_N, SMOOTH_H}, (sv_compute){NULL, &serial}, &a),
                   SV_OK);
  const double got = sv_smooth_loss(&s, &in), want = smooth_double(d, t, colour, mean, n);
  if (fabs(got - want) > 1e-4 * want) fail_msg("smooth: value %.9g, in double %.9g", got, want);
  check_smooth_gradient(d, s.g_depth, "dL/dD", d, t, colour, mean, n);
  check_smooth_gradient(t, s.g_trans, "dL/dT", d, t, colour, mean, n);
  memcpy(again, s.g_depth, sizeof again / 2);
  memcpy(again + SMOOTH_N, s.g_trans, sizeof again / 2);
  s.compute.pool = &backwards;
  assert_true(sv_smooth_loss(&s, &in) == got);
  assert_memory_equal(again, s.g_depth, sizeof again / 2);
  assert_memory_equal(again + SMOOTH_N, s.g_trans, sizeof again / 2);
  for (int i = 0; i < SMOOTH_N; i++) trans[i] = 1; // nothing to see
  assert_true(sv_smooth_loss(&s, &in) == 0 && s.g_depth[0] == 0 && s.g_trans[0] == 0);
}

// --- reprojection --------------------------------------------------------------------------------

enum { RE_W = 21, RE_H = 37, RE_S = 32, RE_ROWS = 48, RE_N = RE_S * RE_ROWS };

static uint8_t partner_px[RE_H][RE_W][4], partner_mask[RE_H][RE_W];
static const double partner_bg[3] = {0.2, 0.5, 0.7};

static double partner_value(int x, int y, int c) {
  const double alpha = partner_px[y][x][3] / 255.0;
  return alpha * partner_px[y][x][c] / 255.0 + (1 - alpha) * partner_bg[c];
}

// Where a pixel of this inverse depth lies in the partner, in pixel indices, and its depth there;
// false: outside.
static bool place_double(const sv_view *a, const sv_view *b, int x, int y, double inverse, double *u,
                         double *v, double *z) {
  const double ray[3] = {(x + 0.5 - (double)a->cx) / (double)a->fx, (y + 0.5 - (double)a->cy) / (double)a->fy,
                         1};
  double world[3], p[3];
  if (!(inverse > 0)) return false;
  for (int i = 0; i < 3; i++) {
    world[i] = 0;
    for (int k = 0; k < 3; k++) world[i] += (double)a->r[3 * k + i] * (ray[k] / inverse - (double)a->t[k]);
  }
  for (int i = 0; i < 3; i++) {
    p[i] = (double)b->t[i];
    for (int k = 0; k < 3; k++) p[i] += (double)b->r[3 * i + k] * world[k];
  }
  *u = (double)b->fx * p[0] / p[2] + (double)b->cx - 0.5;
  *v = (double)b->fy * p[1] / p[2] + (double)b->cy - 0.5;
  *z = p[2];
  return *u >= 0 && *v >= 0 && *u < RE_W - 1 && *v < RE_H - 1;
}

// The partner's color there; false under its mask.
static bool partner_at(double u, double v, double value[3]) {
  const int i = (int)u, k = (int)v;
  for (int c = 0; c < 3; c++) {
    value[c] = 0;
    for (int q = 0; q < 4; q++) {
      const int col = i + q % 2, row = k + q / 2;
      if (!partner_mask[row][col]) return false;
      value[c] += (q % 2 ? u - i : 1 - u + i) * (q / 2 ? v - k : 1 - v + k) * partner_value(col, row, c);
    }
  }
  return true;
}

// Summed differences of a pixel of this inverse depth; below 0: it does not count.
static double reproject_double(const sv_view *a, const sv_view *b, const float *colour, int x, int y,
                               double inverse) {
  double u, v, z, value[3], sum = 0;
  if (!place_double(a, b, x, y, inverse, &u, &v, &z) || !partner_at(u, v, value)) return -1;
  for (int c = 0; c < 3; c++) sum += fabs(value[c] - (double)colour[c * RE_N + y * RE_S + x]);
  return sum > 0.3 ? -1 : sum;
}

static const sv_view view = {RE_W, RE_H, 30, 31,  10.2f, 18.7f, {1, 0, 0, 0, 1, 0, 0, 0, 1}, {0.1f, 0, 0.2f},
                             0,    0,    0,  NULL};
static const sv_view partner = {
    RE_W, RE_H, 29, 32,  10.9f, 18.1f, {0.8f, 0, 0.6f, 0, 1, 0, -0.6f, 0, 0.8f}, {-1.7f, 0.05f, 0.9f},
    0,    0,    1,  NULL};
static float re_depth[RE_N], re_inverse[RE_N], re_colour[3 * RE_N];

static sv_reproject_input reproject_input(void) {
  static const sv_image_u8 image = {&partner_px[0][0][0], RE_W, RE_H, 4, 4 * RE_W, &partner_mask[0][0]};
  sv_rng r = sv_rng_make(5, 1);
  for (int y = 0; y < RE_H; y++)
    for (int x = 0; x < RE_W; x++) {
      for (int c = 0; c < 3; c++) partner_px[y][x][c] = (uint8_t)(100 + sv_rng_below(&r, 40));
      partner_px[y][x][3] = (uint8_t)(200 + sv_rng_below(&r, 56));
      partner_mask[y][x] = (x * 7 + y) % 13 != 0;
    }
  for (int i = 0; i < RE_N; i++) {
    re_inverse[i] = i % 9 == 4 ? 0 : 0.3f + 0.1f * sv_rng_f(&r);
    re_depth[i] = re_inverse[i] > 0 ? 0.9f / re_inverse[i] : 0;
    for (int c = 0; c < 3; c++) re_colour[c * RE_N + i] = 0.36f + 0.25f * sv_rng_f(&r);
  }
  return (sv_reproject_input){.inverse = re_inverse,
                              .depth = re_depth,
                              .colour = {re_colour, re_colour + RE_N, re_colour + 2 * RE_N},
                              .width_px = RE_W,
                              .height_px = RE_H,
                              .stride = RE_S,
                              .view = &view,
                              .partner = &partner,
                              .image = &image,
                              .bg = {0.2f, 0.5f, 0.7f},
                              .n_px = 500,
                              .phase = 1,
                              .weight = 0.3f};
}

static void check_depth(void) {
  static float g[2 * RE_N], again[2 * RE_N];
  const sv_reproject_input in = reproject_input();
  const sv_pool serial = sv_pool_serial(), backwards = {NULL, 3, run_backwards};
  double band[RE_H / SV_REPROJECT_BAND_ROWS + 1], want = 0;
  int n_counted = 0, n_compared = 0;
  const double got = sv_reproject_loss(&in, &serial, band, g, g + RE_N), per = 0.3 * 4 / (3.0 * 500);
  for (int y = 0; y < RE_H; y++)
    for (int x = 0; x < RE_W; x++) {
      const int at = y * RE_S + x;
      const double d = (double)re_inverse[at], step = 1e-5;
      const bool is_looked_at = (x + 2 * y) % 4 == 1;
      const double value = reproject_double(&view, &partner, re_colour, x, y, d);
      if (!is_looked_at || value < 0) {
        if (g[at] != 0 || g[RE_N + at] != 0)
          fail_msg("reproject: gradient of pixel %d, %d, which does not count", x, y);
        continue;
      }
      want += per * value;
      n_counted++;
      const double plus = reproject_double(&view, &partner, re_colour, x, y, d + step);
      const double minus = reproject_double(&view, &partner, re_colour, x, y, d - step);
      if (plus < 0 || minus < 0) continue;
      // Where both one-sided slopes agree there is no kink between them.
      if (fabs(plus - 2 * value + minus) > 0.02 * fabs(plus - minus)) continue;
      const double by_inverse = per * (plus - minus) / (2 * step);
      const double by_depth = -by_inverse * d / (double)re_depth[at],
                   by_trans = -by_inverse / (double)re_depth[at];
      n_compared++;
      if (fabs(by_depth - (double)g[at]) > 1e-5 + 0.02 * fabs(by_depth) ||
          fabs(by_trans - (double)g[RE_N + at]) > 1e-5 + 0.02 * fabs(by_trans))
        fail_msg("reproject %d, %d: dL/dD %.7g, dL/dT %.7g, numeric %.7g, %.7g", x, y, (double)g[at],
                 (double)g[RE_N + at], by_depth, by_trans);
    }
  if (fabs(got - want) > 1e-4 * want) fail_msg("reproject: value %.9g, in double %.9g", got, want);
  if (n_counted < 30 || n_compared < 20)
    fail_msg("reproject: %d pixels count, %d compared", n_counted, n_compared);
  assert_true(sv_reproject_loss(&in, &backwards, band, again, again + RE_N) == got);
  assert_memory_equal(g, again, sizeof g);
}

// Of colors: summed differences of a pixel with this change of one of them; below 0: it does not
// count.
static double colours_double(const float *partner_depth, int x, int y, int c_changed, double change) {
  const int at = y * RE_S + x;
  double u, v, z, value[3], off = 0, sum = 0;
  if (!place_double(&view, &partner, x, y, (double)re_inverse[at], &u, &v, &z)) return -1;
  if (!partner_at(u, v, value)) return -1;
  const double seen = (double)partner_depth[(int)(v + 0.5) * RE_S + (int)(u + 0.5)];
  if (!(seen > 0) || fabs(seen - z) > 0.05 * z) return -1;
  for (int c = 0; c < 3; c++) {
    const double d = fabs(value[c] - (double)re_colour[c * RE_N + at] - (c == c_changed ? change : 0));
    off += d;
    sum += d > 0.2 ? d - 0.1 : d * d / 0.4;
  }
  return off > 0.9 ? -1 : sum;
}

static void check_colours(void) {
  static float partner_depth[RE_N], g[3][RE_N], again[3][RE_N];
  float *const to[3] = {g[0], g[1], g[2]}, *const to_again[3] = {again[0], again[1], again[2]};
  const sv_reproject_input in = reproject_input();
  const sv_pool serial = sv_pool_serial(), backwards = {NULL, 3, run_backwards};
  const double per = 0.3 / (3.0 * 500), step = 1e-6;
  double band[RE_H / SV_REPROJECT_BAND_ROWS + 1], want = 0;
  int n_counted = 0, n_hidden = 0;
  // Some of what the view shows is behind what the partner sees.
  for (int y = 0; y < RE_H; y++)
    for (int x = 0; x < RE_W; x++) {
      double u, v, z;
      if (!place_double(&view, &partner, x, y, (double)re_inverse[y * RE_S + x], &u, &v, &z)) continue;
      partner_depth[(int)(v + 0.5) * RE_S + (int)(u + 0.5)] = (float)z * (x % 3 == 0 ? 0.9f : 1.02f);
    }
  const double got = sv_reproject_colours(&in, partner_depth, RE_S, &serial, band, to);
  for (int y = 0; y < RE_H; y++)
    for (int x = 0; x < RE_W; x++) {
      const double value = colours_double(partner_depth, x, y, 0, 0);
      double u, v, z;
      const bool is_inside =
          place_double(&view, &partner, x, y, (double)re_inverse[y * RE_S + x], &u, &v, &z);
      if (value >= 0) want += per * value;
      n_counted += value >= 0;
      n_hidden += is_inside && value < 0;
      for (int c = 0; c < 3; c++) {
        const double plus = colours_double(partner_depth, x, y, c, step);
        const double numeric =
            value < 0 ? 0 : per * (plus - colours_double(partner_depth, x, y, c, -step)) / (2 * step);
        if (fabs(numeric - (double)g[c][y * RE_S + x]) > 1e-3 * per)
          fail_msg("reproject %d, %d: dL/dC %.7g, numeric %.7g", x, y, (double)g[c][y * RE_S + x], numeric);
      }
    }
  if (fabs(got - want) > 1e-4 * want) fail_msg("colors: value %.9g, in double %.9g", got, want);
  if (n_counted < 60 || n_hidden < 20) fail_msg("colors: %d pixels count, %d do not", n_counted, n_hidden);
  assert_true(sv_reproject_colours(&in, partner_depth, RE_S, &backwards, band, to_again) == got);
  assert_memory_equal(g, again, sizeof g);
}

void check_reproject(void) {
  check_depth();
  check_colours();
}
