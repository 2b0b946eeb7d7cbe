// SPDX-License-Identifier: Apache-2.0
// A maker's way with a fisheye: pictures of a chessboard, subview-calibrate board with the splined
// model, and a run of the rig, which is trained on with all of its field.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "calib/solve/boards.h"
#include "calib/solve/corners.h"
#include "platform/sim/sim.h"
#include "src/base/mathx.h"
#include "src/base/rng.h"
#include "src/format/cameramodel.h"
#include "tests/common/test.h"
#include "tools/common/fileio.h"
#include "tools/common/imageio.h"

#define W         640
#define H         480
#define N_BOARDS  36
#define COLS      9
#define ROWS      6
#define SPACING_M 0.05
#define N_SUB     2 // rays a pixel, each way
#define LENS      "lens=kb4:170"

static sv_err err;

static void need_solver(void) {
  if (sv_boards_available(&err) == SV_OK && sv_corners_available(COLS, ROWS, &err) == SV_OK) return;
  print_message("skip  this build has no mrcal, or finds no chessboards\n");
  skip();
}

// The lens that the simulator's option makes.
static sv_camera_model lens_of(const char *spec) {
  static uint8_t block[4 << 20] __attribute__((aligned(64)));
  static sv_sim sim;
  static sv_sim_config cfg;
  sv_arena a = sv_arena_make(block, sizeof block);
  assert_ok(sv_sim_parse(&cfg, spec, &err), &err);
  assert_ok(sv_sim_init(&sim, &cfg, &a, &err), &err);
  return sim.rig.sub_views[0].model;
}

// Grey of a board with a white edge where a ray meets it, else of a wall.
static double shade(const sv_pose *cam_from_board, const double ray[3]) {
  const double *r = cam_from_board->r, *t = cam_from_board->t;
  const double normal[3] = {r[2], r[5], r[8]}, along = sv_dot3(normal, ray);
  const double s = along != 0 ? sv_dot3(normal, t) / along : -1;
  if (!(s > 0)) return 0.4;
  double at[2];
  for (int k = 0; k < 2; k++) {
    at[k] = 0;
    for (int i = 0; i < 3; i++) at[k] += r[3 * i + k] * (s * ray[i] - t[i]);
    at[k] = at[k] / SPACING_M + 1; // squares from the outer corner of the pattern
  }
  if (at[0] < -1 || at[1] < -1 || at[0] > COLS + 2 || at[1] > ROWS + 2) return 0.4;
  if (at[0] < 0 || at[1] < 0 || at[0] > COLS + 1 || at[1] > ROWS + 1) return 0.9;
  return ((int)at[0] + (int)at[1]) % 2 ? 0.9 : 0.05;
}

