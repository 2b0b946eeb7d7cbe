// SPDX-License-Identifier: Apache-2.0
// Folders as RealSense's and DepthAI's own programs leave them, made from a simulated stereo rig:
// pictures, rig and, of the former, depth in meters as a prior; hostile ones get one sentence.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/format/rig_file.h"
#include "tests/common/lab_shell.h"
#include "tests/common/test.h"
#include "tools/common/fileio.h"

enum { W = 160, H = 120, N = 6 };

static lab_shell shell = {.cwd = ""};
static sv_err err;
static sv_rig rig;

static void expect(int code, const char *sentence, const char *line) {
  const int got = lab_shell_run(&shell, line);
  if (got != code || !strstr(shell.said, sentence)) fail_msg("%s: exit %d: %s", line, got, shell.said);
}

static void read_rig(const char *folder) {
  static uint8_t block[256 << 10], scratch_block[256 << 10];
  char path[600];
  snprintf(path, sizeof path, "%s/%s", shell.root, folder);
  sv_arena arena = sv_arena_make(block, sizeof block),
           scratch = sv_arena_make(scratch_block, sizeof scratch_block);
  const sv_file_reader files = {path, sv_folder_read};
  assert_int_equal(sv_rig_init(&rig, 8, &arena), SV_OK);
  assert_ok(sv_rig_read(&rig, &files, -1, &scratch, &err), &err);
}

static double baseline(void) {
  double a[3], b[3];
  sv_pose_centre(a, &rig.sub_views[0].cam_from_rig);
  sv_pose_centre(b, &rig.sub_views[1].cam_from_rig);
  return sqrt((a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1]) + (a[2] - b[2]) * (a[2] - b[2]));
}

static void save(const char *name, const void *data, size_t bytes) {
  char path[600];
  snprintf(path, sizeof path, "%s/%s", shell.root, name);
  assert_ok(sv_file_write(path, data, bytes, &err), &err);
}

// right_from_left of the rig.
static sv_pose right_from_left(void) {
  const sv_pose back = sv_pose_inv(&rig.sub_views[0].cam_from_rig);
  return sv_pose_mul(&rig.sub_views[1].cam_from_rig, &back);
}

static int add_lens(char *out, size_t cap, const char *stream, const char *distortion) {
  const double *p = rig.sub_views[0].model.p;
  return snprintf(
      out, cap,
      " Intrinsic of \"%s\" / 160x120 / {Y8}\n  Width:      \t160\n  Height:     \t120\n  PPX:        "
      "\t%.9g\n"
      "  PPY:        \t%.9g\n  Fx:         \t%.9g\n  Fy:         \t%.9g\n  Distortion: \t%s\n  Coeffs:     "
      "\t%s  \t0  \t0  \t0  \t0  \n  FOV (deg):  \t42 x 32\n\n",
      stream, p[2] - 0.5, p[3] - 0.5, p[0], p[1], distortion,
      strcmp(distortion, "Inverse Brown Conrady") == 0 ? "0.1" : "0");
}

static int add_pose(char *out, size_t cap, const char *from, const char *to, const sv_pose *p) {
  const double *r = p->r;
  return snprintf(out, cap,
                  "Extrinsic from \"%s\"\t  To\t  \"%s\" :\n Rotation Matrix:\n %.9g %.9g %.9g\n %.9g %.9g "
                  "%.9g\n %.9g %.9g "
                  "%.9g\n\n Translation Vector: %.9g  %.9g  %.9g  \n\n",
                  from, to, r[0], r[1], r[2], r[3], r[4], r[5], r[6], r[7], r[8], p->t[0], p->t[1], p->t[2]);
}

static void save_calibration(const char *distortion) {
  static char text[8192];
  const sv_pose same = sv_pose_identity(), pose = right_from_left();
  size_t n = 0;
  n += (size_t)add_lens(text + n, sizeof text - n, "Depth", "Brown Conrady");
  n += (size_t)add_lens(text + n, sizeof text - n, "Infrared 1", distortion);
  n += (size_t)add_lens(text + n, sizeof text - n, "Infrared 2", "Brown Conrady");
  n += (size_t)add_pose(text + n, sizeof text - n, "Depth", "Infrared 1", &same);
  n += (size_t)add_pose(text + n, sizeof text - n, "Infrared 1", "Depth", &same);
  n += (size_t)add_pose(text + n, sizeof text - n, "Infrared 1", "Infrared 2", &pose);
  save("rs/calibration.txt", text, n);
}

