// SPDX-License-Identifier: Apache-2.0
// COLMAP readers, text and binary: the same scene in both, truncations, refusals.
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "src/format/bytes.h"
#include "src/format/colmap.h"
#include "tests/common/test.h"

static sv_err err;

static uint8_t bin[4096];
static size_t n_bin;
static void p32(uint32_t v) {
  sv_put_le32(bin + n_bin, v);
  n_bin += 4;
}
static void p64(uint64_t v) {
  sv_put_le64(bin + n_bin, v);
  n_bin += 8;
}
static void pd(double d) {
  uint64_t u;
  memcpy(&u, &d, 8);
  p64(u);
}
static void pstr(const char *s) {
  memcpy(bin + n_bin, s, strlen(s) + 1);
  n_bin += strlen(s) + 1;
}

static void check_cameras(sv_colmap *c) {
  sv_colmap_camera k;
  assert_int_equal(sv_colmap_next_camera(c, &k, &err), SV_OK);
  assert_true(k.id == 1 && k.model.kind == SV_MODEL_OPENCV4 && k.model.width_px == 640 &&
              k.model.height_px == 480);
  assert_true(k.model.p[0] == 500 && k.model.p[1] == 500 && k.model.p[2] == 320 && k.model.p[4] == 0.1 &&
              k.model.p[5] == 0);
  assert_int_equal(sv_colmap_next_camera(c, &k, &err), SV_OK);
  assert_true(k.id == 7 && k.model.kind == SV_MODEL_OPENCV8 && k.model.p[1] == 2 && k.model.p[11] == 12);
  assert_int_equal(sv_colmap_next_camera(c, &k, &err), SV_END);
}

TEST(test_cameras) {
  static const char text[] = "# Camera list\n\n1 SIMPLE_RADIAL 640 480 500 320 240 0.1\r\n"
                             "7 FULL_OPENCV 10 20 1 2 3 4 5 6 7 8 9 10 11 12\n";
  sv_colmap c;
  assert_int_equal(sv_colmap_open(&c, "cameras.txt", text, sizeof text - 1, false, &err), SV_OK);
  check_cameras(&c);
  n_bin = 0;
  p64(2);
  p32(1);
  p32(2);
  p64(640);
  p64(480);
  pd(500);
  pd(320);
  pd(240);
  pd(0.1);
  p32(7);
  p32(6);
  p64(10);
  p64(20);
  for (int i = 1; i <= 12; i++) pd(i);
  assert_int_equal(sv_colmap_open(&c, "cameras.bin", bin, n_bin, true, &err), SV_OK);
  check_cameras(&c);
}

static void check_images(sv_colmap *c) {
  sv_colmap_image k;
  assert_int_equal(sv_colmap_next_image(c, &k, &err), SV_OK);
  assert_true(k.id == 1 && k.camera_id == 7 && k.cam_from_world.t[2] == 3);
  assert_string_equal(k.name, "a b.jpg");
  double x[3], w[3] = {1, 0, 0}; // a quarter turn about z takes x to y
  sv_pose_apply(x, &k.cam_from_world, w);
  assert_true(fabs(x[0] - 1) < 1e-6 && fabs(x[1] - 3) < 1e-6 && fabs(x[2] - 3) < 1e-6);
  assert_int_equal(sv_colmap_next_image(c, &k, &err), SV_OK);
  assert_true(k.id == 2);
  assert_string_equal(k.name, "c.jpg");
  assert_int_equal(sv_colmap_next_image(c, &k, &err), SV_END);
}

