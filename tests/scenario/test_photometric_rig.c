// SPDX-License-Identifier: Apache-2.0
// subview-calibrate photometric on the simulator: white pictures and chessboards of cameras whose
// gains, white balance and falloff are known, runs that regain what these cost, check's warning,
// and what is refused.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "calib/solve/corners.h"
#include "tests/common/test.h"

#define BRIGHTER  "gain=0.1,white=5500" // white squares are not saturated
#define DIFFERENT "gain=0.3,white=4500,vignetting=-0.4"

static double number_from(const char *at, const char *key) {
  at = at ? strstr(at, key) : NULL;
  if (!at) fail_msg("no %s in: %s", key, shell_out);
  return strtod(at + strlen(key), NULL);
}

static void need_board(void) {
  sv_err err;
  if (sv_corners_available(9, 6, &err) == SV_OK) return;
  print_message("skip  this build finds no chessboards\n");
  skip();
}

// A capture in dir/cap; a rig that is there stays.
static void capture(const char *dir, const char *source, int n) {
  assert_int_equal(
      shell_run(
          "rm -rf '%s/cap'; '%s/subview' capture --source %s,exposures=%d --exposures %d --out '%s/cap' "
          "--quiet 2>&1; test -d '%s/rig' || cp -r '%s/cap/rig' '%s/rig'",
          dir, shell_bin(), source, n, n, dir, dir, dir, dir),
      0);
}

// option: that which takes the folders of the cameras.
static int program(const char *dir, const char *command, const char *option, const char *cameras,
                   const char *more) {
  return shell_run(
      "p=; for c in %s; do p=\"$p %s/cap/$c\"; done; '%s/subview-calibrate' %s --rig '%s/rig' %s $p %s "
      "--json 2>&1",
      cameras, dir, shell_bin(), command, dir, option, more);
}

static int calibrate(const char *dir, const char *option, const char *cameras, const char *more) {
  return program(dir, "photometric", option, cameras, more);
}

// Gains of a camera relative to 1 + gain of the light, balanced to white_k.
static void check_camera(const char *name, const double gain[3], double gain_limit, double corner_limit) {
  static const char *const keys[] = {"\"gain_r\": ", "\"gain_g\": ", "\"gain_b\": "};
  const char *at = strstr(shell_out, name);
  double worst = 0;
  for (int k = 0; k < 3; k++) worst = fmax(worst, fabs(number_from(at, keys[k]) / gain[k] - 1));
  const double corner = number_from(at, "\"corner_light\": "), sigma = number_from(at, "\"corner_sigma\": ");
  print_message("%s: gains off by %.2f %%, light at the corner %.4f +- %.4f\n", name, 100 * worst, corner,
                sigma);
  assert_true(worst <= gain_limit);
  assert_true(fabs(corner - 0.6) <= corner_limit && sigma < corner_limit);
}

// Black bodies of 6500, 4500 and 5500 K, and half-way: platform/sim/optics.c.
static const double same[3] = {1, 1, 1}, right[3] = {1.00209, 1.3, 1.97983},
                    brighter[3] = {0.99052, 1.10000, 1.30297}, tele[3] = {0.61557, 0.7, 0.86138};

static double psnr(const char *dir, const char *rig, const char *options) {
  assert_int_equal(
      shell_run(
          "'%s/subview' run --source sim:%s,size=160x120,exposures=8%s --exposures 8 --steps 400 --gaussians "
          "3000 --json --quiet --overwrite --out '%s/run' 2>&1",
          shell_bin(), rig, options, dir),
      0);
  return number_from(shell_out, "\"psnr\": ");
}

TEST(test_white_pictures) {
  char dir[256], with[600];
  assert_int_equal(temp_folder_make(dir, sizeof dir, "photometric"), 0);
  capture(dir, "sim:textured,flat=0.33,rig=phone,size=160x120,noise=read:1e-5:shot:1e-4," DIFFERENT, 10);
  assert_int_equal(calibrate(dir, "--white", "wide ultrawide tele", ""), 0);
  check_camera("\"wide\"", same, 1e-6, 0.01);
  check_camera("\"ultrawide\"", right, 0.005, 0.01);
  check_camera("\"tele\"", tele, 0.005, 0.01);
  snprintf(with, sizeof with, "," DIFFERENT " --rig '%s/rig'", dir);
  const double ideal = psnr(dir, "room,rig=phone", ""),
               off = psnr(dir, "room,rig=phone", "," DIFFERENT " --appearance off"),
               calibrated = psnr(dir, "room,rig=phone", with);
  print_message("ideal %.2f dB, different %.2f dB, calibrated %.2f dB\n", ideal, off, calibrated);
  assert_null(strstr(shell_out, "\"appearance\": {")); // nothing is left to learn
  assert_true(off < ideal - 2 && calibrated > ideal - 0.2);
  assert_int_equal(temp_folder_remove(dir), 0);
}