static int setup(void **state) {
  static uint8_t raw[2 * W * H];
  (void)state;
  const int r = lab_shell_open(&shell, "depth_cameras");
  if (r < 0) return -1;
  shell.is_ready = r == 0 && lab_shell_run(&shell, "ffmpeg -version") == 0;
  if (!shell.is_ready) return 0;
  lab_shell_run_well(&shell,
                     "$(dirname @)/subview capture --source sim:textured,rig=stereo,size=160x120,fps=20 "
                     "--exposures 6 --quiet --out cap && mkdir rs oak");
  read_rig("cap/rig");
  for (int i = 0; i < W * H; i++) { // 2.5 m, and in the first row none
    raw[2 * i] = i < W ? 0 : 2500 & 255;
    raw[2 * i + 1] = i < W ? 0 : 2500 >> 8;
  }
  for (int i = 0; i < N; i++) {
    char name[100], line[500];
    snprintf(name, sizeof name, "rs/x_Depth_%.14f.raw", 1.7e12 + 50.0 * i);
    save(name, raw, sizeof raw);
    snprintf(line, sizeof line,
             "ffmpeg -v error -nostdin -i cap/left/%06d.jpg 'rs/x_Infrared 1_%.14f.png' && ffmpeg -v error "
             "-nostdin -i "
             "cap/right/%06d.jpg 'rs/x_Infrared 2_%.14f.png'",
             i, 1.7e12 + 50.0 * i, i, 1.7e12 + 50.0 * i + 0.01);
    lab_shell_run_well(&shell, line);
  }
  save_calibration("Brown Conrady");
  return 0;
}
static int teardown(void **state) {
  (void)state;
  return lab_shell_close(&shell);
}

TEST(test_realsense) {
  lab_shell_need(&shell);
  read_rig("cap/rig");
  const double want_m = baseline(), focal_px = rig.sub_views[0].model.p[0];
  expect(0, "6 exposures of 2 cameras, 6 with depth", "@ import --from realsense rs --out a");
  lab_shell_run_well(&shell, "cmp a/right/000004.png 'rs/x_Infrared 2_1700000000200.01000976562500.png'");
  read_rig("a/rig");
  assert_near(baseline(), want_m, 1e-6);
  assert_near(rig.sub_views[1].model.p[0], focal_px, 1e-4);
  char path[600];
  void *data;
  size_t bytes;
  float depth[2];
  snprintf(path, sizeof path, "%s/a/left_depth/000000.pfm", shell.root);
  assert_ok(sv_file_read(path, &data, &bytes, &err), &err);
  memcpy(&depth[0], (char *)data + bytes - 4 * W * H, 4); // of the lowest row, which comes first
  memcpy(&depth[1], (char *)data + bytes - 4, 4);         // of the top row
  free(data);
  assert_near(depth[0], 2.5, 1e-5);
  assert_near(depth[1], 0, 0);
  // Into a dataset, where it is the prior of the left camera.
  lab_shell_run_well(
      &shell,
      "@ import --from capture a --out a.data --quiet && grep -o depth_prior a.data/transforms.json | wc -l");
  assert_contains(shell.said, "6");
  lab_shell_run_well(&shell, "@ train --data a.data --prior fsgs --steps 3 --gaussians 300 --quiet --out m");
  expect(0, "3 exposures", "@ import --from realsense rs --every 0.1 --unit 0.0005 --out a");
}

