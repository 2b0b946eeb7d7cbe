// SPDX-License-Identifier: Apache-2.0
// Co-visibility by depth on planes whose shadows can be computed, and flow on pictures that were
// moved by known amounts.
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/mathx.h"
#include "src/base/rng.h"
#include "tests/common/test.h"
#include "tools/metric/covisible.h"
#include "tools/metric/flow.h"

enum { W = 120, H = 90 };

TEST(test_needed) {
  static const int want[][2] = {{1, 1}, {2, 2}, {4, 4}, {5, 3}, {16, 3}, {60, 3}, {61, 4}, {80, 4}, {100, 5}};
  for (size_t i = 0; i < sizeof want / sizeof *want; i++)
    assert_int_equal(sv_covisible_needed(want[i][0]), want[i][1]);
}

// --- depth ---------------------------------------------------------------------------------------

// at (x, 0, 0), looks along +z, turned to the right
static sv_view camera(double x, double turn_rad) {
  sv_pose p = sv_pose_identity();
  double c = sv_cos(turn_rad), s = sv_sin(turn_rad);
  p.r[0] = c;
  p.r[2] = -s;
  p.r[6] = s;
  p.r[8] = c;
  for (int i = 0; i < 3; i++) p.t[i] = -p.r[3 * i] * x;
  return sv_view_make(W, H, (const double[]){100, 100, W / 2.0, H / 2.0}, &p);
}

// A wall at z = 4 and before it, at z = 2, a board |x| < 0.2, |y| < 0.2 (when has_board), as a
// camera at cx sees them.
static void look(float *depth, double cx, bool has_board) {
  for (int i = 0; i < W * H; i++) {
    double x = cx + 2 * (i % W + 0.5 - W / 2.0) / 100, y = 2 * (i / W + 0.5 - H / 2.0) / 100;
    depth[i] = has_board && fabs(x) < 0.2 && fabs(y) < 0.2 ? 2 : 4;
  }
}

static float depth_a[W * H], depth_b[W * H], z[W * H];
static uint8_t seen[W * H];

TEST(test_depth_frustum) {
  sv_view a = camera(0, 0);
  sv_zbuffer zb = {.view = camera(1, 0), .z = z};
  memset(z, 0, sizeof z);
  look(depth_a, 0, false);
  sv_zbuffer_add(&zb, &a, depth_a);
  sv_covisible_test t = {.view = &a, .depth = depth_a};
  sv_covisible_by_depth(&t, &zb, seen);
  // 100 px * 1 / 4 leave on the left
  for (int i = 0; i < W * H; i++) assert_int_equal(seen[i], i % W >= 25);
}

TEST(test_depth_shadow) {
  // Seen from x = 0.8, the board stands before another part of the wall. Pixels that only one
  // camera sees, except at the edges, where splats are uncertain by a pixel.
  sv_view a = camera(0, 0), b = camera(0.8, 0);
  sv_zbuffer zb = {.view = b, .z = z};
  look(depth_a, 0, true);
  look(depth_b, 0.8, true);
  // what stands before b: known from b itself, or only from a
  for (int from_b = 0; from_b < 2; from_b++) {
    memset(z, 0, sizeof z);
    sv_zbuffer_add(&zb, from_b ? &b : &a, from_b ? depth_b : depth_a);
    sv_covisible_test t = {.view = &a, .depth = depth_a};
    sv_covisible_by_depth(&t, &zb, seen);
    int n_sure = 0, n_hidden = 0;
    for (int i = 0; i < W * H; i++) {
      double px = i % W + 0.5, py = i / W + 0.5, u = px - 100 * 0.8 / (double)depth_a[i];
      // b's ray at z = 2
      double x_board = 0.8 + 2 * (u - W / 2.0) / 100, y_board = 2 * (py - H / 2.0) / 100;
      // how far inside the board's outline
      double inside = fmin(0.2 - fabs(x_board), 0.2 - fabs(y_board));
      bool is_hidden = u < 0 || (depth_a[i] > 3 && inside > 0);
      bool is_edge = fabs(u) < 1 || (depth_a[i] > 3 && fabs(inside) < 0.051) || // 2.5 px
                     fabs(fabs((px - W / 2.0) / 50) - 0.2) < 0.051;
      if (is_edge) continue;
      n_sure++;
      n_hidden += is_hidden;
      if (seen[i] != !is_hidden) fail_msg("pixel %d, %d (from_b %d)", i % W, i / W, from_b);
    }
    assert_true(n_sure > W * H * 8 / 10 && n_hidden > 100 + 20 * H);
  }
}