// A run of a scene measures its cameras: within 2 %, mixing of channels within 0.02 of the light.
static void check_scene(const char *rig, const char *crosstalk, const char *const *names,
                        const double (*gain)[3], double mix) {
  static const char *const gains[] = {"\"gain_r\": ", "\"gain_g\": ", "\"gain_b\": "},
                           *const mixes[] = {"\"mix_rg\": ", "\"mix_rb\": ", "\"mix_gr\": ",
                                             "\"mix_gb\": ", "\"mix_br\": ", "\"mix_bg\": "};
  char dir[256];
  assert_int_equal(temp_folder_make(dir, sizeof dir, "photometric"), 0);
  assert_int_equal(
      shell_run("'%s/subview' capture --source sim:room,rig=%s,size=320x240,exposures=1 --exposures 1 --out "
                "'%s/cap' --quiet 2>&1; cp -r '%s/cap/rig' '%s/rig'; '%s/subview' run --source "
                "sim:room,rig=%s,size=320x240,exposures=16," DIFFERENT
                "%s --exposures 16 --steps 1 --gaussians 8000 --appearance cameras --quiet --out '%s/run' "
                "2>&1",
                shell_bin(), rig, dir, dir, dir, shell_bin(), rig, crosstalk, dir),
      0);
  assert_int_equal(shell_run("'%s/subview-calibrate' photometric --rig '%s/rig' --run '%s/run' --json 2>&1",
                             shell_bin(), dir, dir),
                   0);
  for (int c = 0; names[c]; c++) {
    const char *at = strstr(shell_out, names[c]);
    double worst = 0, worst_mix = 0;
    for (int k = 0; k < 3; k++)
      worst = fmax(worst, fabs(number_from(at, gains[k]) / (gain[c][k] * (c ? 1 - 2 * mix : 1)) - 1));
    for (int k = 0; k < 6; k++)
      worst_mix =
          fmax(worst_mix, fabs(number_from(strstr(shell_out, names[1]), mixes[k]) / gain[1][k / 2] - mix));
    const double corner = number_from(at, "\"corner_light\": ");
    print_message("%s: gains off by %.2f %%, light at the corner %.4f, mixing off by %.4f\n", names[c],
                  100 * worst, corner, worst_mix);
    assert_true(worst <= 0.02 && worst_mix <= 0.02 && fabs(corner - 0.6) <= 0.02);
  }
  assert_int_equal(shell_run("cat '%s/rig/rig.json'", dir), 0);
  assert_contains(shell_out, "\"mix_sigma\": ");
  assert_int_equal(temp_folder_remove(dir), 0);
}

TEST(test_scene) {
  static const char *const names[] = {"\"left\"", "\"right\"", NULL};
  const double gain[2][3] = {{1, 1, 1}, {right[0], right[1], right[2]}};
  check_scene("stereo", "", names, gain, 0);
  check_scene("stereo", ",crosstalk=0.1", names, gain, 0.1);
}