TEST(test_hostile_realsense) {
  lab_shell_need(&shell);
  read_rig("cap/rig");
  save_calibration("Inverse Brown Conrady");
  expect(1, "has the distortion 'Inverse Brown Conrady'", "@ import --from realsense rs --out b");
  save_calibration("Brown Conrady");
  lab_shell_run_well(&shell, "mkdir odd && cp rs/* odd/ && for f in odd/*.raw; do echo >$f; done");
  expect(1, "expected 160x120 depths of 16 bits", "@ import --from realsense odd --out b");
  lab_shell_run_well(&shell, "grep -v Translation rs/calibration.txt >odd/calibration.txt");
  expect(1, "no rotation and translation", "@ import --from realsense odd --out b");
  expect(1, "has no section 'Intrinsic of",
         "echo >odd/calibration.txt && @ import --from realsense odd --out b");
  expect(1, "calibration.txt", "@ import --from realsense cap --out b");
}

static int add_socket(char *out, size_t cap, int socket, int to, const double t_cm[3]) {
  const double *p = rig.sub_views[0].model.p;
  return snprintf(out, cap,
                  "[%d, {\"cameraType\": 0, \"distortionCoeff\": [0,0,0,0,0,0,0,0,0,0,0,0,0,0], \"width\": "
                  "320, \"height\": "
                  "250, \"intrinsicMatrix\": [[%.9g, 0, %.9g], [0, %.9g, %.9g], [0, 0, 1]], \"extrinsics\": "
                  "{\"rotationMatrix\": "
                  "[[1,0,0],[0,1,0],[0,0,1]], \"translation\": {\"x\": %.9g, \"y\": %.9g, \"z\": %.9g}, "
                  "\"toCameraSocket\": %d}}]",
                  socket, 2 * p[0], 2 * p[2] - 0.5, 2 * p[1], 2 * p[3] - 0.5 + 5, t_cm[0], t_cm[1], t_cm[2],
                  to);
}

// The sensor has twice the pixels and ten rows more, five on each side.
TEST(test_oak) {
  static char text[8192];
  lab_shell_need(&shell);
  read_rig("cap/rig");
  const double want_m = baseline(), *p = rig.sub_views[0].model.p;
  const double fx = p[0], cx = p[2], cy = p[3];
  const double t_cm[3] = {-100 * want_m, 0, 0}, none[3] = {0, 0, 0};
  size_t n = (size_t)snprintf(text, sizeof text, "{\"boardName\": \"made\", \"cameraData\": [");
  n += (size_t)add_socket(text + n, sizeof text - n, 1, 2, t_cm);
  n += (size_t)snprintf(text + n, sizeof text - n, ", ");
  n += (size_t)add_socket(text + n, sizeof text - n, 2, -1, none);
  n += (size_t)snprintf(text + n, sizeof text - n, "]}");
  save("oak/calib.json", text, n);
  lab_shell_run_well(
      &shell,
      "for i in left right; do ffmpeg -v error -nostdin -y -framerate 25 -i cap/$i/%06d.jpg -c copy -f "
      "mjpeg oak/$i.mjpeg; done");
  expect(0, "6 exposures of 2 cameras", "@ import --from oak oak --out c");
  read_rig("c/rig");
  assert_near(baseline(), want_m, 1e-6);
  assert_near(rig.sub_views[0].model.p[0], fx, 1e-4);
  assert_near(rig.sub_views[0].model.p[2], cx, 1e-4);
  assert_near(rig.sub_views[0].model.p[3], cy, 1e-4);
  lab_shell_run_well(&shell,
                     "ffmpeg -nostdin -i c/right/000005.png -i cap/right/000005.jpg -lavfi psnr -f null -");
  const char *db = strstr(shell.said, "average:");
  assert_non_null(db);
  assert_true(strncmp(db, "average:inf", 11) == 0 || strtod(db + 8, NULL) > 40);
  lab_shell_run_well(&shell, "@ import --from capture c --out c.data --quiet");
  expect(1, "has no camera of socket 0 (color)",
         "cp oak/left.mjpeg oak/color.mjpeg && @ import --from oak oak --out c");
  expect(1, "calib.json",
         "echo '{\"cameraData\": [[1, 2' >oak/calib.json && @ import --from oak oak --out c");
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_realsense),
      cmocka_unit_test(test_hostile_realsense),
      cmocka_unit_test(test_oak),
  };
  return cmocka_run_group_tests(tests, setup, teardown);
}
