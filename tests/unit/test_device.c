// SPDX-License-Identifier: Apache-2.0
// Devices: what is asked for is what is built, for any grid, overlap, sensor and angle.
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/mathx.h"
#include "src/base/str.h"
#include "src/rig/device.h"
#include "tests/common/test.h"

static sv_sub_view sub_views[SV_CAP_SUB_VIEWS];

static sv_rig empty_rig(void) {
  memset(sub_views, 0xa5, sizeof sub_views);
  return (sv_rig){.cap_sub_views = SV_CAP_SUB_VIEWS, .sub_views = sub_views};
}

static sv_device_params params(sv_device_id id, int w, int h) {
  sv_device_params p = sv_device_defaults(id);
  p.width_px = w;
  p.height_px = h;
  p.focal_per_width = 1.3;
  p.distance_m = 4;
  return p;
}

static sv_rig build(const sv_device_params *p) {
  sv_rig rig = empty_rig();
  sv_err err = {0};
  assert_ok(sv_device_build(&rig, p, &err), &err);
  assert_int_equal(rig.n_sub_views, sv_device_n_sub_views(p));
  return rig;
}

static double baseline_deg(const sv_rig *rig, const sv_device_params *p) {
  double centre[3] = {0, 0, p->distance_m};
  return sv_rig_angular_baseline_rad(rig, centre) * 180 / SV_PI;
}

TEST(test_angular_baseline_is_the_asked_one) {
  static const double angles_deg[] = {0.2, 0.5, 1, 5, 10, 60, 90};
  static const int grids[][2] = {{4, 4}, {1, 2}, {5, 1}, {3, 7}, {9, 9}, {16, 16}, {2, 128}};
  for (int id = 0; id < SV_N_DEVICES; id++)
    for (size_t a = 0; a < sizeof angles_deg / sizeof *angles_deg; a++)
      for (size_t g = 0; g < sizeof grids / sizeof *grids; g++) {
        sv_device_params p = params((sv_device_id)id, 1280, 960);
        p.angle_rad = angles_deg[a] * SV_PI / 180;
        if (sv_device_info_of(p.device)->layout == SV_LAYOUT_GRID) {
          p.rows = grids[g][0];
          p.cols = grids[g][1];
        }
        sv_rig rig = build(&p);
        double asked = rig.n_sub_views > 1 ? angles_deg[a] : 0;
        assert_true(fabs(baseline_deg(&rig, &p) - asked) < 1e-9);
      }
}

TEST(test_cameras_look_at_the_scene_from_one_distance) {
  for (int id = 0; id < SV_N_DEVICES; id++) {
    sv_device_params p = params((sv_device_id)id, 400, 300);
    p.distance_m = 2.5;
    sv_rig rig = build(&p);
    for (int i = 0; i < rig.n_sub_views; i++) {
      const sv_sub_view *v = &rig.sub_views[i];
      double centre[3] = {0, 0, 2.5}, x[3];
      sv_pose_apply(x, &v->cam_from_rig, centre);
      assert_true(fabs(x[0]) < 1e-12 && fabs(x[1]) < 1e-12 && fabs(x[2] - 2.5) < 1e-12);
      assert_true(sv_rotation_error(v->cam_from_rig.r) < 1e-12);
      assert_true(v->cam_from_rig.r[4] > 0.9); // upright
      for (int j = 0; j < i; j++) assert_string_not_equal(v->name, rig.sub_views[j].name);
    }
  }
}

TEST(test_phone) {
  sv_device_params p = params(SV_DEVICE_PHONE, 640, 480);
  sv_rig rig = build(&p);
  static const double zoom[3] = {1, 0.5, 3};
  double d[3][3];
  assert_int_equal(sv_device_n_cameras(SV_DEVICE_PHONE), 3);
  for (int i = 0; i < 3; i++) {
    assert_int_equal(rig.sub_views[i].i_camera, i);
    assert_true(fabs(rig.sub_views[i].model.p[0] - zoom[i] * 1.3 * 640) < 1e-9);
    sv_pose_centre(d[i], &rig.sub_views[i].cam_from_rig);
    d[i][2] -= 4;
  }
  for (int i = 0; i < 3; i++) // equilateral
    assert_true(fabs(sv_angle_between(d[i], d[(i + 1) % 3]) * 180 / SV_PI - 8) < 1e-9);
  assert_true(d[0][0] < 0 && d[1][0] > 0 && d[2][1] < 0); // wide left, ultrawide right, tele on top
}

// By painting every footprint: slow and plain.
static int painted_overlap(const sv_rig *rig, int w, int h, int *n_lit) {
  int *n = calloc((size_t)w * (size_t)h, sizeof *n), best = 0;
  *n_lit = 0;
  for (int i = 0; i < rig->n_sub_views; i++) {
    const sv_footprint *f = &rig->sub_views[i].footprint;
    assert_true(f->x0_px >= 0 && f->y0_px >= 0 && f->width_px > 0 && f->height_px > 0);
    assert_true(f->x0_px + f->width_px <= w && f->y0_px + f->height_px <= h);
    assert_int_equal(f->width_px, rig->sub_views[i].model.width_px);
    assert_int_equal(f->height_px, rig->sub_views[i].model.height_px);
    assert_null(f->coverage);
    for (int y = 0; y < f->height_px; y++)
      for (int x = 0; x < f->width_px; x++) {
        int *at = &n[(f->y0_px + y) * w + f->x0_px + x];
        *n_lit += *at == 0;
        best = sv_maxi(best, ++*at);
      }
  }
  free(n);
  return best;
}

