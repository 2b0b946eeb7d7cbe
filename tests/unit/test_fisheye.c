// SPDX-License-Identifier: Apache-2.0
// Fisheye lenses as kernels take them, against the model in double precision; views that stand for
// wide lenses of other models, with all of their field.
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "calib/lens_view.h"
#include "calib/remap.h"
#include "tests/common/test.h"

static sv_camera_model lens(double deg, const double k[4]) {
  const double f = 500 / (deg * M_PI / 360);
  return (sv_camera_model){SV_MODEL_KB4, 800, 600, {f, 1.02 * f, 401, 298, k[0], k[1], k[2], k[3]}};
}

static void check_lens(const sv_camera_model *m) {
  sv_fisheye f;
  int n_seen = 0;
  assert_true(sv_fisheye_make(&f, m));
  for (int i = 0; i <= 40; i++)
    for (int j = 0; j <= 30; j++) {
      const double uv[2] = {20.0 * i, 20.0 * j};
      const float xy[2] = {(float)((uv[0] - m->p[2]) / m->p[0]), (float)((uv[1] - m->p[3]) / m->p[1])};
      double ray[3];
      float got[3], at[2];
      if (!sv_model_unproject(m, uv, ray) || !sv_fisheye_unproject(&f, xy, got)) continue;
      n_seen++;
      const double off[3] = {ray[0] - (double)got[0], ray[1] - (double)got[1], ray[2] - (double)got[2]};
      assert_true(sqrt(off[0] * off[0] + off[1] * off[1] + off[2] * off[2]) * m->p[0] < 0.02);
      const float x[3] = {3 * got[0], 3 * got[1], 3 * got[2]};
      assert_true(sv_fisheye_project(&f, x, at));
      assert_true(fabs((double)(at[0] - xy[0])) * m->p[0] < 0.02 &&
                  fabs((double)(at[1] - xy[1])) * m->p[1] < 0.02);
    }
  assert_true(n_seen > 900);
}

TEST(test_lenses) {
  static const double k[][4] = {
      {0, 0, 0, 0}, {-0.02, 0.005, -0.002, 0.0003}, {0.05, 0.01, -0.003, 0.0003}, {-0.06, 0.0, 0.0, 0.0}};
  static const double deg[] = {60, 120, 150, 185, 200};
  for (int i = 0; i < 4; i++)
    for (int j = 0; j < 5; j++) {
      const sv_camera_model m = lens(deg[j], k[i]);
      check_lens(&m);
    }
}

TEST(test_range) {
  const double none[4] = {0}, folds[4] = {-0.1, 0, 0, 0};
  sv_camera_model m = lens(185, none);
  sv_fisheye f;
  float xy[2], ray[3];
  assert_true(sv_fisheye_make(&f, &m));
  const float behind[3] = {1e-3f, 0, -1}, on_axis[3] = {0, 0, 2}, axis_behind[3] = {0, 0, -1},
              far_off[2] = {3, 0};
  assert_true(sv_fisheye_project(&f, on_axis, xy));
  assert_true(xy[0] == 0 && xy[1] == 0);
  assert_false(sv_fisheye_project(&f, behind, xy));
  assert_false(sv_fisheye_project(&f, axis_behind, xy));
  assert_false(sv_fisheye_unproject(&f, far_off, ray));
  m = lens(200, folds); // what is close to the fold or beyond it is not seen
  assert_true(sv_fisheye_make(&f, &m));
  assert_true(2 * atan(sqrt((double)f.max_w)) < sqrt(1 / 0.3));
  m.kind = SV_MODEL_PINHOLE;
  assert_false(sv_fisheye_make(&f, &m));
}

// --- views of wide lenses ------------------------------------------------------------------------

#define W       160
#define H       120
#define N_KNOTS 14

// 170 degrees across the diagonal, bent unlike any polynomial of the angle.
static const sv_camera_model *splined(void) {
  static double control[N_KNOTS * N_KNOTS * 2];
  static sv_camera_model m;
  for (int j = 0; j < N_KNOTS; j++)
    for (int i = 0; i < N_KNOTS; i++) {
      double *c = control + 2 * (j * N_KNOTS + i);
      c[0] = 0.03 * sin(1.3 * i + 0.4 * j) - 0.012 * (i - 6.5);
      c[1] = 0.03 * cos(0.7 * i - 1.1 * j) - 0.012 * (j - 6.5);
    }
  m = (sv_camera_model){SV_MODEL_SPLINED, W, H, {62, 63, 82, 58}, {3, N_KNOTS, N_KNOTS, 200, control}};
  return &m;
}

