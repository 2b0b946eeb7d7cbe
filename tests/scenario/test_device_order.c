// SPDX-License-Identifier: Apache-2.0
// The paper's order of the five devices, on held-out views of the simulator: one exposure, random
// start, as the paper trains simulated scenes. SV_BIN names the programs' folder.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tests/common/lab_shell.h"
#include "tests/common/test.h"

enum { MONO, PHONE, STEREO, LIGHTFIELD, MULTIPLEXED, N_DEVICES };

// Floors are at most 1 dB, and ceilings a sixth, from what was measured.
static const struct {
  const char *name;
  double min_psnr, max_abs_rel;
} devices[N_DEVICES] = {{"mono", 19.2, 0.153},         // 20.08 dB, 0.131
                        {"phone", 23.4, 0.064},        // 24.31, 0.055
                        {"stereo", 25.8, 0.059},       // 26.71, 0.051
                        {"lightfield", 24.6, 0.037},   // 25.50, 0.032
                        {"multiplexed", 25.7, 0.037}}; // 26.59, 0.032

static lab_shell shell = {.cwd = "", .is_stdout_apart = true};

FIXTURE(setup) {
  const int code = lab_shell_open(&shell, "order");
  if (code != 0) return code < 0 ? code : 0;
  if (lab_shell_run(&shell, "@ import --from sim occlusion,size=200x200 --out s --quiet") != 0) return -1;
  shell.is_ready = true;
  return 0;
}

FIXTURE(teardown) { return lab_shell_close(&shell); }

static double number_of(const char *json, const char *key) {
  char quoted[40];
  snprintf(quoted, sizeof quoted, "\"%s\": ", key);
  const char *at = strstr(json, quoted);
  if (!at) fail_msg("%s is missing in %s", key, json);
  return atof(at + strlen(quoted));
}

TEST(test_order) {
  double psnr[N_DEVICES], abs_rel[N_DEVICES];
  lab_shell_need(&shell);
  for (int i = 0; i < N_DEVICES; i++) {
    char line[300];
    snprintf(line, sizeof line,
             "@ train --data s --transforms transforms_train_%s.json --exposures 1 --init sphere --gaussians "
             "3000 --steps 500 --threads 2 --eval --json --quiet --out m",
             devices[i].name);
    lab_shell_run_well(&shell, line);
    char *text = temp_read(shell.root, "out.txt");
    psnr[i] = number_of(text, "psnr");
    abs_rel[i] = number_of(text, "abs_rel");
    free(text);
    print_message("%s: %.2f dB, AbsRel %.4f on 6 held-out views\n", devices[i].name, psnr[i], abs_rel[i]);
    assert_true(psnr[i] > devices[i].min_psnr && abs_rel[i] < devices[i].max_abs_rel);
  }
  // As in the paper, but that the stereo rig's large pictures are as good as the grids' many small
  // ones here.
  for (int i = MONO; i < STEREO; i++) assert_true(psnr[i + 1] > psnr[i]);
  assert_true(psnr[LIGHTFIELD] > psnr[PHONE] && psnr[MULTIPLEXED] > psnr[LIGHTFIELD]);
  // Both grids see depth better than the devices with few cameras, and these better than one.
  assert_true(abs_rel[LIGHTFIELD] < abs_rel[STEREO] && abs_rel[LIGHTFIELD] < abs_rel[PHONE]);
  assert_true(abs_rel[MULTIPLEXED] < abs_rel[STEREO] && abs_rel[MULTIPLEXED] < abs_rel[PHONE]);
  assert_true(abs_rel[PHONE] < abs_rel[MONO] / 1.5 && abs_rel[STEREO] < abs_rel[MONO] / 1.5);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_order)};
  return cmocka_run_group_tests(tests, setup, teardown);
}
