// SPDX-License-Identifier: Apache-2.0
// Camera models: Jacobians against central differences, project and unproject as inverses, the fold
// of wide lenses, and the undistortion table.
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "calib/model.h"
#include "calib/remap.h"
#include "src/base/rng.h"
#include "tests/common/test.h"

static const sv_camera_model lenses[] = {
    {SV_MODEL_PINHOLE, 640, 480, {500, 510, 321.5, 239.25}},
    {SV_MODEL_OPENCV4, 640, 480, {500, 510, 321.5, 239.25, -0.28, 0.07, 1e-3, -5e-4}},
    {SV_MODEL_OPENCV4,
     540,
     960,
     {687.76, 687.245, 277.279, 482.634, 0.0578421, -0.0805099, -0.00098, 0.000156}},
    {SV_MODEL_OPENCV5, 640, 480, {420, 421, 319, 241, -0.31, 0.12, 2e-4, 1e-4, -0.02}},
    {SV_MODEL_KB4, 800, 600, {310, 311, 402, 298, -0.02, 0.005, -0.002, 0.0003}},
    // a phone's ultra-wide (about 120 degrees across) as a rational model
    {SV_MODEL_OPENCV8,
     4000,
     3000,
     {1480, 1481, 1996, 1503, 0.55, -0.04, 2e-4, -1e-4, 0.004, 0.87, 0.02, 0.006}},
};
#define N_LENSES ((int)(sizeof lenses / sizeof *lenses))

TEST(test_names) {
  sv_model_kind k;
  for (int i = 0; i < SV_N_MODELS; i++) {
    assert_true(sv_model_by_name(sv_model_name((sv_model_kind)i), &k));
    assert_int_equal((int)k, i);
    assert_true(sv_model_n_params((sv_model_kind)i) >= 4);
  }
  assert_false(sv_model_by_name("LENSMODEL_CAHVOR", &k));
  assert_string_equal(sv_model_name((sv_model_kind)99), "?");
  sv_camera_model bad = {.kind = (sv_model_kind)99};
  double x[3] = {0, 0, 1}, uv[2];
  assert_false(sv_model_project(&bad, x, uv, NULL, NULL));
  assert_false(sv_model_unproject(&bad, uv, x));
}

static void check_jacobian(double analytic, double plus, double minus, double h) {
  double fd = (plus - minus) / (2 * h);
  if (!(fabs(analytic - fd) <= 2e-6 * (1 + fabs(fd))))
    fail_msg("Jacobian %.12g, differences %.12g", analytic, fd);
}

TEST(test_jacobians) {
  sv_rng rng = sv_rng_make(7, 1);
  for (int l = 0; l < N_LENSES; l++)
    for (int i = 0, n_seen = 0; n_seen < 50; i++) {
      assert_true(i < 5000);
      sv_camera_model m = lenses[l];
      int n = sv_model_n_params(m.kind);
      double x[3] = {2.4 * sv_rng_f(&rng) - 1.2, 2.4 * sv_rng_f(&rng) - 1.2, 1 + sv_rng_f(&rng)};
      double uv[2], a[2], b[2], dx[6], dp[2 * SV_CAP_MODEL_PARAMS];
      if (!sv_model_project(&m, x, uv, dx, dp)) continue;
      n_seen++;
      for (int k = 0; k < 3; k++) {
        double h = 1e-6, keep = x[k];
        x[k] = keep + h;
        bool ok = sv_model_project(&m, x, a, NULL, NULL);
        x[k] = keep - h;
        ok = ok && sv_model_project(&m, x, b, NULL, NULL);
        x[k] = keep;
        if (!ok) continue; // the very edge of the range
        for (int r = 0; r < 2; r++) check_jacobian(dx[r * 3 + k], a[r], b[r], h);
      }
      for (int k = 0; k < n; k++) {
        double h = 1e-6, keep = m.p[k];
        m.p[k] = keep + h;
        bool ok = sv_model_project(&m, x, a, NULL, NULL);
        m.p[k] = keep - h;
        ok = ok && sv_model_project(&m, x, b, NULL, NULL);
        m.p[k] = keep;
        if (!ok) continue;
        for (int r = 0; r < 2; r++) check_jacobian(dp[r * n + k], a[r], b[r], h);
      }
    }
}