TEST(test_images) {
  // the first image has no 2D points: its second line is empty and must not be passed over
  static const char text[] =
      "# Image list\n1 0.70710678 0 0 0.70710678 1 2 3 7 a b.jpg\n\n2 1 0 0 0 0 0 0 7 c.jpg\n1 2 -1 3 4 5\n";
  sv_colmap c;
  assert_int_equal(sv_colmap_open(&c, "images.txt", text, sizeof text - 1, false, &err), SV_OK);
  check_images(&c);
  n_bin = 0;
  p64(2);
  p32(1);
  pd(0.70710678);
  pd(0);
  pd(0);
  pd(0.70710678);
  pd(1);
  pd(2);
  pd(3);
  p32(7);
  pstr("a b.jpg");
  p64(0);
  p32(2);
  pd(1);
  pd(0);
  pd(0);
  pd(0);
  pd(0);
  pd(0);
  pd(0);
  p32(7);
  pstr("c.jpg");
  p64(1);
  pd(1);
  pd(2);
  p64(UINT64_MAX);
  assert_int_equal(sv_colmap_open(&c, "images.bin", bin, n_bin, true, &err), SV_OK);
  check_images(&c);
  for (size_t n = 0; n < n_bin; n++) { // every truncation is refused
    sv_colmap_image k;
    uint8_t *copy = malloc(n ? n : 1);
    memcpy(copy, bin, n);
    sv_status s = sv_colmap_open(&c, "images.bin", copy, n, true, &err);
    while (s == SV_OK) s = sv_colmap_next_image(&c, &k, &err);
    assert_int_equal(s, SV_E_FORMAT);
    free(copy);
  }
  assert_int_equal(sv_colmap_open(&c, "images.bin", bin, n_bin + 1, true, &err), SV_OK);
  sv_colmap_image k;
  sv_status s = SV_OK;
  while (s == SV_OK) s = sv_colmap_next_image(&c, &k, &err);
  assert_int_equal(s, SV_E_FORMAT);
}

static void check_points(sv_colmap *c) {
  sv_colmap_point k;
  assert_int_equal(sv_colmap_next_point(c, &k, &err), SV_OK);
  assert_true(k.id == 9 && k.xyz[1] == -2 && k.rgb[0] == 255 && k.rgb[2] == 3 && k.error_px == 0.5 &&
              k.n_track == 2);
  assert_int_equal(sv_colmap_next_point(c, &k, &err), SV_END);
}

TEST(test_points) {
  static const char text[] = "9 1 -2 3 255 2 3 0.5 1 2 3 4 \n";
  sv_colmap c;
  assert_int_equal(sv_colmap_open(&c, "points3D.txt", text, sizeof text - 1, false, &err), SV_OK);
  check_points(&c);
  n_bin = 0;
  p64(1);
  p64(9);
  pd(1);
  pd(-2);
  pd(3);
  bin[n_bin++] = 255;
  bin[n_bin++] = 2;
  bin[n_bin++] = 3;
  pd(0.5);
  p64(2);
  p32(1);
  p32(2);
  p32(3);
  p32(4);
  assert_int_equal(sv_colmap_open(&c, "points3D.bin", bin, n_bin, true, &err), SV_OK);
  check_points(&c);
}

static void check_frames(sv_colmap *c) {
  sv_colmap_frame f;
  assert_int_equal(sv_colmap_next_frame(c, &f, &err), SV_OK);
  assert_true(f.id == 1 && f.rig_id == 4 && f.n_images == 2 && f.rig_from_world.t[2] == 3);
  assert_true(f.images[0].camera_id == 1 && f.images[0].image_id == 11);
  assert_true(f.images[1].camera_id == 2 && f.images[1].image_id == 12);
  assert_int_equal(sv_colmap_next_frame(c, &f, &err), SV_OK);
  assert_true(f.id == 9 && f.n_images == 0);
  assert_int_equal(sv_colmap_next_frame(c, &f, &err), SV_END);
}

