// SPDX-License-Identifier: Apache-2.0
// Rolling shutters: row times of lenses with distortion and of images on a shared sensor, and the
// motion of a rig from three of its poses.
#include <math.h>
#include <string.h>

#include "src/base/mathx.h"
#include "src/rig/rig.h"
#include "src/track/bundle.h"
#include "tests/common/test.h"

static const sv_camera_model LENSES[] = {
    {.kind = SV_MODEL_PINHOLE, .width_px = 320, .height_px = 240, .p = {300, 302, 155, 125}},
    {.kind = SV_MODEL_OPENCV4,
     .width_px = 320,
     .height_px = 240,
     .p = {300, 302, 155, 125, -0.25, 0.08, 1e-3, -2e-3}},
};

// The time of a pixel, as the sensor has it.
static double expected_s(const sv_row_time_cfg *c, const double uv[2]) {
  const double down = (uv[1] + c->y0_px) / c->sensor_height_px - 0.5,
               right = (uv[0] + c->x0_px) / c->sensor_width_px - 0.5, s = c->shutter.readout_s;
  switch (c->shutter.direction) {
  case SV_SHUTTER_DOWN: return s * down;
  case SV_SHUTTER_UP: return -s * down;
  case SV_SHUTTER_RIGHT: return s * right;
  default: return -s * right;
  }
}

TEST(test_row_time) {
  for (size_t lens = 0; lens < sizeof LENSES / sizeof *LENSES; lens++)
    for (int d = 0; d < SV_N_SHUTTERS; d++) {
      const sv_row_time_cfg c = {.shutter = {0.02, (sv_shutter_direction)d},
                                 .lens = &LENSES[lens],
                                 .x0_px = 320,
                                 .y0_px = 0,
                                 .sensor_width_px = 640,
                                 .sensor_height_px = 240,
                                 .half_x = 0.6,
                                 .half_y = 0.45};
      sv_row_time t;
      double worst = 0;
      assert_int_equal(sv_row_time_make(&t, &c), SV_OK);
      for (int i = 0; i < 320 * 240; i += 37) {
        const double uv[2] = {i % 320 + 0.5, i / 320 + 0.5}; // NOLINT
        double ray[3];
        assert_true(sv_model_unproject(c.lens, uv, ray));
        worst = fmax(worst, fabs(sv_row_time_at(&t, ray[0] / ray[2], ray[1] / ray[2]) - expected_s(&c, uv)));
      }
      print_message("%s, %s: off by at most %.2g of the readout\n", sv_model_name(c.lens->kind),
                    sv_shutter_name(c.shutter.direction), worst / 0.02);
      assert_true(worst < (lens ? 0.01 : 1e-9) * 0.02);
    }
}

TEST(test_global) {
  sv_row_time t;
  assert_int_equal(sv_row_time_make(&t, &(sv_row_time_cfg){.lens = &LENSES[0],
                                                           .sensor_width_px = 320,
                                                           .sensor_height_px = 240,
                                                           .half_x = 0.6,
                                                           .half_y = 0.45}),
                   SV_OK);
  assert_true(t.max_s == 0 && sv_row_time_at(&t, 0.3, 0.2) == 0);
}

// Far outside of the image, times stay near those of its ends.
TEST(test_outside) {
  sv_row_time t;
  assert_int_equal(sv_row_time_make(&t, &(sv_row_time_cfg){.shutter = {0.02, SV_SHUTTER_DOWN},
                                                           .lens = &LENSES[1],
                                                           .sensor_width_px = 320,
                                                           .sensor_height_px = 240,
                                                           .half_x = 0.6,
                                                           .half_y = 0.45}),
                   SV_OK);
  for (int i = 0; i < 100; i++) assert_true(fabs(sv_row_time_at(&t, 5 * sin(i), 9 * cos(i))) < 0.012);
  assert_true(sv_row_time_at(&t, 0, 0.4) > 0.008 && sv_row_time_at(&t, 0, -0.4) < -0.008);
}

static sv_pose pose_at(double s) {
  const double twist[6] = {
      0.3 * s + 0.4 * s * s, -0.2 * s + 0.1 * s * s, 0.1 * s, 0.5 * s - 0.3 * s * s, 0.2 * s,
      0.1 * s + 0.6 * s * s};
  sv_pose p = sv_pose_identity(), at;
  p.t[2] = 2;
  at = sv_pose_identity();
  sv_pose_twist(&at, twist);
  return sv_pose_mul(&at, &p);
}

// At the middle, at an end, and with one other pose alone.
TEST(test_motion) {
  static const double true_motion[6] = {0.3, -0.2, 0.1, 0.5, 0.2, 0.1};
  static const double times[3][2] = {{-0.05, 0.07}, {0.05, 0.09}, {0, -0.001}};
  for (int i = 0; i < 3; i++) {
    const sv_pose at = pose_at(0), a = pose_at(times[i][0]), b = pose_at(times[i][1]);
    double slope[2], m[6], back[6], x[3] = {0.3, -0.2, 1.5}, turn[9], moved[3], want[3];
    sv_motion_slopes(slope, times[i][0], times[i][1]);
    sv_motion_from(m, slope, &at, &a, &b);
    for (int k = 0; k < 6; k++) assert_near(m[k], true_motion[k], 2e-3);
    // What it does to a point, and the same motion seen by a camera of the rig.
    sv_pose camera = sv_pose_identity();
    sv_pose_twist(&camera, (const double[6]){0.4, 0.3, -0.2, 0.1, 0.7, -0.3});
    sv_motion_of_camera(back, m, &camera);
    sv_motion_apply(moved, m, 1e-4, x, turn);
    sv_pose_apply(want, &camera, moved);
    sv_pose_apply(x, &camera, (const double[3]){x[0], x[1], x[2]});
    sv_motion_apply(moved, back, 1e-4, x, turn);
    for (int k = 0; k < 3; k++) assert_near(moved[k], want[k], 1e-8);
  }
  double none[2];
  sv_motion_slopes(none, 0, 0);
  assert_true(none[0] == 0 && none[1] == 0);
}

TEST(test_names) {
  for (int d = 0; d < SV_N_SHUTTERS; d++)
    assert_int_equal(sv_shutter_by_name(sv_shutter_name((sv_shutter_direction)d)), d);
  assert_int_equal(sv_shutter_by_name("sideways"), -1);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_row_time), cmocka_unit_test(test_global), cmocka_unit_test(test_outside),
      cmocka_unit_test(test_motion),   cmocka_unit_test(test_names),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
