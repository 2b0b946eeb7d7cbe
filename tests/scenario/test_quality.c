// SPDX-License-Identifier: Apache-2.0
// Runs that end by themselves (run --quality).
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tests/common/test.h"

#define RUN "$SV_EMULATE $SV_BIN/subview run --gaussians 2000 --json --quiet --overwrite "
#define ONE "--source sim:room,rig=stereo,size=160x120 --exposures 1 "

static char out[4096];

static double number_of(const char *key) {
  char quoted[40];
  snprintf(quoted, sizeof quoted, "\"%s\": ", key);
  const char *at = strstr(out, quoted);
  if (!at) fail_msg("%s is missing in %s", key, out);
  return atof(at + strlen(quoted));
}

static int run(const char *args) {
  char command[800];
  snprintf(command, sizeof command, RUN "%s --out %s 2>&1", args, temp_path("out"));
  return shell_read(out, sizeof out, command);
}

TEST(one_exposure_is_learned_soon) {
  assert_int_equal(run(ONE "--steps 7000"), 0);
  const double all_psnr = number_of("psnr");
  assert_int_equal(run(ONE "--quality normal --steps 7000"), 0);
  const double psnr = number_of("psnr"), steps = number_of("steps"), held = number_of("held_out_psnr");
  print_message("7000 steps %.2f dB; ended after %.0f steps: %.2f dB, held-out pixels %.2f dB\n", all_psnr,
                steps, psnr, held);
  assert_true(steps < 7000);
  assert_true(psnr > all_psnr - 0.4);
  assert_true(held > 15 && held < 40);
  char *report = temp_read(temp_path("out"), "run.json");
  assert_contains(report, "\"settled_from_step\": ");
  free(report);
}

TEST(limits_hold) {
  assert_int_equal(run(ONE "--quality draft --steps 60"), 0);
  assert_int_equal((int)number_of("steps"), 60);
  // none of its pixels can be held out
  assert_int_equal(
      run("--source sim:room,rig=multiplexed,size=160x120 --exposures 1 --quality draft --steps 20"), 0);
  assert_int_equal((int)number_of("steps"), 20);
}

TEST(refusals) {
  assert_true(run(ONE "--quality best") > 0);
  assert_contains(out, "--quality best: expected draft|normal|fine");
  assert_true(run(ONE "--quality fine --live --time-limit 1") > 0);
  assert_contains(out, "--quality: not with --live");
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(one_exposure_is_learned_soon),
                                     cmocka_unit_test(limits_hold), cmocka_unit_test(refusals)};
  return cmocka_run_group_tests(tests, temp_folder_setup, temp_folder_teardown);
}