TEST(test_frames) {
  static const char text[] =
      "# Frame list\n1 4 1 0 0 0 1 2 3 3 CAMERA 1 11 IMU 7 5 CAMERA 2 12\n9 4 1 0 0 0 0 0 0 0\n";
  sv_colmap c;
  sv_colmap_frame f;
  assert_int_equal(sv_colmap_open(&c, "frames.txt", text, sizeof text - 1, false, &err), SV_OK);
  check_frames(&c);
  n_bin = 0;
  p64(2);
  p32(1);
  p32(4);
  pd(1);
  pd(0);
  pd(0);
  pd(0);
  pd(1);
  pd(2);
  pd(3);
  p32(3);
  p32(0);
  p32(1);
  p64(11);
  p32(1);
  p32(7);
  p64(5);
  p32(0);
  p32(2);
  p64(12);
  p32(9);
  p32(4);
  pd(1);
  pd(0);
  pd(0);
  pd(0);
  pd(0);
  pd(0);
  pd(0);
  p32(0);
  assert_int_equal(sv_colmap_open(&c, "frames.bin", bin, n_bin, true, &err), SV_OK);
  check_frames(&c);
  for (size_t n = 8; n < n_bin; n++) { // cut anywhere
    assert_int_equal(sv_colmap_open(&c, "frames.bin", bin, n, true, &err), SV_OK);
    sv_status s = SV_OK;
    for (int i = 0; i < 3 && s == SV_OK; i++) s = sv_colmap_next_frame(&c, &f, &err);
    assert_int_equal(s, SV_E_FORMAT);
  }
  static const char bad[] = "1 4 1 0 0 0 1 2 3 1 CAMERA 1\n";
  assert_int_equal(sv_colmap_open(&c, "frames.txt", bad, sizeof bad - 1, false, &err), SV_OK);
  assert_int_equal(sv_colmap_next_frame(&c, &f, &err), SV_E_FORMAT);
}

static void check_rigs(sv_colmap *c) {
  static sv_colmap_rig g;
  double x[3], at[3] = {1, 0, 0};
  assert_ok(sv_colmap_next_rig(c, &g, &err), &err);
  assert_true(g.id == 1 && g.n_cameras == 3);
  assert_true(g.cameras[0].camera_id == 5 && g.cameras[0].has_pose);
  sv_pose_apply(x, &g.cameras[0].cam_from_rig, at);
  assert_true(x[0] == 1 && x[1] == 0 && x[2] == 0);
  assert_true(g.cameras[1].camera_id == 2 && g.cameras[1].has_pose);
  sv_pose_apply(x, &g.cameras[1].cam_from_rig, at); // a quarter turn about z, then 1, 2, 3
  assert_true(fabs(x[0] - 1) < 1e-6 && fabs(x[1] - 3) < 1e-6 && fabs(x[2] - 3) < 1e-6);
  assert_true(g.cameras[2].camera_id == 3 && !g.cameras[2].has_pose);
  assert_int_equal(sv_colmap_next_rig(c, &g, &err), SV_OK);
  assert_true(g.id == 2 && g.n_cameras == 1 && g.cameras[0].camera_id == 4);
  assert_int_equal(sv_colmap_next_rig(c, &g, &err), SV_OK);
  assert_true(g.id == 7 && g.n_cameras == 0);
  assert_int_equal(sv_colmap_next_rig(c, &g, &err), SV_END);
}

TEST(test_rigs) {
  static const char text[] =
      "# Rig calib list\n1 4 CAMERA 5 CAMERA 2 1 0.70710678 0 0 0.70710678 1 2 3 IMU 2 0 CAMERA 3 0\n"
      "2 1 CAMERA 4\n7 0\n";
  sv_colmap c;
  assert_int_equal(sv_colmap_open(&c, "rigs.txt", text, sizeof text - 1, false, &err), SV_OK);
  check_rigs(&c);
  n_bin = 0;
  p64(3);
  p32(1);
  p32(4);
  p32(0);
  p32(5);
  p32(0);
  p32(2);
  bin[n_bin++] = 1;
  pd(0.70710678);
  pd(0);
  pd(0);
  pd(0.70710678);
  pd(1);
  pd(2);
  pd(3);
  p32(1);
  p32(2);
  bin[n_bin++] = 0;
  p32(0);
  p32(3);
  bin[n_bin++] = 0;
  p32(2);
  p32(1);
  p32(0);
  p32(4);
  p32(7);
  p32(0);
  assert_int_equal(sv_colmap_open(&c, "rigs.bin", bin, n_bin, true, &err), SV_OK);
  check_rigs(&c);
  for (size_t n = 8; n < n_bin; n++) { // cut anywhere
    static sv_colmap_rig g;
    uint8_t *copy = malloc(n);
    memcpy(copy, bin, n);
    sv_status s = sv_colmap_open(&c, "rigs.bin", copy, n, true, &err);
    for (int i = 0; i < 4 && s == SV_OK; i++) s = sv_colmap_next_rig(&c, &g, &err);
    free(copy);
    assert_int_equal(s, SV_E_FORMAT);
  }
}