TEST(test_round_trip) {
  for (int l = 0; l < N_LENSES; l++) {
    const sv_camera_model *m = &lenses[l];
    int n_seen = 0, n = 0;
    for (double v = 0.5; v < m->height_px; v += m->height_px / 37.0)
      for (double u = 0.5; u < m->width_px; u += m->width_px / 41.0) {
        double ray[3], uv[2], in[2] = {u, v};
        n++;
        if (!sv_model_unproject(m, in, ray)) continue;
        n_seen++;
        assert_true(fabs(ray[0] * ray[0] + ray[1] * ray[1] + ray[2] * ray[2] - 1) < 1e-14);
        assert_true(sv_model_project(m, ray, uv, NULL, NULL));
        assert_true(fabs(uv[0] - u) < 1e-9 && fabs(uv[1] - v) < 1e-9);
      }
    assert_int_equal(n_seen, n); // all these lenses see their whole image
  }
}

// k1 = -0.3 folds where 1 - 0.9 r^2 = 0: r = 1.0541, image radius 0.70273.
TEST(test_fold) {
  sv_camera_model m = {SV_MODEL_OPENCV4, 2000, 2000, {1000, 1000, 1000, 1000, -0.3, 0, 0, 0}};
  double r = sqrt(1 / 0.9), uv[2], ray[3], in[3] = {r * 0.9999, 0, 1}, out[3] = {r * 1.0001, 0, 1};
  assert_true(sv_model_project(&m, in, uv, NULL, NULL));
  assert_false(sv_model_project(&m, out, uv, NULL, NULL));
  out[0] = 1.7; // r c(r^2) = 0.226: lands in the middle of the picture, but no lens shows it there
  assert_false(sv_model_project(&m, out, uv, NULL, NULL));
  out[0] = 100; // beyond the second zero, where the polynomial is negative
  assert_false(sv_model_project(&m, out, uv, NULL, NULL));
  double edge = r * (1 - 0.3 * r * r) * 1000, in_uv[2] = {1000 + edge - 0.01, 1000},
         out_uv[2] = {1000 + edge + 0.01, 1000};
  assert_true(sv_model_unproject(&m, in_uv, ray));
  assert_true(ray[0] / ray[2] < r);
  assert_false(sv_model_unproject(&m, out_uv, ray));
  // A polynomial that falls and rises again: at r = 1.5 its slope is positive, but the way there is
  // not. slope 1 + 3 k1 s + 5 k2 s^2 with k1 = -0.5, k2 = 0.1: zero at s = 1 and s = 2
  sv_camera_model w = {SV_MODEL_OPENCV4, 2000, 2000, {1000, 1000, 1000, 1000, -0.5, 0.1, 0, 0}};
  double p[3] = {0.99, 0, 1};
  assert_true(sv_model_project(&w, p, uv, NULL, NULL));
  p[0] = 1.5;
  assert_false(sv_model_project(&w, p, uv, NULL, NULL));
  // A denominator with a pole at s = 0.5
  sv_camera_model q = {SV_MODEL_OPENCV8, 2000, 2000, {1000, 1000, 1000, 1000, 0, 0, 0, 0, 0, -2, 0, 0}};
  p[0] = 0.7;
  assert_true(sv_model_project(&q, p, uv, NULL, NULL));
  p[0] = 0.72;
  assert_false(sv_model_project(&q, p, uv, NULL, NULL));
}

TEST(test_wide) {
  const sv_camera_model *m = &lenses[N_LENSES - 1];
  double uv[2], ray[3], corner[2] = {0.5, 0.5};
  assert_true(sv_model_unproject(m, corner, ray));
  double deg = atan2(hypot(ray[0], ray[1]), ray[2]) * 57.29577951308232;
  assert_true(deg > 55 && deg < 80);
  double behind[3] = {0.1, 0, -1}, side[3] = {1, 0, 0}, nan3[3] = {NAN, 0, 1};
  for (int l = 0; l < N_LENSES; l++) {
    bool is_fisheye = lenses[l].kind == SV_MODEL_KB4; // sees to the side and behind
    if (!is_fisheye) assert_false(sv_model_project(&lenses[l], behind, uv, NULL, NULL));
    assert_true(sv_model_project(&lenses[l], side, uv, NULL, NULL) == is_fisheye);
    assert_false(sv_model_project(&lenses[l], nan3, uv, NULL, NULL));
    double bad[2] = {NAN, 1};
    assert_false(sv_model_unproject(&lenses[l], bad, ray));
  }
}

