// SPDX-License-Identifier: Apache-2.0
// subview-calibrate lenslets on simulated pictures: a ray-traced scene through each lens of a
// multiplexed sensor alone, and white pictures with round, partly lit footprints. The alignment of
// patches that it is built on.
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "calib/solve/align.h"
#include "calib/solve/structure.h"
#include "src/base/mathx.h"
#include "src/base/rng.h"
#include "tests/common/isolated.h"
#include "tests/common/test.h"
#include "tools/calibrate/calibrate.h"
#include "tools/common/coverage.h"

static isolated set;
static sv_err err;

// --- a chessboard through the lenses -------------------------------------------------------------
enum { COLS = 7, ROWS = 6 };
#define SQUARE_M 0.2

// What a lens sees of a board of (COLS + 1) x (ROWS + 1) squares with a white rim, on grey; 4 x 4
// samples a pixel.
static void render_board(const sv_sub_view *v, const sv_pose *rig_from_board, uint8_t *rgb) {
  sv_pose p = sv_pose_mul(&v->cam_from_rig, rig_from_board);
  const double *n = (double[3]){p.r[2], p.r[5], p.r[8]};
  for (int y = 0; y < v->model.height_px; y++)
    for (int x = 0; x < v->model.width_px; x++) {
      double sum = 0;
      for (int k = 0; k < 16; k++) {
        double d[3] = {(x + (k % 4 + 0.5) / 4 - v->model.p[2]) / v->model.p[0],
                       (y + (k / 4 + 0.5) / 4 - v->model.p[3]) / v->model.p[1], 1};
        double t = sv_dot3(n, p.t) / sv_dot3(n, d), q[3] = {d[0] * t - p.t[0], d[1] * t - p.t[1], t - p.t[2]};
        double u = (p.r[0] * q[0] + p.r[3] * q[1] + p.r[6] * q[2]) / SQUARE_M + 1,
               w = (p.r[1] * q[0] + p.r[4] * q[1] + p.r[7] * q[2]) / SQUARE_M + 1;
        bool is_board = t > 0 && u > -0.5 && w > -0.5 && u < COLS + 1.5 && w < ROWS + 1.5;
        bool is_square = u > 0 && w > 0 && u < COLS + 1 && w < ROWS + 1;
        bool is_black = is_square && ((int)u + (int)w) % 2 == 0;
        sum += is_board ? is_black ? 0.1 : 0.8 : 0.3;
      }
      for (int c = 0; c < 3; c++)
        rgb[3 * (y * v->model.width_px + x) + c] = (uint8_t)lrint(255 * isolated_srgb(sum / 16));
    }
}

static void make_board_pictures(int n_exposures) {
  const sv_sim *sim = &set.sim;
  sv_rng rng = sv_rng_make(8, 1);
  uint8_t *rgb = malloc((size_t)sim->cfg.width_px * (size_t)sim->cfg.height_px * 3);
  for (int e = 0; e < n_exposures; e++) {
    double w[3], middle[3] = {0.5 * (COLS - 1) * SQUARE_M, 0.5 * (ROWS - 1) * SQUARE_M, 0}, at[3];
    for (int k = 0; k < 3; k++) w[k] = (k < 2 ? 1.5 : 0.3) * ((double)sv_rng_f(&rng) - 0.5);
    for (int k = 0; k < 3; k++) at[k] = (k < 2 ? 0.7 : 1.2) * ((double)sv_rng_f(&rng) - 0.5);
    sv_pose p;
    sv_rodrigues(p.r, w);
    sv_apply33(middle, p.r, middle);
    for (int k = 0; k < 3; k++) p.t[k] = at[k] - middle[k] + (k == 2 ? SV_SIM_DISTANCE_M : 0);
    for (int i = 0; i < sim->rig.n_sub_views; i++) {
      render_board(&sim->rig.sub_views[i], &p, rgb);
      isolated_save(&set, e, i, rgb);
    }
  }
  free(rgb);
}

static void check_footprint(const sv_sub_view *v, const sv_sub_view *want) {
  const sv_footprint *f = &v->footprint, *g = &want->footprint;
  double sum = 0, diff = 0;
  for (int y = 0; y < g->height_px; y++)
    for (int x = 0; x < g->width_px; x++) {
      int fx = x + g->x0_px - f->x0_px, fy = y + g->y0_px - f->y0_px;
      bool is_in = fx >= 0 && fy >= 0 && fx < f->width_px && fy < f->height_px;
      double c = is_in ? f->coverage[fy * f->width_px + fx] / 255.0 : 0;
      // The plateau is the brightest 5 % of the lit part: in a disc, what d^2 < r^2 / 20 sees at
      // least.
      double want_share = fmin(1, isolated_share(&set, g, x, y) / (1 - ISOLATED_FALL_OFF * 0.05));
      sum += want_share;
      diff += fabs(c - want_share);
    }
  if (!(diff < 0.01 * sum)) fail_msg("%s: coverage is off by %.2f %%", v->name, 100 * diff / sum);
}

