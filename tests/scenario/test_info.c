// SPDX-License-Identifier: Apache-2.0
// `subview-lab info`: the angular baseline of datasets and rigs; masks that devices share.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "tests/common/lab_shell.h"
#include "tests/common/test.h"

static lab_shell shell = {.cwd = ""};

static int setup(void **state) {
  (void)state;
  const int r = lab_shell_open(&shell, "info");
  shell.is_ready = r == 0;
  if (r == 0) lab_shell_run_well(&shell, "@ import --from sim textured,size=48x48 --out s --quiet");
  return r < 0 ? -1 : 0;
}
static int teardown(void **state) {
  (void)state;
  return lab_shell_close(&shell);
}

static double number(const char *key) {
  const char *at = strstr(shell.said, key);
  if (!at) fail_msg("no %s in: %s", key, shell.said);
  return strtod(at + strlen(key) + 1, NULL);
}

// The simulator's devices have 10 degrees about the origin, for each exposure.
TEST(test_theta) {
  static const char *const devices[] = {"mono", "phone", "stereo", "lightfield"};
  static const int n_sub_views[] = {1, 3, 2, 16};
  lab_shell_need(&shell);
  for (int i = 0; i < 4; i++) {
    char line[200];
    snprintf(line, sizeof line, "@ info --data s --transforms transforms_train_%s.json --json", devices[i]);
    lab_shell_run_well(&shell, line);
    assert_true(fabs(number("\"theta_deg\"") - (i ? 10 : 0)) < 1e-3);
    assert_true(number("\"theta_max_deg\"") - number("\"theta_min_deg\"") < 1e-3);
    assert_int_equal(number("\"sub_views\""), n_sub_views[i]);
    assert_int_equal(number("\"exposures\""), 3);
  }
}

// About the points' centroid where there are points: at twice the distance half the angle.
TEST(test_points) {
  lab_shell_need(&shell);
  lab_shell_run_well(&shell,
                     "mkdir p && cp -r s/train p/ && "
                     "printf '{\"camera_angle_x\": 0.9, \"ply_file_path\": \"p.ply\", \"frames\": [\\n"
                     "{\"file_path\": \"train/mono/e00_s00.png\", \"exposure\": 0, \"transform_matrix\": "
                     "[[1,0,0,-1],[0,1,0,0],[0,0,1,0],[0,0,0,1]]},\\n"
                     "{\"file_path\": \"train/mono/e01_s00.png\", \"exposure\": 0, \"transform_matrix\": "
                     "[[1,0,0,1],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}]}\\n' > p/transforms_train.json && "
                     "printf 'ply\\nformat ascii 1.0\\nelement vertex 2\\nproperty float x\\n"
                     "property float y\\nproperty float z\\nend_header\\n"
                     "1 0 -12\\n-1 0 -8\\n' > p/p.ply");
  lab_shell_run_well(&shell, "@ info --data p --json");
  assert_true(fabs(number("\"theta_deg\"") - 2 * atan(0.1) * 180 / 3.14159265358979) < 1e-4);
  assert_contains(shell.said, "the centroid of the points");
  lab_shell_run_well(&shell, "@ info --data p");
  assert_contains(shell.said, "angular baseline theta: 11.421 degrees");
}

TEST(test_refused) {
  lab_shell_need(&shell);
  assert_int_equal(lab_shell_run(&shell, "@ info"), 2);
  assert_contains(shell.said, "--data or --rig is needed");
  assert_int_equal(lab_shell_run(&shell, "@ info --rig r"), 2);
  assert_contains(shell.said, "--rig and --distance need each other");
  assert_int_equal(lab_shell_run(&shell, "@ info --rig nowhere --distance 1"), 1);
  assert_contains(shell.said, "nowhere");
}

// A rig of one baseline: 2 atan(baseline / 2 / distance), for parallel axes.
TEST(test_rig) {
  lab_shell_need(&shell);
  lab_shell_run_well(&shell,
                     "mkdir c && cp -r \"$SV_DATA/capture_tiny/rig\" c/ && @ info --rig c/rig --distance 2 "
                     "--json");
  const double near = number("\"theta_deg\"");
  lab_shell_run_well(&shell, "@ info --rig c/rig --distance 4 --json");
  assert_true(near > 0 && fabs(near / number("\"theta_deg\"") - 2) < 0.05);
}

// Each device has its own co-visible pixels; those of a comparison are the same for each.
TEST(test_shared_mask) {
  static const char *const names[] = {"mono", "phone"};
  double own[2], shared[2];
  lab_shell_need(&shell);
  for (int i = 0; i < 2; i++) {
    char line[400];
    snprintf(line, sizeof line,
             "@ train --data s --transforms transforms_train_%s.json --exposures 1 --gaussians 100 --steps 5 "
             "--out %s --quiet && @ eval --data s --model %s/model.ply --split test --mask covisible "
             "--mask-with transforms_train_%s.json,transforms_train_stereo.json --json --quiet >%s.json && "
             "cat %s.json",
             names[i], names[i], names[i], names[!i], names[i], names[i]);
    lab_shell_run_well(&shell, line);
    own[i] = number("\"mask_coverage\"");
    shared[i] = number("\"shared_coverage\"");
    assert_true(number("\"mpsnr\"") > 0 && number("\"shared_psnr\"") > 0);
  }
  print_message("own %.4f and %.4f, shared %.4f\n", own[0], own[1], shared[0]);
  assert_true(shared[0] == shared[1] && shared[0] > 0);
  assert_true(shared[0] <= own[0] && shared[0] <= own[1] && own[0] != own[1]);
  assert_int_equal(lab_shell_run(&shell, "@ eval --data s --model mono/model.ply --mask-with x"), 2);
  assert_contains(shell.said, "--mask-with needs --mask");
  assert_int_equal(
      lab_shell_run(&shell, "@ eval --data s --model mono/model.ply --mask covisible --mask-with a,,b"), 1);
  assert_contains(shell.said, "with commas between them");
}

// One view pins nothing down, three do.
TEST(test_supported_mask) {
  double covered[2];
  static const char *const names[] = {"mono", "phone"};
  lab_shell_need(&shell);
  for (int i = 0; i < 2; i++) {
    char line[300];
    snprintf(line, sizeof line,
             "@ eval --data s --model %s/model.ply --split test --mask supported --json --quiet", names[i]);
    lab_shell_run_well(&shell, line);
    covered[i] = number("\"support_coverage\"");
  }
  assert_true(number("\"supported_psnr\"") > 0);
  print_message("well supported: %.4f and %.4f of the pixels\n", covered[0], covered[1]);
  assert_true(covered[0] == 0 && covered[1] > 0.02);
  assert_int_equal(
      lab_shell_run(&shell, "@ eval --data s --model mono/model.ply --mask supported --mask-with x"), 2);
  assert_contains(shell.said, "--mask-with needs --mask covisible");
}

int main(void) {
  char here[500];
  if (!getcwd(here, sizeof here - 20)) return 1;
  strcat(here, "/tests/data");
  setenv("SV_DATA", here, 1);
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_theta),       cmocka_unit_test(test_points),
      cmocka_unit_test(test_refused),     cmocka_unit_test(test_rig),
      cmocka_unit_test(test_shared_mask), cmocka_unit_test(test_supported_mask)};
  return cmocka_run_group_tests(tests, setup, teardown);
}
