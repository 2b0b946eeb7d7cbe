// SPDX-License-Identifier: Apache-2.0
// The camera models on board against libmrcal's projection: points, Jacobians, inverse.
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "calib/solve/project_mrcal.h"
#include "src/base/rng.h"
#include "src/format/cameramodel.h"
#include "tests/common/test.h"

static void need_mrcal(void) {
  if (sv_project_mrcal_available()) return;
  printf("skip  this build has no mrcal to compare with (libmrcal-dev)\n");
  skip();
}

// Differences below 1e-6 px in position; Jacobians to 1e-7 of their size.
static void compare(const sv_camera_model *m, const double x[3], int *n_seen) {
  static double duv_dp[2 * 4096];
  double uv[2], want[2], dx[6], want_dx[6], dp[2 * SV_CAP_MODEL_PARAMS];
  int n = sv_model_n_params(m->kind);
  if (!sv_model_project(m, x, uv, dx, dp)) return;
  int n_all = sv_project_mrcal(m, x, want, want_dx, duv_dp, 4096);
  assert_true(n_all >= n);
  (*n_seen)++;
  for (int k = 0; k < 2; k++)
    if (!(fabs(uv[k] - want[k]) < 1e-6))
      fail_msg("%s: %.9g, mrcal %.9g", sv_model_name(m->kind), uv[k], want[k]);
  for (int k = 0; k < 6; k++) assert_true(fabs(dx[k] - want_dx[k]) < 1e-7 * (1 + fabs(want_dx[k])));
  for (int a = 0; a < 2; a++)
    for (int k = 0; k < n; k++) {
      double d = dp[a * n + k] - duv_dp[a * n_all + k];
      assert_true(fabs(d) < 1e-7 * (1 + fabs(duv_dp[a * n_all + k])));
    }
  if (m->kind == SV_MODEL_SPLINED) { // the control points, too
    int i0[2];
    double w[16], sum = 0;
    assert_true(sv_spline_weights(m, x, i0, w));
    for (int j = 0, o = m->spline.order + 1; j < o; j++)
      for (int i = 0; i < o; i++) {
        int at = 4 + 2 * ((i0[1] + j) * m->spline.nx + i0[0] + i);
        for (int a = 0; a < 2; a++)
          assert_true(fabs(duv_dp[a * n_all + at + a] - m->p[a] * w[j * o + i]) < 1e-7);
        sum += w[j * o + i];
      }
    assert_true(fabs(sum - 1) < 1e-12);
  }
}

static void random_spline(sv_camera_model *m, double *control, sv_lens_spline s, sv_rng *rng) {
  *m = (sv_camera_model){SV_MODEL_SPLINED, 4000, 3000, {1500.5, 1510.25, 2010.25, 1490.5}};
  m->spline = s;
  m->spline.control = control;
  for (int i = 0; i < 2 * s.nx * s.ny; i++) control[i] = 0.02 * sv_rng_f(rng) - 0.01;
}

TEST(test_projection) {
  need_mrcal();
  static const sv_camera_model lenses[] = {
      {SV_MODEL_PINHOLE, 640, 480, {500, 510, 321.5, 239.25}},
      {SV_MODEL_OPENCV4, 640, 480, {500, 510, 321.5, 239.25, -0.28, 0.07, 1e-3, -5e-4}},
      {SV_MODEL_OPENCV5, 640, 480, {420, 421, 319, 241, -0.31, 0.12, 2e-4, 1e-4, -0.02}},
      {SV_MODEL_OPENCV8,
       4000,
       3000,
       {1480, 1481, 1996, 1503, 0.55, -0.04, 2e-4, -1e-4, 0.004, 0.87, 0.02, 0.006}}};
  sv_rng rng = sv_rng_make(11, 1);
  for (size_t l = 0; l < sizeof lenses / sizeof *lenses; l++) {
    int n_seen = 0;
    for (int i = 0; i < 2000; i++) {
      double x[3] = {2 * sv_rng_f(&rng) - 1, 2 * sv_rng_f(&rng) - 1, 0.8 + sv_rng_f(&rng)};
      compare(&lenses[l], x, &n_seen);
    }
    assert_true(n_seen > 1000);
  }
}

TEST(test_splined) {
  need_mrcal();
  static double control[2 * 30 * 18];
  sv_rng rng = sv_rng_make(12, 1);
  for (int order = 2; order <= 3; order++) {
    sv_camera_model m;
    int n_seen = 0, n_behind = 0;
    random_spline(&m, control, (sv_lens_spline){order, 30, 18, 220, NULL}, &rng);
    for (int i = 0; i < 4000; i++) {
      double x[3] = {2 * sv_rng_f(&rng) - 1, 1.2 * sv_rng_f(&rng) - 0.6, 1.6 * sv_rng_f(&rng) - 0.6}, uv[2],
             back[3];
      int before = n_seen;
      compare(&m, x, &n_seen);
      if (n_seen == before) continue;
      n_behind += x[2] < 0;
      assert_true(sv_model_project(&m, x, uv, NULL, NULL));
      assert_true(sv_model_unproject(&m, uv, back));
      double n = sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]);
      for (int k = 0; k < 3; k++) assert_true(fabs(back[k] - x[k] / n) < 1e-9);
    }
    assert_true(n_seen > 2000 && n_behind > 100);
  }
}

// A splined .cameramodel as mrcal reads it, written by ours and read back.
TEST(test_splined_file) {
  static double control[2 * 30 * 18];
  static char text[64 * 1024];
  static uint8_t block[64 * 1024];
  sv_rng rng = sv_rng_make(13, 1);
  sv_camera_model m, back;
  sv_pose p = sv_pose_identity(), q;
  sv_err err = {0};
  random_spline(&m, control, (sv_lens_spline){3, 30, 18, 150, NULL}, &rng);
  sv_str s = sv_str_make(text, sizeof text);
  assert_int_equal(sv_cameramodel_write(&s, &m, &p), SV_OK);
  sv_arena a = sv_arena_make(block, sizeof block);
  assert_ok(sv_cameramodel_read_splined(&(sv_file_data){"m", text, s.len}, &a, &back, &q, &err), &err);
  assert_true(back.spline.nx == 30 && back.spline.ny == 18 && back.spline.order == 3 &&
              back.spline.fov_x_deg == 150);
  for (int i = 0; i < 2 * 30 * 18; i++) assert_true(fabs(back.spline.control[i] - control[i]) < 1e-15);
  assert_memory_equal(back.p, m.p, 4 * sizeof(double));
  assert_int_equal(sv_cameramodel_read(&(sv_file_data){"m", text, s.len}, &back, &q, &err), SV_E_FORMAT);
  sv_arena tiny = sv_arena_make(block, 1000);
  assert_int_equal(sv_cameramodel_read_splined(&(sv_file_data){"m", text, s.len}, &tiny, &back, &q, &err),
                   SV_E_FORMAT);
  assert_contains(err.text, "memory");
  need_mrcal();
  assert_true(sv_project_mrcal_reads(text));
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_projection), cmocka_unit_test(test_splined),
                                     cmocka_unit_test(test_splined_file)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
