// SPDX-License-Identifier: Apache-2.0
// Fisheye lenses as kernels take them, against the model in double precision.
#include <math.h>

#include "calib/fisheye.h"
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

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_lenses), cmocka_unit_test(test_range)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
