// SPDX-License-Identifier: Apache-2.0
// subview-calibrate shutter on captures of the simulator's chessboard, swayed by a hand: readout
// time within 3 %, direction, a global shutter told as such, and what it refuses. Then runs that
// regain what a rolling shutter costs.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "calib/solve/corners.h"
#include "tests/common/test.h"

#define BOARD "sim:board,rig=mono,path=sway,arc=0,fps=30,turn_deg_s=25,size=480x360"

static void need_board(void) {
  sv_err err;
  if (sv_corners_available(9, 6, &err) == SV_OK) return;
  print_message("skip  this build finds no chessboards\n");
  skip();
}

// A capture in dir/cap, whose rig does not tell its shutter.
static void capture(const char *dir, const char *options, int n) {
  assert_int_equal(
      shell_run("rm -rf '%s/cap'; '%s/subview' capture --source %s,%s --exposures %d --out '%s/cap' --quiet "
                "2>&1 && sed -i 's/, \"readout_ms.*\"}/}/' '%s/cap/rig/rig.json'",
                dir, shell_bin(), BOARD, options, n, dir, dir),
      0);
}

static int calibrate(const char *dir, const char *options) {
  return shell_run(
      "'%s/subview-calibrate' shutter --rig '%s/cap/rig' --capture '%s/cap' --board 9x6 --spacing 0.12 "
      "--json --quiet %s 2>&1",
      shell_bin(), dir, dir, options);
}

TEST(test_readout) {
  static const struct {
    const char *options, *direction;
    double ms;
    int n; // frames
  } runs[] = {{"readout_ms=20", "down", 20, 90},
              {"readout_ms=30,shutter=left", "left", 30, 60},
              {"readout_ms=0", NULL, 0, 30}};
  char dir[256];
  need_board();
  assert_int_equal(temp_folder_make(dir, sizeof dir, "shutter"), 0);
  for (size_t i = 0; i < sizeof runs / sizeof *runs; i++) {
    capture(dir, runs[i].options, runs[i].n);
    assert_int_equal(calibrate(dir, ""), 0);
    const double ms = shell_number("\"readout_ms\": "), sigma = shell_number("\"sigma_ms\": ");
    print_message("%s: %.3f +- %.3f ms, %.0f frames, %.3f px, %.3f px as a global shutter\n", runs[i].options,
                  ms, sigma, shell_number("\"frames\": "), shell_number("\"rms_px\": "),
                  shell_number("\"rms_global_px\": "));
    if (runs[i].direction) assert_non_null(strstr(shell_out, runs[i].direction));
    assert_true(fabs(ms - runs[i].ms) <= 0.03 * runs[i].ms);
    assert_int_equal(shell_run("cat '%s/cap/rig/rig.json'", dir), 0);
    assert_true((strstr(shell_out, "readout_ms") != NULL) == (runs[i].ms > 0));
  }
  assert_int_equal(temp_folder_remove(dir), 0);
}

// A board that stands still, and single pictures.
TEST(test_refused) {
  char dir[256];
  need_board();
  assert_int_equal(temp_folder_make(dir, sizeof dir, "shutter"), 0);
  capture(dir, "readout_ms=20,turn_deg_s=0,move_m_s=0", 12);
  assert_int_equal(calibrate(dir, ""), 1);
  assert_non_null(strstr(shell_out, "the board hardly moves"));
  capture(dir, "readout_ms=20", 3);
  assert_int_equal(calibrate(dir, ""), 1);
  assert_non_null(strstr(shell_out, "expected at least 8"));
  assert_int_equal(shell_run("cat '%s/cap/rig/rig.json'", dir), 0);
  assert_null(strstr(shell_out, "readout_ms"));
  assert_int_equal(temp_folder_remove(dir), 0);
}

static double psnr(const char *dir, const char *options, const char *flags) {
  assert_int_equal(
      shell_run(
          "'%s/subview' run --source sim:%s,rig=stereo,path=sway,arc=0,fps=15,exposures=24,size=160x120 "
          "--exposures 24 --steps 600 --gaussians 4000 --json --quiet --overwrite --out '%s/run' %s 2>&1",
          shell_bin(), options, dir, flags),
      0);
  return shell_number("\"psnr\": ");
}

// 30 degrees/s and 0.3 m/s; at least 75 % of what is lost comes back. Poses of the source, then
// those that odometry finds.
TEST(test_regained) {
  static const char *const scenes[2] = {"textured", "room,poses=unknown"};
  char dir[256], with[128];
  assert_int_equal(temp_folder_make(dir, sizeof dir, "shutter"), 0);
  for (int i = 0; i < 2; i++) {
    snprintf(with, sizeof with, "%s,readout_ms=0.001", scenes[i]);
    const double ideal = psnr(dir, with, "--shutter global");
    snprintf(with, sizeof with, "%s,readout_ms=20", scenes[i]);
    const double lost = psnr(dir, with, "--shutter global"), regained = psnr(dir, with, "");
    print_message("%s: %.2f dB global shutter; 20 ms: %.2f dB, modeled %.2f dB\n", scenes[i], ideal, lost,
                  regained);
    assert_true(lost < ideal - 0.5);
    assert_true(regained - lost > 0.75 * (ideal - lost));
  }
  assert_int_equal(temp_folder_remove(dir), 0);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_readout), cmocka_unit_test(test_refused),
                                     cmocka_unit_test(test_regained)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