static void calibrate(const char *spec, bool is_board, int n_exposures, double limit_deg,
                      double limit_focal) {
  static uint8_t block[1 << 20], room[1 << 20];
  const sv_rig *want = &set.sim.rig;
  isolated_open(&set, spec, false, n_exposures);
  if (is_board) make_board_pictures(n_exposures);
  else isolated_scene(&set, n_exposures);
  double a[3], b[3];
  sv_pose_centre(a, &want->sub_views[0].cam_from_rig);
  sv_pose_centre(b, &want->sub_views[1].cam_from_rig);
  sv_sub3(a, a, b);
  cal_options o = {.isolated = set.isolated,
                   .white = set.white,
                   .out = set.out,
                   .dark = -1,
                   .threads = 2,
                   .spacing_m = -1,
                   .focal_px = -1,
                   .is_quiet = true};
  if (is_board) {
    o.board = "7x6";
    o.n_cols = COLS;
    o.n_rows = ROWS;
    o.spacing_m = SQUARE_M;
  } else o.pitch_m = sv_norm3(a);
  assert_int_equal(cal_cmd_lenslets(&o), CAL_EXIT_OK);
  sv_rig rig;
  sv_arena arena = sv_arena_make(block, sizeof block), scratch = sv_arena_make(room, sizeof room);
  isolated_read_rig(&set, &rig, &arena, &scratch);
  assert_int_equal(rig.n_sub_views, want->n_sub_views);
  assert_int_equal((int)rig.forward, SV_FORWARD_MULTIPLEXED);
  for (int i = 0; i < rig.n_sub_views; i++) check_footprint(&rig.sub_views[i], &want->sub_views[i]);
  isolated_errors e = isolated_compare(&rig, want);
  printf("%s: rotation %.4f degrees, focal length %.3f %%, place %.3f %% of the array\n",
         is_board ? "board" : "texture", e.rotation_deg, 100 * e.focal, 100 * e.place);
  assert_true(e.rotation_deg < limit_deg && e.focal < limit_focal);
  sv_coverage_free(&rig);
  isolated_close(&set);
}

TEST(test_texture) {
  if (!sv_structure_available()) {
    printf("skip  this build has no OpenCV to match pictures with (libopencv-dev)\n");
    skip();
  }
  calibrate("room,rig=multiplexed,size=360x360,grid=3x3", false, 3, 0.05, 0.01);
}

TEST(test_board) {
  if (sv_boards_available(&err) != SV_OK || !sv_structure_available()) {
    printf("skip  this build has no mrcal or OpenCV\n");
    skip();
  }
  calibrate("textured,rig=multiplexed,size=480x480,grid=3x3", true, 8, 0.1, 0.01);
}

// A picture seen through a known map, with another gain and offset: place and map are found to a
// hundredth of a pixel.
static double bumps(double x, double y) {
  return 128 + 50 * sin(0.41 * x + 0.13 * y) * cos(0.29 * y - 0.17 * x) + 30 * sin(0.11 * x - 0.53 * y);
}

TEST(test_align) {
  enum { W = 64 };
  static uint8_t a[W * W], b[W * W], flat[W * W];
  static const double map[4] = {1.06, 0.04, -0.07, 0.93}, to[2] = {31.4, 29.3}, at[2] = {30.2, 33.7};
  double det = map[0] * map[3] - map[1] * map[2], worst = 0;
  for (int i = 0; i < W * W; i++) {
    double dx = i % W - to[0], dy = i / W - to[1]; // b at `to` + map d is a at `at` + d
    a[i] = (uint8_t)lrint(bumps(i % W, i / W));
    flat[i] = 90;
    b[i] = (uint8_t)lrint(20 + 0.7 * bumps(at[0] + (map[3] * dx - map[1] * dy) / det,
                                           at[1] + (map[0] * dy - map[2] * dx) / det));
  }
  sv_align_image ia = {W, W, a}, ib = {W, W, b}, none = {W, W, flat};
  for (int k = 0; k < 9; k++) {
    double uv[2] = {to[0] + 0.7 * (k % 3 - 1), to[1] + 0.7 * (k / 3 - 1)}, warp[4] = {1, 0, 0, 1};
    assert_true(sv_align_patch(&ia, at, &ib, uv, warp) > 0.99);
    worst = fmax(worst, hypot(uv[0] - to[0], uv[1] - to[1]));
    for (int i = 0; i < 4; i++) assert_true(fabs(warp[i] - map[i]) < 0.01);
  }
  printf("alignment: %.4f px\n", worst);
  assert_true(worst < 0.01);
  double uv[2] = {to[0], to[1]}, warp[4] = {1, 0, 0, 1}, edge[2] = {5, 30};
  assert_true(sv_align_patch(&ia, at, &none, uv, warp) == -1);
  assert_true(sv_align_patch(&none, at, &ia, uv, warp) == -1);
  assert_true(sv_align_patch(&ia, edge, &ib, uv, warp) == -1);
}

