// SPDX-License-Identifier: Apache-2.0
// The programs train on the datasets of tests/data, as a user runs them: a published scene, one
// exposure of five devices, and four real webcams.
// Floors of PSNR lie within 1 dB of what was measured.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "tests/common/lab_shell.h"
#include "tests/common/test.h"

static lab_shell shell = {.cwd = ""};

FIXTURE(setup) {
  char here[512], line[600];
  int code = lab_shell_open(&shell, "real");
  if (code != 0) return code < 0 ? code : 0;
  if (!getcwd(here, sizeof here)) return -1;
  snprintf(line, sizeof line, "ln -s '%s/tests/data' data", here);
  if (lab_shell_run(&shell, line) != 0) return -1;
  shell.is_ready = true;
  return 0;
}

FIXTURE(teardown) { return lab_shell_close(&shell); }

// The first number of this name in a JSON text.
static double number_of(const char *json, const char *name) {
  char key[80], *end = NULL;
  snprintf(key, sizeof key, "\"%s\": ", name);
  const char *at = strstr(json, key);
  double value = at ? strtod(at + strlen(key), &end) : 0;
  if (!at || end == at + strlen(key)) fail_msg("no number \"%s\" in: %s", name, json);
  return value;
}

static int count(const char *text, const char *word) {
  int n = 0;
  for (const char *p = text; (p = strstr(p, word)); p += strlen(word)) n++;
  return n;
}

TEST(test_mic) {
  lab_shell_need(&shell);
  lab_shell_run_well(&shell, "@ train --data data/mic_200 --gaussians 5000 --steps 1500 --threads 2 --eval "
                             "--json --quiet --out mic");
  double psnr = number_of(shell.said, "psnr"), ssim = number_of(shell.said, "ssim");
  print_message("mic, 32 views: %.2f dB, SSIM %.4f on 8 held-out views\n", psnr, ssim);
  assert_int_equal((int)number_of(shell.said, "training_views"), 32);
  assert_int_equal((int)number_of(shell.said, "views"), 8);
  assert_true(psnr > 33.1 && ssim > 0.97);
}

typedef struct {
  double psnr, abs_rel;
} score;

static score train_kitchen(const char *device, int n_views) {
  char line[300];
  snprintf(line, sizeof line,
           "@ train --data data/kitchen --transforms transforms_train_%s.json --exposures 1 "
           "--gaussians 4000 --steps 600 --threads 2 --eval --json --quiet --out %s",
           device, device);
  lab_shell_run_well(&shell, line);
  score s = {number_of(shell.said, "psnr"), number_of(shell.said, "abs_rel")};
  print_message("kitchen, 1 exposure, %s: %.2f dB, AbsRel %.4f on 6 held-out views\n", device, s.psnr,
                s.abs_rel);
  assert_int_equal((int)number_of(shell.said, "training_views"), n_views);
  assert_int_equal((int)number_of(shell.said, "views"), 6);
  return s;
}

// The floors of the devices: dB; the ceilings of their depth error.
TEST(test_devices) {
  static const struct {
    const char *name;
    int n_views;
    double min_psnr, max_abs_rel;
  } devices[] = {{"mono_theta0", 1, 15.9, 0.20},
                 {"stereo_theta10", 2, 24.5, 0.030},
                 {"phone_theta10", 3, 22.6, 0.036},
                 {"lightfield_theta10", 16, 24.8, 0.026},
                 {"multiplexed_theta10", 16, 25.6, 0.026}};
  enum { MONO, STEREO, PHONE, LIGHTFIELD, MULTIPLEXED, N_DEVICES = sizeof devices / sizeof *devices };
  score of[N_DEVICES];
  lab_shell_need(&shell);
  for (int i = 0; i < N_DEVICES; i++) {
    of[i] = train_kitchen(devices[i].name, devices[i].n_views);
    if (!(of[i].psnr > devices[i].min_psnr && of[i].abs_rel < devices[i].max_abs_rel))
      fail_msg("%s: expected more than %.1f dB and AbsRel below %.3f", devices[i].name, devices[i].min_psnr,
               devices[i].max_abs_rel);
  }
  assert_true(of[STEREO].psnr > of[MONO].psnr + 6);
  assert_true(of[STEREO].abs_rel < of[MONO].abs_rel / 3);
  // the paper's order
  assert_true(of[PHONE].psnr > of[MONO].psnr && of[LIGHTFIELD].psnr > of[PHONE].psnr);
  assert_true(of[LIGHTFIELD].psnr > of[STEREO].psnr && of[MULTIPLEXED].psnr > of[LIGHTFIELD].psnr);
}

