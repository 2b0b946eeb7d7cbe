// SPDX-License-Identifier: Apache-2.0
// Kalibr's camchain.yaml: a chain as Kalibr writes it, other ways to write the same lists,
// refusals, and the import to a rig folder that is read back.
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/format/kalibr.h"
#include "src/format/rig_file.h"
#include "tests/common/test.h"
#include "tools/lab/lab.h"

enum { CAP = 4 };
static sv_sub_view views[CAP];
static sv_rig rig = {.sub_views = views, .cap_sub_views = CAP};
static sv_err err;

// cam1 is 0.11 m to the right of cam0; cam2 is turned by a quarter about z against cam1, and 0.2 m
// ahead.
#define CAM0                                                                                                 \
  "cam0:\n  cam_overlaps: [1, 2]\n  camera_model: pinhole\n"                                                 \
  "  distortion_coeffs: [-0.27695497, 0.06712482, 0.00087538,\n    1.1556e-04]\n"                            \
  "  distortion_model: radtan\n  intrinsics: [461.629, 460.152, 362.680, 246.049]\n"                         \
  "  resolution: [752, 480]\n  rostopic: /cam0/image_raw\n"
#define CAM1                                                                                                 \
  "cam1:\n  T_cam_imu:\n  - [0.0, -1.0, 0.0, 0.09]\n  - [1.0, 0.0, 0.0, 0.01]\n  - [0.0, 0.0, 1.0, 0.0]\n"   \
  "  - [0.0, 0.0, 0.0, 1.0]\n  T_cn_cnm1:\n  - [1.0, 0.0, 0.0, -0.11]\n  - [0.0, 1.0, 0.0, 0.0]\n"           \
  "  - [0.0, 0.0, 1.0, 0.0]\n  - [0.0, 0.0, 0.0, 1.0]\n  cam_overlaps: [0]\n  camera_model: pinhole\n"       \
  "  distortion_coeffs: [0.01, -0.02, 0.03, -0.04]\n  distortion_model: equidistant\n"                       \
  "  intrinsics: [200.5, 201.5, 319.5, 239.5]\n  resolution: [640, 480]\n  timeshift_cam_imu: -8.121e-05\n"
#define CAM2                                                                                                 \
  "cam2:\n  T_cn_cnm1:\n  - - 0\n    - 1\n    - 0\n    - 0\n  - - -1\n    - 0\n    - 0\n    - 0\n"           \
  "  - - 0\n    - 0\n    - 1\n    - -0.2\n  - - 0\n    - 0\n    - 0\n    - 1\n"                              \
  "  camera_model: 'pinhole' # a comment\n  distortion_coeffs: []\n  distortion_model: none\n"               \
  "  intrinsics: [100, 101, 31.5, 23.5]\n  resolution: [64, 48]\n"

static sv_status read_chain(const char *text) {
  return sv_kalibr_read(&rig, "chain.yaml", text, strlen(text), &err);
}

static void check_chain(void) {
  static const double lens0[8] = {461.629,     460.152,    363.18,     246.549,
                                  -0.27695497, 0.06712482, 0.00087538, 1.1556e-4},
                      lens1[8] = {200.5, 201.5, 320, 240, 0.01, -0.02, 0.03, -0.04};
  double x[3], world[3] = {0.3, 0.05, 2};
  assert_int_equal(rig.n_sub_views, 3);
  assert_true(rig.forward == SV_FORWARD_DIRECT && views[2].i_camera == 2);
  assert_string_equal(views[1].name, "cam1");
  assert_true(views[0].model.kind == SV_MODEL_OPENCV4 && views[1].model.kind == SV_MODEL_KB4);
  assert_true(views[2].model.kind == SV_MODEL_PINHOLE && views[2].model.p[2] == 32);
  assert_true(views[0].model.width_px == 752 && views[0].model.height_px == 480);
  for (int i = 0; i < 8; i++) {
    assert_true(fabs(views[0].model.p[i] - lens0[i]) < 1e-12);
    assert_true(fabs(views[1].model.p[i] - lens1[i]) < 1e-12);
  }
  sv_pose_apply(x, &views[0].cam_from_rig, world);
  assert_true(x[0] == 0.3 && x[1] == 0.05 && x[2] == 2);
  sv_pose_apply(x, &views[1].cam_from_rig, world);
  assert_true(fabs(x[0] - 0.19) < 1e-12 && fabs(x[1] - 0.05) < 1e-12 && fabs(x[2] - 2) < 1e-12);
  // through cam1: the chain is multiplied in this order
  sv_pose_apply(x, &views[2].cam_from_rig, world);
  assert_true(fabs(x[0] - 0.05) < 1e-12 && fabs(x[1] + 0.19) < 1e-12 && fabs(x[2] - 1.8) < 1e-12);
}

