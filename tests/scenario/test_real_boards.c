// SPDX-License-Identifier: Apache-2.0
// subview-calibrate board and check on real pictures: the stereo pairs and stills of tests/data.
#include <math.h>
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "calib/solve/boards.h"
#include "calib/solve/corners.h"
#include "tests/common/test.h"
#include "tools/calibrate/calibrate.h"

static sv_err err;

static void need_mrcal(void) {
  if (sv_boards_available(&err) == SV_OK && sv_corners_has_opencv()) return;
  printf("skip  this build has no mrcal or OpenCV\n");
  skip();
}

static cal_options options_of(const char *model, const char *out) {
  return (cal_options){.model = model, .out = out, .threads = 2, .is_quiet = true, .pitch_m = -1, .dark = -1};
}

static double focal_of(const char *folder, const char *name) {
  char path[SV_CAP_PATH + 80];
  void *data;
  size_t bytes;
  snprintf(path, sizeof path, "%s/%s.cameramodel", folder, name);
  assert_ok(sv_file_read(path, &data, &bytes, &err), &err);
  double f = 0;
  const char *at = strstr(data, "'intrinsics': [");
  assert_non_null(at);
  f = strtod(at + 15, NULL);
  free(data);
  return f;
}

static void out_folder(char *out, const char *name) {
  const char *tmp = getenv("TMPDIR");
  snprintf(out, SV_CAP_PATH, "%s/subview-boards-%ld-%s", tmp ? tmp : "/tmp", (long)getpid(), name);
}

static void remove_folder(const char *folder) {
  char command[SV_CAP_PATH + 20];
  snprintf(command, sizeof command, "rm -rf '%s'", folder);
  if (system(command) != 0) printf("%s stays\n", folder);
}

TEST(test_real_stereo) {
  static const char left[] = "tests/data/stereo_chessboard/left*.jpg",
                    right[] = "tests/data/stereo_chessboard/right*.jpg";
  char out[SV_CAP_PATH];
  need_mrcal();
  out_folder(out, "stereo");
  cal_options o = options_of("LENSMODEL_OPENCV5", out);
  o.images.of[0] = left;
  o.images.of[1] = right;
  o.images.n = 2;
  o.n_cols = 9;
  o.n_rows = 6;
  o.spacing_m = 0.025;
  assert_int_equal(cal_cmd_board(&o), CAL_EXIT_OK);
  double l = focal_of(out, "left"), r = focal_of(out, "right");
  assert_true(fabs(l / 534.803 - 1) < 0.01 &&
              fabs(r / 534.803 - 1) < 0.01); // intrinsics.yml beside the pictures
  char path[SV_CAP_PATH + 40];
  void *data;
  size_t bytes;
  snprintf(path, sizeof path, "%s/calibration.json", out);
  assert_int_equal(sv_file_read(path, &data, &bytes, &err), SV_OK);
  double rms = strtod(strstr(data, "\"rms_px\": ") + 10, NULL);
  assert_true(rms > 0.05 && rms < 0.35);
  assert_contains(data, "\"pictures\": 14, \"boards\": 13"); // all pairs; left.jpg shows no board
  free(data);
  assert_int_equal(cal_cmd_board(&o), CAL_EXIT_OK); // from corners.txt
  assert_true(fabs(focal_of(out, "left") / l - 1) < 1e-9);
  cal_options check = options_of(NULL, NULL);
  check.rig = out;
  check.images.of[0] = left;
  check.images.of[1] = right;
  check.images.n = 2;
  check.board = "9x6";
  check.n_cols = 9;
  check.n_rows = 6;
  check.spacing_m = 0.025;
  assert_int_equal(cal_cmd_check(&check), CAL_EXIT_OK);
  // Ctrl-C: what was found before is kept, and no file of a result is begun.
  char command[3 * SV_CAP_PATH];
  snprintf(command, sizeof command,
           "cd '%s' && cp corners.txt .found && rm -r plots rig.json calibration.json residuals.csv "
           "*.cameramodel",
           out);
  assert_int_equal(system(command), 0);
  assert_int_equal(sv_linux_catch_signals(&err), SV_OK);
  assert_int_equal(raise(SIGINT), 0);
  assert_int_equal(cal_cmd_board(&o), CAL_EXIT_FAILED);
  sv_linux_reset_stop();
  snprintf(command, sizeof command, "cd '%s' && cmp corners.txt .found && test \"$(ls)\" = corners.txt", out);
  assert_int_equal(system(command), 0);
  remove_folder(out);
}

TEST(test_real_stills) {
  static const double want[4] = {107599.671875, 107118.695313, 107622.296875,
                                 107215.039063}; // 1/64 px, full size
  char out[SV_CAP_PATH];
  need_mrcal();
  for (int c = 0; c < 4; c++) {
    char images[80], name[16];
    snprintf(images, sizeof images, "tests/data/qca_chessboard/cam0%d_*_int.jpg", c + 1);
    snprintf(name, sizeof name, "cam0%d", c + 1);
    out_folder(out, name);
    cal_options o = options_of(NULL, out);
    o.images.of[0] = images;
    o.images.n = 1;
    o.n_cols = 4;
    o.n_rows = 7;
    o.spacing_m = 0.06;
    assert_int_equal(cal_cmd_board(&o), CAL_EXIT_OK);
    assert_true(fabs(focal_of(out, name) / (want[c] / 128) - 1) < 0.015);
    remove_folder(out);
  }
}

// Boards that were captured by subview: the rig knows what part of the sensor they show.
TEST(the_capture_tells_the_part_of_the_sensor) {
  sv_sensor_area a;
  temp_put_text(
      "board/capture.json",
      "{\"version\":1,\"cameras\":[{\"name\":\"cam\",\"folder\":\"video0\",\"width\":1332,\"height\":990,"
      "\"sensor\":[4056,3040],\"area\":[696,528,2664,1980],\"frames\":[]}]}");
  assert_true(cal_sensor_area(temp_path("board/video0/000010.jpg"), (const int[2]){1332, 990}, &a));
  assert_true(a.sensor_width_px == 4056 && a.x0_px == 696 && a.height_px == 1980);
  assert_false(cal_sensor_area(temp_path("board/video0/000010.jpg"), (const int[2]){666, 495}, &a));
  assert_false(cal_sensor_area(temp_path("board/video1/000010.jpg"), (const int[2]){1332, 990}, &a));
  assert_false(cal_sensor_area(temp_path("elsewhere/video0/a.jpg"), (const int[2]){1332, 990}, &a));
  assert_false(cal_sensor_area("a.jpg", (const int[2]){1332, 990}, &a));
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_real_stereo), cmocka_unit_test(test_real_stills),
                                     cmocka_unit_test(the_capture_tells_the_part_of_the_sensor)};
  return cmocka_run_group_tests(tests, temp_folder_setup, temp_folder_teardown);
}