// lock=shared: the first camera measures; with a calibrated rig the others expose by their
// responses, so that a more sensitive one does not saturate.
TEST(test_shared_light) {
  static const char different[] = ",gain=0.3,white=4500";
  char dir[256], with[600];
  double shared[2];
  assert_int_equal(temp_folder_make(dir, sizeof dir, "photometric"), 0);
  capture(dir, "sim:textured,flat=0.33,rig=phone,size=160x120,noise=read:1e-5:shot:1e-4,gain=0.3,white=4500",
          10);
  snprintf(with, sizeof with, ",lock=shared%s --appearance off", different);
  shared[0] = psnr(dir, "room,rig=phone", with);
  assert_int_equal(calibrate(dir, "--white", "wide ultrawide tele", ""), 0);
  snprintf(with, sizeof with, ",lock=shared%s --rig '%s/rig'", different, dir);
  shared[1] = psnr(dir, "room,rig=phone", with);
  assert_null(strstr(shell_out, "\"appearance\": {")); // nothing is left to learn
  snprintf(with, sizeof with, ",lock=on%s --rig '%s/rig'", different, dir);
  const double on = psnr(dir, "room,rig=phone", with), ideal = psnr(dir, "room,rig=phone", ",lock=shared");
  print_message("ideal %.2f dB; lock=shared %.2f dB, calibrated %.2f dB; lock=on, calibrated %.2f dB\n",
                ideal, shared[0], shared[1], on);
  // Calibrated again on pictures of which the earlier calibration gave the exposure times.
  assert_int_equal(
      shell_run("rm -rf '%s/cap'; '%s/subview' capture --source "
                "sim:room,flat=0.33,rig=phone,size=160x120,exposures=4,gain=0.3,white=4500,lock=shared --rig "
                "'%s/rig' --exposures 4 --out '%s/cap' --quiet 2>&1",
                dir, shell_bin(), dir, dir),
      0);
  assert_int_equal(calibrate(dir, "--white", "wide ultrawide tele", ""), 0);
  const double again = number_from(strstr(shell_out, "\"ultrawide\""), "\"gain_g\": ");
  print_message("green of the second camera, calibrated again: %.4f\n", again);
  assert_true(fabs(again - 1.3) < 0.013);
  assert_true(shared[0] < ideal - 1 && shared[1] > ideal - 0.2 && on > ideal - 0.6);
  assert_int_equal(temp_folder_remove(dir), 0);
}

TEST(test_boards) {
  char dir[256];
  need_board();
  assert_int_equal(temp_folder_make(dir, sizeof dir, "photometric"), 0);
  capture(dir,
          "sim:board,rig=stereo,path=sway,turn_deg_s=25,move_m_s=0.6,fps=2,size=400x300,vignetting=-0."
          "4," BRIGHTER,
          32);
  assert_int_equal(program(dir, "check", "--images", "left right", "--board 9x6 --spacing 0.12"), 0);
  assert_contains(shell_out, "right shows the boards' white squares otherwise than left");
  const double before = number_from(strstr(shell_out, "\"right\""), "\"light_g\": ");
  assert_int_equal(calibrate(dir, "--images", "left right", "--board 9x6"), 0);
  // the boards hardly reach the corners
  check_camera("\"left\"", same, 1e-6, 0.04);
  check_camera("\"right\"", brighter, 0.02, 0.04);
  assert_int_equal(program(dir, "check", "--images", "left right", "--board 9x6 --spacing 0.12"), 0);
  const double after = number_from(strstr(shell_out, "\"right\""), "\"light_g\": ");
  print_message("green of the squares: %.4f, after calibration %.4f\n", before, after);
  assert_true(fabs(before - 1.1) < 0.03 && fabs(after - 1) < 0.01);
  assert_null(strstr(shell_out, "white squares otherwise"));
  assert_int_equal(temp_folder_remove(dir), 0);
}

TEST(test_refused) {
  char dir[256];
  assert_int_equal(temp_folder_make(dir, sizeof dir, "photometric"), 0);
  capture(dir, "sim:textured,flat=0.33,rig=stereo,size=160x120,gain=0.9,white=3000", 2);
  assert_int_equal(calibrate(dir, "--white", "left right", ""), 1);
  assert_contains(shell_out, "of its pixels are saturated");
  assert_int_equal(calibrate(dir, "--white", "left", ""), 1);
  assert_contains(shell_out, "has 2 cameras, --white names 1");
  assert_int_equal(calibrate(dir, "", "", ""), 2);
  assert_contains(shell_out, "one of --white, --images and --run");
  assert_int_equal(calibrate(dir, "--images", "left right", ""), 2);
  assert_contains(shell_out, "--images and --board");
  assert_int_equal(shell_run("cat '%s/rig/rig.json'", dir), 0);
  assert_null(strstr(shell_out, "photometric"));
  assert_int_equal(temp_folder_remove(dir), 0);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_white_pictures),
                                     cmocka_unit_test(test_shared_light), cmocka_unit_test(test_boards),
                                     cmocka_unit_test(test_scene), cmocka_unit_test(test_refused)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