// Kannala and Brandt's model through libm; it sees more than a half sphere, to where d(t) turns.
TEST(test_kb4) {
  sv_camera_model m = {SV_MODEL_KB4, 2000, 2000, {600, 610, 1001, 999, 0.03, -0.01, 0.002, -0.0002}};
  double uv[2], ray[3];
  for (int i = 0; i < 500; i++) {
    double t = 2.2 * i / 500, a = 0.1 * i, x[3] = {sin(t) * cos(a) * 3, sin(t) * sin(a) * 3, cos(t) * 3};
    double d = t + m.p[4] * pow(t, 3) + m.p[5] * pow(t, 5) + m.p[6] * pow(t, 7) + m.p[7] * pow(t, 9);
    assert_true(sv_model_project(&m, x, uv, NULL, NULL));
    assert_true(fabs(uv[0] - (600 * d * cos(a) + 1001)) < 1e-9 &&
                fabs(uv[1] - (610 * d * sin(a) + 999)) < 1e-9);
    assert_true(sv_model_unproject(&m, uv, ray));
    for (int k = 0; k < 3; k++) assert_true(fabs(ray[k] - x[k] / 3) < 1e-10);
  }
  sv_camera_model turns = {SV_MODEL_KB4, 2000, 2000, {600, 600, 1000, 1000, -0.2, 0, 0, 0}};
  double edge = sqrt(1 / 0.6), in[3] = {sin(edge * 0.999), 0, cos(edge * 0.999)},
         out[3] = {sin(edge * 1.001), 0, cos(edge * 1.001)};
  assert_true(sv_model_project(&turns, in, uv, NULL, NULL));
  assert_false(sv_model_project(&turns, out, uv, NULL, NULL));
  double beyond[2] = {1000 + 600 * edge * (1 - 0.2 * edge * edge) + 1, 1000};
  assert_false(sv_model_unproject(&turns, beyond, ray));
  double back[3] = {0, 0, -1}, zero[3] = {0, 0, 0}, bad[2] = {NAN, 0};
  assert_false(sv_model_project(&m, back, uv, NULL, NULL));
  // d = t as far as 180 degrees
  sv_camera_model whole = {SV_MODEL_KB4, 2000, 2000, {300, 300, 1000, 1000}};
  // right behind: at the rim or nowhere, not in the middle
  for (double off = 1e-16; off < 1e-2; off *= 10) {
    double x[3] = {off, 0, -1};
    if (sv_model_project(&whole, x, uv, NULL, NULL))
      assert_true(fabs(uv[0] - (1000 + 300 * (M_PI - off))) < 1e-3);
  }
  assert_false(sv_model_project(&m, zero, uv, NULL, NULL));
  assert_false(sv_model_unproject(&m, bad, ray));
}

// A fisheye is undistorted by the same table as all others.
TEST(test_fisheye_view) {
  sv_camera_model m = {SV_MODEL_KB4, 160, 120, {60, 60, 80, 60, 0.01, 0, 0, 0}}, view;
  static sv_remap_tap e[160 * 120];
  sv_remap map;
  assert_true(sv_pinhole_for_model(&m, SV_PINHOLE_CROP_TO_VALID, &view));
  assert_int_equal(sv_remap_build(&map, &m, &view, e), SV_OK);
  assert_int_equal(map.n_outside, 0);
  double x[3] = {(20.5 - view.p[2]) / view.p[0], (30.5 - view.p[3]) / view.p[1], 1}, uv[2];
  assert_true(sv_model_project(&m, x, uv, NULL, NULL));
  const sv_remap_tap *t = &e[30 * 160 + 20];
  assert_true(fabs(t->x + t->fx / 256.0 + 0.5 - uv[0]) < 1.0 / 500);
  assert_true(fabs(t->y + t->fy / 256.0 + 0.5 - uv[1]) < 1.0 / 500);
}