static void import_webcams(void) {
  lab_shell_run_well(&shell, "test -e webcams || @ import --from 4cam-board data/webcams_board --out webcams "
                             "--quiet");
}

// The recorded timestamps decide which frames form an exposure. All do within 20 ms, 8 of 12
// within 5 ms.
// The largest skews are those of sync_index 47 and 42 in timestamps.csv.
TEST(test_webcam_exposures) {
  static const struct {
    int limit_ms, n_exposures;
    double max_skew_us;
  } cases[] = {{20, 12, 16800.15}, {5, 8, 4315.45}};
  lab_shell_need(&shell);
  import_webcams();
  for (int i = 0; i < 2; i++) {
    char line[200], expected[200];
    snprintf(
        line, sizeof line,
        "$(dirname @)/subview run --source replay:webcams --exposures 12 --skew-limit %d --gaussians 1000 "
        "--steps 20 --quiet --overwrite --out sync",
        cases[i].limit_ms);
    lab_shell_run_well(&shell, line);
    char *report = temp_read(shell.root, "sync/run.json");
    const char *skew = strstr(report, "\"skew_us\": ");
    assert_non_null(skew);
    assert_int_equal((int)number_of(report, "exposures"), cases[i].n_exposures);
    assert_int_equal((int)number_of(report, "views"), 4 * cases[i].n_exposures);
    assert_true(fabs(number_of(skew, "max") - cases[i].max_skew_us) < 1);
    snprintf(expected, sizeof expected, "\"captured\": 12, \"delivered\": %d, \"pending\": 0, \"dropped\": {",
             cases[i].n_exposures);
    assert_int_equal(count(report, expected), 4);
    snprintf(expected, sizeof expected, "\"dropped\": {\"no_partner\": %d}", 12 - cases[i].n_exposures);
    assert_int_equal(count(report, expected), cases[i].n_exposures < 12 ? 4 : 0);
    assert_int_equal(count(report, "\"is_exact\": true"), 4);
    free(report);
  }
}

TEST(test_webcam_training) {
  lab_shell_need(&shell);
  import_webcams();
  lab_shell_run_well(&shell, "$(dirname @)/subview run --source replay:webcams --exposures 1 --steps 600 "
                             "--threads 2 --quiet --json --hold-out 0.05 --out webcam_model");
  double psnr = number_of(shell.said, "train_psnr"), held = number_of(shell.said, "held_out_psnr");
  print_message("held-out pixels %.2f dB\n", held);
  assert_true(held > 21.5 && held < psnr);
  // What is learned of the cameras is what cameras may be.
  char *report = temp_read(shell.root, "webcam_model/run.json");
  const char *falloff = report;
  for (int i = 0; i < 4; i++) {
    falloff = strstr(falloff + 1, "\"falloff\": ");
    assert_non_null(falloff);
    assert_true(fabs(strtod(strchr(falloff, '[') + 1, NULL)) < 0.9);
  }
  free(report);
  print_message("four webcams, 1 exposure: %.2f dB on their own views\n", psnr);
  assert_int_equal((int)number_of(shell.said, "views"), 4);
  assert_true(psnr > 26.0);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_mic), cmocka_unit_test(test_devices),
                                     cmocka_unit_test(test_webcam_exposures),
                                     cmocka_unit_test(test_webcam_training)};
  return cmocka_run_group_tests(tests, setup, teardown);
}