TEST(test_chain) {
  assert_ok(read_chain(CAM0 CAM1 CAM2), &err);
  check_chain();
  if (read_chain("%YAML:1.0\n---\n# c\nimu0:\n  rate: 200\n  a: [1,\n2]\n" CAM2 "\n" CAM0 CAM1) != SV_OK)
    fail_msg("%s", err.text);
  check_chain();
}

TEST(test_truncated) {
  static const char text[] = CAM0 CAM1 CAM2;
  // memory of its own, so that a sanitizer sees the end
  for (size_t n = 0; n + 1 < sizeof text; n++) {
    char *cut = malloc(n ? n : 1);
    memcpy(cut, text, n);
    sv_status s = sv_kalibr_read(&rig, "cut", cut, n, &err);
    free(cut);
    assert_true(s <= 0 && (s == SV_OK || err.text[0]));
    // only within the last number
    if (s == SV_OK && rig.n_sub_views == 3) assert_true(n > sizeof text - 6);
  }
}

TEST(test_refused) {
#define ONE(model, coeffs, lens, k, size)                                                                    \
  "cam0:\n  camera_model: " model "\n  distortion_coeffs: " coeffs "\n  distortion_model: " lens             \
  "\n  intrinsics: " k "\n  resolution: " size "\n"
  static const struct {
    const char *text, *words;
    sv_status s;
  } cases[] = {
      {"", "no camera", SV_E_NOT_FOUND},
      {"imu0:\n  rate: 200\n", "no camera", SV_E_NOT_FOUND},
      {CAM1, "cam0 of the chain is missing", SV_E_NOT_FOUND},
      {CAM0 CAM2, "cam1 of the chain is missing", SV_E_NOT_FOUND},
      {CAM0 CAM0, "twice", SV_E_FORMAT},
      {"cam9:\n", "outside 0 to 3", SV_E_FULL},
      {"cam0: {a: 1}\n", "lines of their own", SV_E_FORMAT},
      {"hello\n", "chain.yaml:1: cam0:", SV_E_FORMAT},
      {ONE("omni", "[0,0,0,0]", "radtan", "[1,1,1,1,1]", "[4,3]"), "omni is not supported", SV_E_UNSUPPORTED},
      {ONE("ds", "[]", "none", "[0,0,1,1,1,1]", "[4,3]"), "ds is not supported", SV_E_UNSUPPORTED},
      {ONE("pinhole", "[0]", "fov", "[1,1,1,1]", "[4,3]"), "fov is not supported", SV_E_UNSUPPORTED},
      {ONE("pinhole", "[0,0,0]", "radtan", "[1,1,1,1]", "[4,3]"), "there are 4, 3 and 2", SV_E_FORMAT},
      {ONE("pinhole", "[0,0,0,0]", "radtan", "[1,1,1]", "[4,3]"), "there are 3, 4 and 2", SV_E_FORMAT},
      {ONE("pinhole", "[0,0,0,0]", "radtan", "[1,x,1,1]", "[4,3]"),
       "chain.yaml:5: cam0: intrinsics: a number", SV_E_FORMAT},
      {ONE("pinhole", "[0,0,0,0]", "radtan", "[1,-1,1,1]", "[4,3]"), "focal", SV_E_RANGE},
      {ONE("pinhole", "[0,0,0,0]", "radtan", "[1,1,1,1]", "[4.5,3]"), "whole", SV_E_RANGE},
      {ONE("pinhole", "[0,0,0,0]", "radtan", "[1,1,1,1]", "[4,3,2]"), "too many", SV_E_FORMAT},
      {ONE("pinhole", "[0,0,0,0]", "radtan", "[1,1,1,1]", "[4,3"), "not closed", SV_E_FORMAT},
      {ONE("pinhole", "[0,0,0,0]]", "radtan", "[1,1,1,1]", "[4,3]"), "without a '['", SV_E_FORMAT},
      {"cam0:\n  camera_model: pinhole\n", "intrinsics is missing", SV_E_NOT_FOUND},
      {"cam0:\n  camera_model: pinhole\n  camera_model: pinhole\n", "twice", SV_E_FORMAT},
      {"cam0:\n  camera_model: pinhole\n intrinsics: [1]\n", "indent", SV_E_FORMAT},
      {"cam0:\n  camera_model pinhole\n", "'key: value'", SV_E_FORMAT},
      {"cam0:\n  - 1\n", "without a key", SV_E_FORMAT},
      {CAM0 "  T_cn_cnm1: [1]\n", "no camera before it", SV_E_FORMAT},
      {CAM0
       "cam1:\n  T_cn_cnm1: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]\n  camera_model: pinhole\n"
       "  distortion_coeffs: []\n  distortion_model: none\n  intrinsics: [1,1,1,1]\n  resolution: [4,3]\n",
       "cam1: T_cn_cnm1: 4 x 4", SV_E_FORMAT},
      {CAM0
       "cam1:\n  T_cn_cnm1: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1]\n  camera_model: pinhole\n"
       "  distortion_coeffs: []\n  distortion_model: none\n  intrinsics: [1,1,1,1]\n  resolution: [4,3]\n",
       "rotation", SV_E_RANGE},
  };
  for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
    sv_status s = read_chain(cases[i].text);
    assert_error(s, cases[i].s, &err, cases[i].words);
  }
}