TEST(test_pinhole_for_model) {
  sv_remap_tap *e = malloc(sizeof *e * 960 * 960);
  for (int l = 0; l < N_LENSES - 1; l++) {
    sv_camera_model v, z;
    sv_remap map;
    assert_true(sv_pinhole_for_model(&lenses[l], SV_PINHOLE_KEEP_FOCAL, &v));
    assert_int_equal((int)v.kind, SV_MODEL_PINHOLE);
    assert_true(v.p[0] == lenses[l].p[0] && v.p[3] == lenses[l].p[3] && v.width_px == lenses[l].width_px);
    assert_true(sv_pinhole_for_model(&lenses[l], SV_PINHOLE_CROP_TO_VALID, &z));
    assert_int_equal(sv_remap_build(&map, &lenses[l], &z, e), SV_OK);
    assert_int_equal(map.n_outside, 0);
    if (lenses[l].kind == SV_MODEL_PINHOLE || z.p[0] <= lenses[l].p[0] * 0.5) continue;
    z.p[0] *= 0.999;
    z.p[1] *= 0.999; // the crop is the widest: a little wider shows black
    assert_int_equal(sv_remap_build(&map, &lenses[l], &z, e), SV_OK);
    assert_true(map.n_outside > 0);
  }
  free(e);
}

TEST(test_remap) {
  enum { W = 64, H = 48 };
  static sv_remap_tap e[W * H];
  static uint8_t src[H][W * 3], dst[H][W][3], mask[H][W];
  for (int y = 0; y < H; y++)
    for (int x = 0; x < W; x++) {
      src[y][x * 3] = (uint8_t)(3 * x);
      src[y][x * 3 + 1] = (uint8_t)(4 * y);
      src[y][x * 3 + 2] = 77;
    }
  sv_camera_model pin = {SV_MODEL_PINHOLE, W, H, {50, 50, 32, 24}}, shifted = pin;
  sv_remap map;
  sv_remap_job job = {&src[0][0], W * 3, 3, &dst[0][0][0], &mask[0][0], 0, H};
  assert_int_equal(sv_remap_build(&map, &pin, &pin, e), SV_OK);
  sv_remap_apply(&map, &job);
  assert_memory_equal(dst, src, sizeof src); // identity is exact, borders included
  shifted.p[2] += 10.5;                      // the view's pixel i shows the source's i - 10.5
  assert_int_equal(sv_remap_build(&map, &pin, &shifted, e), SV_OK);
  sv_remap_apply(&map, &job);
  assert_int_equal(map.n_outside, 10 * H);
  for (int y = 0; y < H; y++)
    for (int x = 0; x < W; x++) {
      assert_int_equal(mask[y][x], x < 10 ? 0 : 255);
      double want = x < 10 ? 0 : x == 10 ? 0 : 3 * (x - 10.5);
      assert_true(fabs(dst[y][x][0] - want) <= 0.5);
      assert_int_equal(dst[y][x][2], x < 10 ? 0 : 77);
    }
  // against floating point through the lens, on a linear ramp
  sv_camera_model lens = {SV_MODEL_OPENCV4, W, H, {50, 50, 32, 24, -0.2, 0.02, 1e-3, 2e-3}};
  assert_int_equal(sv_remap_build(&map, &lens, &pin, e), SV_OK);
  sv_remap_apply(&map, &job);
  for (int y = 2; y < H - 2; y++)
    for (int x = 2; x < W - 2; x++) {
      double p[3] = {(x + 0.5 - 32) / 50, (y + 0.5 - 24) / 50, 1}, uv[2];
      assert_true(sv_model_project(&lens, p, uv, NULL, NULL));
      assert_true(fabs(dst[y][x][0] - 3 * (uv[0] - 0.5)) < 0.51);
      assert_true(fabs(dst[y][x][1] - 4 * (uv[1] - 0.5)) < 0.51);
    }
  assert_int_equal(sv_remap_build(&map, &pin, &lens, e), SV_E_ARG);
  pin.width_px = 40000;
  assert_int_equal(sv_remap_build(&map, &pin, &shifted, e), SV_E_RANGE);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_names),        cmocka_unit_test(test_jacobians),
      cmocka_unit_test(test_round_trip),   cmocka_unit_test(test_fold),
      cmocka_unit_test(test_wide),         cmocka_unit_test(test_kb4),
      cmocka_unit_test(test_fisheye_view), cmocka_unit_test(test_pinhole_for_model),
      cmocka_unit_test(test_remap)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