static void take_pictures(const char *dir, const sv_camera_model *m) {
  static double ray[H * N_SUB][W * N_SUB][3];
  static uint8_t px[H * W * 3];
  sv_rng rng = sv_rng_make(7, 1);
  for (int y = 0; y < H * N_SUB; y++)
    for (int x = 0; x < W * N_SUB; x++) {
      const double uv[2] = {(x + 0.5) / N_SUB, (y + 0.5) / N_SUB};
      if (!sv_model_unproject(m, uv, ray[y][x])) ray[y][x][2] = 1;
    }
  for (int i = 0; i < N_BOARDS; i++) {
    const double off = 1.05 * sqrt((i + 0.5) / N_BOARDS), about = 2.4 * i;
    const double eye[3] = {0, 0, 0}, up[3] = {0, -1, 0.01},
                 at[3] = {sin(off) * cos(about), sin(off) * sin(about), cos(off)};
    double tilt[9], rot[3], middle[3] = {-0.5 * (COLS - 1) * SPACING_M, -0.5 * (ROWS - 1) * SPACING_M, 0};
    sv_pose look, p;
    char path[SV_CAP_PATH];
    for (int k = 0; k < 3; k++) rot[k] = (k < 2 ? 1.1 : 0.6) * ((double)sv_rng_f(&rng) - 0.5);
    assert_true(sv_pose_look_at(&look, eye, at, up));
    look = sv_pose_inv(&look);
    sv_rodrigues(tilt, rot);
    sv_mul33(p.r, look.r, tilt);
    sv_apply33(p.t, p.r, middle);
    for (int k = 0; k < 3; k++) p.t[k] += (0.42 + 0.15 * (double)sv_rng_f(&rng)) * at[k];
    for (int n = 0; n < W * H; n++) {
      double sum = 0;
      for (int k = 0; k < N_SUB * N_SUB; k++)
        sum += shade(&p, ray[n / W * N_SUB + k / N_SUB][n % W * N_SUB + k % N_SUB]);
      memset(px + 3 * n, (int)(255 * sum / (N_SUB * N_SUB) + 0.5), 3);
    }
    snprintf(path, sizeof path, "%s/board%02d.png", dir, i);
    const sv_bitmap b = {.width_px = W, .height_px = H, .n_channels = 3, .bits = 8, .u8 = px};
    assert_ok(sv_bitmap_write_png(path, &b, &err), &err);
  }
}

static sv_camera_model read_lens(const char *path) {
  static uint8_t block[1 << 20] __attribute__((aligned(64)));
  sv_arena a = sv_arena_make(block, sizeof block);
  sv_camera_model m;
  sv_pose pose;
  void *data;
  size_t bytes;
  assert_ok(sv_file_read(path, &data, &bytes, &err), &err);
  const sv_file_data file = {path, data, bytes};
  assert_ok(sv_cameramodel_read_splined(&file, &a, &m, &pose, &err), &err);
  free(data);
  return m;
}

// Angles between the rays of places of the picture do not depend on how the lens's frame is turned.
static double worst_angle_deg(const sv_camera_model *m, const sv_camera_model *truth) {
  double worst = 0, uv[2], a[2][3], b[2][3];
  for (int i = 0; i < 9; i++)
    for (int j = 0; j < i; j++) {
      for (int k = 0; k < 2; k++) {
        const int n = k ? j : i;
        uv[0] = W * (0.1 + 0.4 * (n % 3));
        uv[1] = H * (0.1 + 0.4 * (n / 3));
        assert_true(sv_model_unproject(m, uv, a[k]) && sv_model_unproject(truth, uv, b[k]));
      }
      worst = fmax(worst, fabs(sv_angle_between(a[0], a[1]) - sv_angle_between(b[0], b[1])));
    }
  return worst * 180 / SV_PI;
}

TEST(test_fisheye_rig) {
  char dir[256], path[512];
  need_solver();
  assert_int_equal(temp_folder_make(dir, sizeof dir, "fisheye"), 0);
  const sv_camera_model truth = lens_of("hall,rig=mono,size=640x480," LENS);
  take_pictures(dir, &truth);
  assert_int_equal(
      shell_run("'%s/subview-calibrate' board --images '%s/board*.png' --board 9x6 --spacing "
                "0.05 --model LENSMODEL_SPLINED_STEREOGRAPHIC --json --quiet --out '%s/rig' 2>&1",
                shell_bin(), dir, dir),
      0);
  const double rms = shell_number("\"rms_px\": "), corners = shell_number("\"corners\": ");
  snprintf(path, sizeof path, "%s/rig/board.cameramodel", dir);
  const sv_camera_model lens = read_lens(path);
  const double off_deg = worst_angle_deg(&lens, &truth);
  print_message("%.0f corners, %.3f px RMS, rays off by at most %.3f degrees\n", corners, rms, off_deg);
  assert_true(corners > 15 * COLS * ROWS && rms < 0.3 && off_deg < 0.3);
  assert_int_equal(temp_folder_remove(dir), 0);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_fisheye_rig)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