// Each pixel of the view takes what the lens shows in the direction that the view has there; each
// pixel of the lens is in the view.
static void check_view(const sv_camera_model *m, double min_lit) {
  static sv_remap_tap entries[W * H];
  sv_lens_view v;
  sv_remap map;
  double worst_px = 0;
  int n_lit = 0, n_seen = 0, n_held = 0;
  assert_true(sv_lens_view_make(&v, m));
  assert_true(v.is_fisheye && v.is_remapped && v.model.kind == SV_MODEL_KB4);
  assert_int_equal(sv_remap_build(&map, m, &v.model, entries), SV_OK);
  for (int y = 0; y < H; y++)
    for (int x = 0; x < W; x++) {
      const sv_remap_tap *e = &entries[y * W + x];
      const double *p = v.model.p, place[2] = {x + 0.5, y + 0.5};
      const float xy[2] = {(float)((place[0] - p[2]) / p[0]), (float)((place[1] - p[3]) / p[1])};
      double uv[2], ray[3];
      float seen[3];
      if (sv_remap_counts(&map, NULL, x, y) && sv_fisheye_unproject(&v.fisheye, xy, seen)) {
        for (int k = 0; k < 3; k++) ray[k] = (double)seen[k];
        assert_true(sv_model_project(m, ray, uv, NULL, NULL));
        n_lit++;
        for (int k = 0; k < 2; k++) { // the outer half pixel takes the border's value
          const double at = k ? e->y + e->fy / 256.0 : e->x + e->fx / 256.0;
          worst_px = fmax(worst_px, fabs(fmin(fmax(uv[k] - 0.5, 0), (k ? H : W) - 1) - at));
        }
      }
      if (!sv_model_unproject(m, place, ray)) continue;
      n_seen++;
      n_held += sv_model_project(&v.model, ray, uv, NULL, NULL) && uv[0] >= 0 && uv[1] >= 0 && uv[0] <= W &&
                uv[1] <= H;
    }
  printf("  %s: off by %.4f px, %d of %d pixels of the lens are in the view, %.1f %% of the view is lit\n",
         sv_model_name(m->kind), worst_px, n_held, n_seen, 100.0 * n_lit / (W * H));
  assert_true(worst_px < 0.02);
  assert_true(n_held == n_seen && n_seen > W * H / 2);
  assert_true(n_lit > min_lit * W * H);
}

TEST(test_wide_views) {
  check_view(splined(), 0.9);
  const sv_camera_model barrel = {SV_MODEL_OPENCV8, W, H, {70, 70, 81, 59, 0.9, 0.05, 0, 0, 0, 1.1, 0.2, 0}};
  check_view(&barrel, 0.85);
  // No polynomial of degree 11 is near enough to this one.
  const sv_camera_model bent = {SV_MODEL_KB4, W, H, {66, 66, 80, 60, -0.346, 0.2, -0.0658, 0.00867}};
  sv_fisheye f;
  assert_false(sv_fisheye_make(&f, &bent));
  check_view(&bent, 0.8);
}

TEST(test_other_views) {
  sv_lens_view v;
  const sv_camera_model narrow = {SV_MODEL_OPENCV5, W, H, {130, 130, 80, 60, -0.2, 0.05}},
                        straight = {SV_MODEL_OPENCV4, W, H, {40, 40, 80, 60}},
                        fisheye = {SV_MODEL_KB4, W, H, {60, 60, 80, 60, -0.02, 0.005}};
  assert_true(sv_lens_view_make(&v, &narrow));
  assert_true(v.model.kind == SV_MODEL_PINHOLE && !v.is_fisheye && v.is_remapped);
  assert_true(sv_lens_view_make(&v, &straight));
  assert_true(v.model.kind == SV_MODEL_PINHOLE && !v.is_remapped && v.model.p[0] == 40);
  assert_true(sv_lens_view_make(&v, &fisheye));
  assert_true(v.is_fisheye && !v.is_remapped && memcmp(&v.model, &fisheye, sizeof fisheye) == 0);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_lenses), cmocka_unit_test(test_range),
                                     cmocka_unit_test(test_wide_views), cmocka_unit_test(test_other_views)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