TEST(test_import) {
  static uint8_t rig_block[16 << 10], scratch_block[64 << 10];
  char folder[] = "/tmp/subview-kalibr-XXXXXX", in[128], out[128], command[128];
  static const char text[] = CAM0 CAM1 CAM2;
  assert_non_null(mkdtemp(folder));
  snprintf(in, sizeof in, "%s/camchain.yaml", folder);
  snprintf(out, sizeof out, "%s/rig", folder);
  assert_int_equal(sv_file_write(in, text, sizeof text - 1, &err), SV_OK);
  lab_options o = {.from = "kalibr", .input = in, .out = out, .is_quiet = true};
  assert_int_equal(lab_cmd_import(&o), LAB_EXIT_OK);
  sv_arena a = sv_arena_make(rig_block, sizeof rig_block);
  sv_arena scratch = sv_arena_make(scratch_block, sizeof scratch_block);
  sv_rig back;
  sv_file_reader files = {out, sv_folder_read};
  assert_int_equal(sv_rig_init(&back, CAP, &a), SV_OK);
  assert_ok(sv_rig_read(&back, &files, 3, &scratch, &err), &err);
  memcpy(views, back.sub_views, sizeof(sv_sub_view) * 3);
  rig.n_sub_views = back.n_sub_views;
  rig.forward = back.forward;
  check_chain();
  snprintf(command, sizeof command, "rm -r '%s'", folder);
  assert_int_equal(system(command), 0);
  assert_int_equal(lab_cmd_import(&o), LAB_EXIT_FAILED); // the file is gone
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_chain), cmocka_unit_test(test_truncated),
                                     cmocka_unit_test(test_refused), cmocka_unit_test(test_import)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
