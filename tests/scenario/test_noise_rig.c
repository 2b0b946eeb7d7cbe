// SPDX-License-Identifier: Apache-2.0
// subview-calibrate noise on flat frames of the simulator: read noise and shot noise within stated
// percents, kept in rig.json, and what it refuses.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tests/common/test.h"

#define FLAT "sim:textured,size=160x120,vignetting=-0.97"

static char dir[256];

// Two series, of bright and of dark fields, beside each other in a folder a camera.
static void capture(const char *options) {
  for (int i = 0; i < 2; i++) {
    assert_int_equal(
        shell_run("rm -rf '%s/%d'; '%s/subview' capture --source %s,flat=%g,%s --exposures 20 --out "
                  "'%s/%d' --quiet 2>&1",
                  dir, i, shell_bin(), FLAT, i ? 0.05 : 0.8, options, dir, i),
        0);
    assert_int_equal(
        shell_run("for c in left right; do for f in '%s/%d/'$c/*; do mkdir -p '%s/'$c && mv \"$f\" "
                  "\"%s/$c/%d-$(basename \"$f\")\"; done; done 2>&1",
                  dir, i, dir, dir, i),
        0);
  }
}

static int calibrate(void) {
  return shell_run(
      "'%s/subview-calibrate' noise --rig '%s/0/rig' --images '%s/left' '%s/right' --json --quiet 2>&1",
      shell_bin(), dir, dir, dir);
}

TEST(test_flat_frames) {
  static const struct { double read, shot; } truth[] = {{1e-5, 1e-3}, {1e-5, 2e-4}, {1e-6, 1e-4}};
  for (size_t i = 0; i < sizeof truth / sizeof *truth; i++) {
    char options[80];
    assert_int_equal(shell_run("rm -rf '%s/left' '%s/right'", dir, dir), 0);
    snprintf(options, sizeof options, "depth=16,noise=read:%g:shot:%g", truth[i].read, truth[i].shot);
    capture(options);
    assert_int_equal(calibrate(), 0);
    const double read = shell_number("\"read\": "), shot = shell_number("\"shot\": ");
    print_message("%s: read %.4g (%+.1f %%), shot %.4g (%+.1f %%)\n", options, read,
                  100 * (read / truth[i].read - 1), shot, 100 * (shot / truth[i].shot - 1));
    assert_true(fabs(read / truth[i].read - 1) < 0.1 && fabs(shot / truth[i].shot - 1) < 0.01);
    assert_int_equal(shell_run("cat '%s/0/rig/rig.json'", dir), 0);
    assert_true(fabs(shell_number("\"shot\": ") / shot - 1) < 1e-4); // and not the simulator's own
  }
}

TEST(test_refused) {
  assert_int_equal(shell_run("'%s/subview' capture --source %s --exposures 2 --depth 16 --out '%s/8' 2>&1",
                             shell_bin(), FLAT, dir),
                   1);
  assert_non_null(strstr(shell_out, "16 bits a value come from raw frames"));
  assert_int_equal(
      shell_run("'%s/subview' capture --source %s,depth=16 --exposures 2 --depth 16 --out '%s/16' 2>&1",
                shell_bin(), FLAT, dir),
      0);
  assert_int_equal(shell_run("rm -rf '%s/left' '%s/right'", dir, dir), 0);
  capture("depth=16,noise=read:1e-5:shot:0");
  assert_int_equal(calibrate(), 1);
  assert_non_null(strstr(shell_out, "does not grow with the light"));
  assert_int_equal(shell_run("rm -rf '%s/left' '%s/right'", dir, dir), 0);
  capture("noise=read:1e-5:shot:1e-3");
  assert_int_equal(calibrate(), 1);
  assert_non_null(strstr(shell_out, "expected RGB of 16 bits"));
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_flat_frames), cmocka_unit_test(test_refused)};
  if (temp_folder_make(dir, sizeof dir, "noise")) return 1;
  const int n_failed = cmocka_run_group_tests(tests, NULL, NULL);
  return temp_folder_remove(dir) || n_failed;
}