TEST(test_depth_sky) {
  // Turned by atan(0.3), directions move by 30 px at the middle; without depth only what is marked
  // as sky is seen.
  static uint8_t sky[W * H];
  sv_view a = camera(0, 0);
  sv_zbuffer zb = {.view = camera(5, sv_atan2(0.3, 1)), .z = z};
  memset(z, 0, sizeof z);
  memset(depth_a, 0, sizeof depth_a);
  for (int i = 0; i < W * H; i++) sky[i] = i / W < H / 2;
  sv_covisible_test t = {.view = &a, .depth = depth_a, .is_sky = sky};
  sv_covisible_by_depth(&t, &zb, seen);
  for (int i = 0; i < W * H; i++) {
    double x = (i % W + 0.5 - W / 2.0) / 100, y = (i / W + 0.5 - H / 2.0) / 100;
    double u = 100 * (x - 0.3) / (1 + 0.3 * x) + W / 2.0, v = 100 * y * sqrt(1.09) / (1 + 0.3 * x) + H / 2.0;
    if (fabs(u) < 1e-3 || fabs(v) < 1e-3 || fabs(u - W) < 1e-3 || fabs(v - H) < 1e-3) continue;
    assert_int_equal(seen[i], sky[i] && u > 0 && v > 0 && u < W && v < H);
  }
  t.is_sky = NULL;
  sv_covisible_by_depth(&t, &zb, seen);
  for (int i = 0; i < W * H; i++) assert_int_equal(seen[i], 0);
}

// --- flow ----------------------------------------------------------------------------------------

// A smooth texture of several scales, the same wherever it is asked.
static double lattice(int x, int y, uint32_t seed) {
  return (double)(sv_hash3((uint32_t)x, (uint32_t)y, seed) >> 8) / 16777216.0;
}
static double texture(double x, double y, uint32_t seed) {
  double sum = 0;
  for (int octave = 0; octave < 3; octave++) {
    double s = 4 << octave, fx = floor(x / s), fy = floor(y / s), tx = x / s - fx, ty = y / s - fy;
    tx *= tx * (3 - 2 * tx);
    ty *= ty * (3 - 2 * ty);
    int ix = (int)fx, iy = (int)fy;
    uint32_t k = seed + (uint32_t)octave;
    double a = (1 - tx) * lattice(ix, iy, k) + tx * lattice(ix + 1, iy, k);
    double b = (1 - tx) * lattice(ix, iy + 1, k) + tx * lattice(ix + 1, iy + 1, k);
    sum += (1 - ty) * a + ty * b;
  }
  return 85 * sum;
}

static float grey[2][W * H], fw[2 * W * H], bw[2 * W * H];
static sv_flow_work work;

// Flow between both pictures of grey, there and back.
static void both(const double *there, const double *back) {
  sv_flow_pyramid a, b;
  assert_int_equal(sv_flow_pyramid_make(&a, grey[0], W, H), SV_OK);
  assert_int_equal(sv_flow_pyramid_make(&b, grey[1], W, H), SV_OK);
  assert_int_equal(sv_flow_dense(&a, &b, there, &work, fw), SV_OK);
  assert_int_equal(sv_flow_dense(&b, &a, back, &work, bw), SV_OK);
  sv_flow_pyramid_free(&a);
  sv_flow_pyramid_free(&b);
  sv_flow_check(&(sv_flow_field){fw, W, H}, &(sv_flow_field){bw, W, H}, 1, seen);
}

static void check_shift(double du, double dv, bool has_start) {
  const double there[9] = {1, 0, du + 3, 0, 1, dv - 2, 0, 0, 1},
               back[9] = {1, 0, -du - 3, 0, 1, -dv + 2, 0, 0, 1};
  for (int i = 0; i < W * H; i++) {
    grey[0][i] = (float)texture(i % W, i / W, 7);
    grey[1][i] = (float)texture(i % W - du, i / W - dv, 7);
  }
  both(has_start ? there : NULL, has_start ? back : NULL);
  int n = 0, n_good = 0, n_seen = 0, n_wrong = 0;
  for (int i = 0; i < W * H; i++) {
    double x = i % W + du, y = i / W + dv, e = fabs((double)fw[i] - du) + fabs((double)fw[W * H + i] - dv);
    if (x < 4 || y < 4 || x > W - 5 || y > H - 5) { // leaves the picture
      n_wrong += (x < -1 || y < -1 || x > W || y > H) && seen[i];
      continue;
    }
    n++;
    n_good += e < 0.15;
    n_seen += seen[i];
  }
  if (n_good < 0.97 * n || n_seen < 0.97 * n || n_wrong > 0.02 * W * H)
    fail_msg("shift %g, %g: %d of %d good, %d seen, %d wrongly seen", du, dv, n_good, n, n_seen, n_wrong);
}

TEST(test_flow_shift) {
  check_shift(0, 0, false);
  check_shift(2.3, -1.6, false);
  check_shift(-9.25, 6.5, false);
  check_shift(50, -20, true);
}