// Lenses and poses from points that are seen with noise: no pictures.
TEST(test_lens_array) {
  enum { N = 9, N_POINTS = 1500 };
  static sv_sub_view views[N];
  static sv_camera_model models[N];
  static sv_pose poses[N];
  static double points[N_POINTS][3], centre[N][2];
  static sv_array_observation seen[N * N_POINTS];
  sv_rig rig = {.sub_views = views, .cap_sub_views = N};
  sv_device_params p = sv_device_defaults(SV_DEVICE_MULTIPLEXED);
  p.width_px = p.height_px = 480;
  p.focal_per_width = 1.1;
  p.distance_m = 4;
  p.angle_rad = 0.17;
  p.rows = p.cols = 3;
  assert_ok(sv_device_build(&rig, &p, &err), &err);
  sv_lens_array a = {.n_views = N,
                     .n_points = N_POINTS,
                     .models = models,
                     .cam_from_rig = poses,
                     .points = points,
                     .observations = seen,
                     .focal_sd = 0.01,
                     .centre_sd_px = 0.05,
                     .centre_px = centre};
  sv_rng rng = sv_rng_make(5, 1);
  sv_pose back = sv_pose_inv(&views[0].cam_from_rig);
  for (int i = 0; i < N_POINTS; i++) {
    double x[3] = {0, 0, 4};
    for (int k = 0; k < 3; k++) x[k] += 2.4 * (double)sv_rng_f(&rng) - 1.2;
    sv_pose_apply(points[i], &views[0].cam_from_rig, x);
    for (int c = 0; c < N; c++) {
      double y[3];
      sv_array_observation *o = &seen[a.n_observations];
      sv_pose_apply(y, &views[c].cam_from_rig, x);
      if (!sv_model_project(&views[c].model, y, o->uv_px, NULL, NULL)) continue;
      *o = (sv_array_observation){c, i, {o->uv_px[0], o->uv_px[1]}, false};
      for (int k = 0; k < 2; k++) o->uv_px[k] += 0.1 * (double)sv_rng_normal(&rng);
      if (sv_rng_below(&rng, 50) == 0) o->uv_px[0] += 8; // wrong matches
      a.n_observations++;
    }
  }
  for (int c = 0; c < N; c++) {
    double w[3], off[9];
    poses[c] = sv_pose_mul(&views[c].cam_from_rig, &back);
    for (int k = 0; k < 3; k++) w[k] = c ? 0.01 * ((double)sv_rng_f(&rng) - 0.5) : 0;
    sv_rodrigues(off, w);
    sv_mul33(poses[c].r, off, poses[c].r);
    models[c] = views[c].model;
    models[c].p[0] *= 1.1;
    models[c].p[1] *= 1.1;
    for (int k = 0; k < 2; k++) centre[c][k] = models[c].p[2 + k];
  }
  sv_array_stats st;
  assert_ok(sv_array_solve(&a, 5, &st, &err), &err);
  sv_rig got = {.sub_views = calloc(N, sizeof(sv_sub_view)), .n_sub_views = N};
  for (int c = 0; c < N; c++) {
    got.sub_views[c].cam_from_rig = poses[c];
    got.sub_views[c].model = models[c];
  }
  isolated_errors e = isolated_compare(&got, &rig);
  printf("points: sigma %.4f px, %d left out, rotation %.4f degrees (sd %.4f), focal length %.3f %% (sd %.3f "
         "%%)\n",
         st.sigma_px, st.n_outliers, e.rotation_deg, st.rotation_sd_deg, 100 * e.focal,
         100 * st.focal_sd_px / models[0].p[0]);
  free(got.sub_views);
  assert_true(fabs(st.sigma_px / 0.1 - 1) < 0.15);
  assert_true(e.rotation_deg < 4 * st.rotation_sd_deg && e.rotation_deg < 0.1);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_align), cmocka_unit_test(test_lens_array),
                                     cmocka_unit_test(test_texture), cmocka_unit_test(test_board)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