TEST(test_refused) {
  static const struct {
    char kind;
    const char *text, *word;
    sv_status s;
  } cases[] = {
      {'c', "1 FOV 10 10 1 1 1 1 0", "FOV is not supported", SV_E_UNSUPPORTED},
      {'c', "1 WHAT 10 10 1", "WHAT", SV_E_UNSUPPORTED},
      {'c', "1 PINHOLE 10 10 1 1 1", "missing", SV_E_FORMAT},
      {'c', "1 PINHOLE 10 10 1 1 1 1 1", "too many", SV_E_FORMAT},
      {'c', "1 PINHOLE 10 0 1 1 1 1", "image size", SV_E_RANGE},
      {'c', "1 PINHOLE 10 10 0 1 1 1", "focal", SV_E_RANGE},
      {'c', "x PINHOLE 10 10 0 1 1 1", "cameras.txt:1: CAMERA_ID", SV_E_FORMAT},
      {'i', "1 1 0 0 0 0 0 0 1", "no name", SV_E_FORMAT},
      {'i', "1 2 0 0 0 0 0 0 1 a", "length 1", SV_E_RANGE},
      {'i', "1 1 0 0 0 0 0 0 x a", "IMAGE_ID", SV_E_FORMAT},
      {'r', "1 2 CAMERA 1", "SENSOR_TYPE SENSOR_ID HAS_POSE", SV_E_FORMAT},
      {'r', "1 1", "REF_SENSOR_TYPE", SV_E_FORMAT},
      {'r', "1 2 CAMERA 1 CAMERA 2 2", "HAS_POSE", SV_E_FORMAT},
      {'r', "1 2 CAMERA 1 CAMERA 2 1 1 0 0 0 0 0", "HAS_POSE", SV_E_FORMAT},
      {'r', "1 2 CAMERA 1 CAMERA 2 1 2 0 0 0 0 0 0", "length 1", SV_E_RANGE},
      {'r', "1 2 CAMERA 1 CAMERA 1 0", "twice", SV_E_FORMAT},
      {'r', "1 1 CAMERA 1 CAMERA 2 0", "more sensors", SV_E_FORMAT},
      {'p', "1 1 2 3 256 0 0 1", "POINT3D_ID", SV_E_FORMAT},
      {'p', "1 1 2 3 0 0 0 1 5", "pairs", SV_E_FORMAT},
      {'p', "1 1 2 1e99 0 0 0 1", "finite", SV_E_RANGE},
  };
  for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
    sv_colmap c;
    sv_colmap_camera k;
    sv_colmap_image m;
    sv_colmap_point p;
    static sv_colmap_rig g;
    assert_int_equal(sv_colmap_open(&c, "cameras.txt", cases[i].text, strlen(cases[i].text), false, &err),
                     SV_OK);
    sv_status s = cases[i].kind == 'c'   ? sv_colmap_next_camera(&c, &k, &err)
                  : cases[i].kind == 'r' ? sv_colmap_next_rig(&c, &g, &err)
                  : cases[i].kind == 'i' ? sv_colmap_next_image(&c, &m, &err)
                                         : sv_colmap_next_point(&c, &p, &err);
    assert_error(s, cases[i].s, &err, cases[i].word);
  }
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_cameras), cmocka_unit_test(test_images),
                                     cmocka_unit_test(test_points),  cmocka_unit_test(test_frames),
                                     cmocka_unit_test(test_rigs),    cmocka_unit_test(test_refused)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