// A square in front moves by 12 px over a background at rest: what it covers in the second picture
// is gone there.
TEST(test_flow_occlusion) {
  for (int i = 0; i < W * H; i++) {
    int x = i % W, y = i / W;
    bool in_a = x >= 30 && x < 66 && y >= 25 && y < 65, in_b = x >= 42 && x < 78 && y >= 25 && y < 65;
    grey[0][i] = (float)(in_a ? texture(x, y, 50) : texture(x, y, 90));
    grey[1][i] = (float)(in_b ? texture(x - 12, y, 50) : texture(x, y, 90));
  }
  both(NULL, NULL);
  int n_gone = 0, n_gone_seen = 0, n_rest = 0, n_rest_seen = 0;
  for (int i = 0; i < W * H; i++) {
    int x = i % W, y = i / W;
    if (x >= 66 && x < 78 && y >= 25 && y < 65) {
      n_gone++;
      n_gone_seen += seen[i];
    } else if (x < 22 || x > 86 || y < 17 || y > 73 || (x > 38 && x < 58 && y > 33 && y < 57)) {
      n_rest++;
      n_rest_seen += seen[i];
    }
  }
  if (n_gone_seen > 0.25 * n_gone || n_rest_seen < 0.97 * n_rest)
    fail_msg("covered: %d of %d seen; elsewhere %d of %d", n_gone_seen, n_gone, n_rest_seen, n_rest);
}

TEST(test_check_threshold) {
  // fw = (u, 0), bw = (e - u, 0): kept while e^2 <= 0.01 (u^2 + (e - u)^2) + 0.5, in units of
  // `unit` pixels
  static const struct {
    double u, e, unit;
  } cases[] = {{0, 0.7, 1},  {0, 0.72, 1}, {10, 1.5, 1}, {10, 1.6, 1},
               {10, 1.3, 2}, {10, 1.5, 2}, {0, 0.36, 2}};
  for (size_t k = 0; k < sizeof cases / sizeof *cases; k++) {
    double u = cases[k].u, e = cases[k].e, q = cases[k].unit * cases[k].unit;
    memset(fw, 0, sizeof fw);
    memset(bw, 0, sizeof bw);
    for (int i = 0; i < W * H; i++) {
      fw[i] = (float)u;
      bw[i] = (float)(e - u);
    }
    sv_flow_check(&(sv_flow_field){fw, W, H}, &(sv_flow_field){bw, W, H}, cases[k].unit, seen);
    bool is_kept = q * e * e <= 0.01 * q * (u * u + (e - u) * (e - u)) + 0.5;
    for (int i = 0; i < W * H; i++) assert_int_equal(seen[i], is_kept && i % W + u <= W - 1);
  }
}

TEST(test_flow_sizes) {
  // Pictures of different size, no structure at all, the smallest that can be compared, and one
  // that is too small.
  static float flat[W * H];
  sv_flow_pyramid a, b, c;
  for (int i = 0; i < W * H; i++) {
    flat[i] = 40;
    grey[0][i] = (float)texture(i % W, i / W, 7);
  }
  assert_int_equal(sv_flow_pyramid_make(&a, flat, 16, 16), SV_OK);
  assert_int_equal(sv_flow_pyramid_make(&b, flat, 60, 45), SV_OK);
  assert_int_equal(sv_flow_pyramid_make(&c, flat, 15, 60), SV_E_RANGE);
  sv_flow_pyramid_free(&c);
  assert_int_equal(sv_flow_dense(&a, &b, NULL, &work, fw), SV_OK);
  for (int i = 0; i < 256; i++) { // flat: it stays where the sizes put it
    double want = (i % 16 + 0.5) * (60.0 / 16 - 1);
    assert_true(fabs((double)fw[i] - want) < 30 && fabsf(fw[256 + i]) < 30);
  }
  // a plane that passes through infinity
  const double horizon[9] = {1, 0, 0, 0, 1, 0, 0, 0.1, -0.4};
  assert_int_equal(sv_flow_pyramid_make(&c, grey[0], W, H), SV_OK);
  assert_int_equal(sv_flow_dense(&c, &b, horizon, &work, fw), SV_OK);
  for (int i = 0; i < 2 * W * H; i++) assert_true(fabsf(fw[i]) < 1e6f);
  sv_flow_pyramid_free(&a);
  sv_flow_pyramid_free(&b);
  sv_flow_pyramid_free(&c);
}

FIXTURE(teardown) {
  sv_flow_work_free(&work);
  return 0;
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_needed),          cmocka_unit_test(test_depth_frustum),
      cmocka_unit_test(test_depth_shadow),    cmocka_unit_test(test_depth_sky),
      cmocka_unit_test(test_flow_shift),      cmocka_unit_test(test_flow_occlusion),
      cmocka_unit_test(test_check_threshold), cmocka_unit_test(test_flow_sizes)};
  return cmocka_run_group_tests(tests, NULL, teardown);
}