TEST(test_footprints) {
  static const struct {
    int rows, cols, w, h;
    double overlap;
    int max_overlap; // by hand
  } cases[] = {{4, 4, 400, 400, 1, 1},      {4, 4, 400, 400, 2, 4},   {4, 4, 400, 400, 1.67, 4},
               {4, 4, 320, 240, 2, 4},      {4, 4, 401, 399, 3, 9},   {2, 2, 400, 300, 4, 4},
               {1, 6, 600, 80, 2.5, 3},     {16, 16, 512, 512, 2, 4}, {9, 9, 512, 300, 1, 1},
               {3, 5, 333, 217, 1.0001, 1}, {3, 3, 64, 64, 16, 9},    {1, 1, 64, 48, 1, 1}};
  for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
    sv_device_params p = params(SV_DEVICE_MULTIPLEXED, cases[i].w, cases[i].h);
    p.rows = cases[i].rows;
    p.cols = cases[i].cols;
    p.overlap = cases[i].overlap;
    sv_rig rig = build(&p);
    int n_lit, painted = painted_overlap(&rig, p.width_px, p.height_px, &n_lit);
    assert_int_equal(painted, cases[i].max_overlap);
    assert_int_equal(sv_device_largest_overlap(&rig, 0), painted);
    assert_int_equal(sv_device_largest_overlap(&rig, 1), 0);
    // little of the sensor is idle
    const sv_footprint *last = &rig.sub_views[rig.n_sub_views - 1].footprint;
    assert_true(p.width_px - (last->x0_px + last->width_px) < p.cols + (int)p.overlap + 1);
    assert_true(p.height_px - (last->y0_px + last->height_px) < p.rows + (int)p.overlap + 1);
    if (p.overlap >= 1 && p.overlap == floor(p.overlap)) // no gaps
      assert_int_equal(n_lit, (last->x0_px + last->width_px) * (last->y0_px + last->height_px));
  }
  sv_device_params p = params(SV_DEVICE_LIGHTFIELD, 400, 400);
  sv_rig rig = build(&p);
  assert_int_equal(sv_device_largest_overlap(&rig, 0), 1);
  assert_int_equal(rig.sub_views[5].footprint.x0_px, 100);
  assert_int_equal(rig.sub_views[5].footprint.y0_px, 100);
  assert_string_equal(rig.sub_views[6].name, "v12");
  p = params(SV_DEVICE_STEREO, 400, 400);
  rig = build(&p);
  // cameras of their own have no footprints
  assert_int_equal(sv_device_largest_overlap(&rig, 0), 0);
}

static void assert_refused(sv_device_params p, const char *text) {
  sv_rig rig = empty_rig();
  sv_err err = {0};
  assert_true(sv_device_build(&rig, &p, &err) < 0);
  if (!strstr(err.text, text)) fail_msg("'%s' does not say '%s'", err.text, text);
}

TEST(test_what_cannot_be_built_is_refused) {
  sv_device_params good = params(SV_DEVICE_MULTIPLEXED, 400, 400), p;
  p = good;
  p.rows = 17;
  p.cols = 16;
  assert_refused(p, "17x16 lenses");
  p = good;
  p.rows = 0;
  assert_refused(p, "0x4 lenses");
  p = good;
  p.rows = p.cols = 1 << 16;
  assert_refused(p, "lenses");
  p = good;
  p.overlap = 0.5;
  assert_refused(p, "overlap of 0.5");
  p = good;
  p.overlap = NAN;
  assert_refused(p, "overlap");
  p = good;
  p.angle_rad = 0;
  assert_refused(p, "expected more than 0");
  p = good;
  p.angle_rad = NAN;
  assert_refused(p, "expected more than 0");
  p = good;
  p.angle_rad = 2;
  assert_refused(p, "at most 90");
  p = good;
  p.width_px = 4;
  assert_refused(p, "do not fit on a sensor of 4x400");
  p = good;
  p.height_px = 0;
  assert_refused(p, "a sensor of 400x0");
  p = good;
  p.focal_per_width = 0;
  assert_refused(p, "focal length");
  p = good;
  p.distance_m = -1;
  assert_refused(p, "-1 m");
  p = good;
  p.device = SV_N_DEVICES;
  assert_refused(p, "no device 5");
  p = params(SV_DEVICE_LIGHTFIELD, 400, 400);
  p.overlap = 2;
  assert_refused(p, "side by side");
  p = params(SV_DEVICE_STEREO, 400, 400);
  p.cols = 2;
  assert_refused(p, "no grid");
  sv_rig rig = empty_rig();
  rig.cap_sub_views = 15;
  assert_int_equal(sv_device_build(&rig, &good, NULL), SV_E_RANGE);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_angular_baseline_is_the_asked_one),
      cmocka_unit_test(test_cameras_look_at_the_scene_from_one_distance),
      cmocka_unit_test(test_phone),
      cmocka_unit_test(test_footprints),
      cmocka_unit_test(test_what_cannot_be_built_is_refused),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
