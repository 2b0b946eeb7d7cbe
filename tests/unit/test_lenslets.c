// SPDX-License-Identifier: Apache-2.0
// subview-calibrate lenslets on simulated pictures: a ray-traced scene through each lens of a multiplexed sensor
// alone, and white pictures with round, partly lit footprints.
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "calib/solve/structure.h"
#include "platform/sim/sim.h"
#include "src/base/mathx.h"
#include "src/base/rng.h"
#include "src/format/rig_file.h"
#include "tools/calibrate/calibrate.h"
#include "tools/common/coverage.h"
#include "tools/common/fileio.h"
#include "tools/common/imageio.h"

static sv_err err;
static char folder[SV_CAP_PATH], white[SV_CAP_PATH], isolated[SV_CAP_PATH], out[SV_CAP_PATH];

static void in_folder(char *path, const char *name) {
  assert_int_equal(sv_path_join(path, SV_CAP_PATH, folder, name, &err), SV_OK);
}

static double light_of(double s) { return s <= 0.04045 ? s / 12.92 : pow((s + 0.055) / 1.055, 2.4); }
static double srgb_of(double l) { return l <= 0.0031308 ? 12.92 * l : 1.055 * pow(l, 1 / 2.4) - 0.055; }

// A lens's true share of light: a disc as wide as its rectangle with a rim of one pixel, darker outwards.
#define FALL_OFF 0.25
static double share(const sv_footprint *f, int x, int y) {
  double r = 0.5 * f->width_px - 1, dx = x + 0.5 - 0.5 * f->width_px, dy = y + 0.5 - 0.5 * f->height_px;
  double d = sqrt(dx * dx + dy * dy), rim = r + 0.5 - d;
  return (rim < 0 ? 0 : rim > 1 ? 1 : rim) * (1 - FALL_OFF * d * d / (r * r));
}

// One sensor picture, 16 bits sRGB-encoded, with read noise; rgb NULL: white.
static void save(const char *path, const sv_sim *sim, const sv_footprint *f, const uint8_t *rgb,
                 sv_rng *rng) {
  int w = sim->cfg.width_px, h = sim->cfg.height_px;
  sv_bitmap b = {.width_px = w, .height_px = h, .n_channels = 1, .bits = 16};
  b.u16 = malloc((size_t)w * (size_t)h * 2);
  for (int y = 0; y < h; y++)
    for (int x = 0; x < w; x++) {
      int lx = x - f->x0_px, ly = y - f->y0_px;
      double v = 0.004;
      if (lx >= 0 && ly >= 0 && lx < f->width_px && ly < f->height_px) {
        const uint8_t *p = rgb ? rgb + 3 * (ly * f->width_px + lx) : NULL;
        double l = p ? (light_of(p[0] / 255.0) + light_of(p[1] / 255.0) + light_of(p[2] / 255.0)) / 3 : 0.85;
        v += l * share(f, lx, ly);
      }
      v += 0.002 * (double)sv_rng_normal(rng);
      b.u16[y * w + x] = (uint16_t)lrint(65535 * srgb_of(v < 0 ? 0 : v > 1 ? 1 : v));
    }
  if (sv_bitmap_write_png(path, &b, &err) != SV_OK) fail_msg("%s", err.text);
  free(b.u16);
}

static void make_pictures(sv_sim *sim, int n_exposures) {
  sv_rng rng = sv_rng_make(3, 1);
  uint8_t *rgb = malloc((size_t)sim->cfg.width_px * (size_t)sim->cfg.height_px * 3);
  for (int e = -1; e < n_exposures; e++)
    for (int i = 0; i < sim->rig.n_sub_views; i++) {
      const sv_sub_view *v = &sim->rig.sub_views[i];
      char path[SV_CAP_PATH], name[80];
      sv_view view;
      double time_s;
      snprintf(name, sizeof name, "e%02d/%s.png", e, v->name);
      if (e < 0) snprintf(name, sizeof name, "%s.png", v->name);
      assert_int_equal(sv_path_join(path, sizeof path, e < 0 ? white : isolated, name, &err), SV_OK);
      if (e >= 0) {
        sv_sim_view(sim, e, i, &view, &time_s);
        sv_sim_render(sim, &view, 0, rgb, NULL);
      }
      save(path, sim, &v->footprint, e < 0 ? NULL : rgb, &rng);
    }
  free(rgb);
}

// --- a chessboard through the lenses --------------------------------------------------------------
enum { COLS = 7, ROWS = 6 };
#define SQUARE_M 0.2

// What a lens sees of a board of (COLS + 1) x (ROWS + 1) squares with a white rim, on grey; 4 x 4 samples a pixel.
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
        rgb[3 * (y * v->model.width_px + x) + c] = (uint8_t)lrint(255 * srgb_of(sum / 16));
    }
}

static void make_board_pictures(sv_sim *sim, int n_exposures) {
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
      char path[SV_CAP_PATH], name[80];
      snprintf(name, sizeof name, "e%02d/%s.png", e, sim->rig.sub_views[i].name);
      assert_int_equal(sv_path_join(path, sizeof path, isolated, name, &err), SV_OK);
      render_board(&sim->rig.sub_views[i], &p, rgb);
      save(path, sim, &sim->rig.sub_views[i].footprint, rgb, &rng);
    }
  }
  free(rgb);
}

static void make_folders(int n_exposures) {
  const char *tmp = getenv("TMPDIR");
  snprintf(folder, sizeof folder, "%s/subview-lenslets-%ld", tmp ? tmp : "/tmp", (long)getpid());
  in_folder(white, "white"), in_folder(isolated, "isolated"), in_folder(out, "rig");
  assert_int_equal(sv_path_make_folder(white, &err), SV_OK);
  for (int e = 0; e < n_exposures; e++) {
    char path[SV_CAP_PATH], name[16];
    snprintf(name, sizeof name, "e%02d", e);
    assert_int_equal(sv_path_join(path, sizeof path, isolated, name, &err), SV_OK);
    assert_int_equal(sv_path_make_folder(path, &err), SV_OK);
  }
}

static void remove_folders(void) {
  char command[SV_CAP_PATH + 20];
  snprintf(command, sizeof command, "rm -rf '%s'", folder);
  if (system(command) != 0) printf("%s stays\n", folder);
}

static void read_back(sv_rig *rig, sv_arena *a, sv_arena *scratch) {
  static sv_coverage_names names;
  sv_file_reader files = {out, sv_folder_read};
  assert_int_equal(sv_rig_init(rig, 64, a), SV_OK);
  if (sv_rig_read_coverage(rig, &names, &files, "rig.json", 1, scratch, &err) != SV_OK)
    fail_msg("%s", err.text);
  if (sv_coverage_load(out, rig, &names, &err) != SV_OK) fail_msg("%s", err.text);
}

static void check_footprint(const sv_sub_view *v, const sv_sub_view *want) {
  const sv_footprint *f = &v->footprint, *g = &want->footprint;
  double sum = 0, diff = 0;
  for (int y = 0; y < g->height_px; y++)
    for (int x = 0; x < g->width_px; x++) {
      int fx = x + g->x0_px - f->x0_px, fy = y + g->y0_px - f->y0_px;
      bool is_in = fx >= 0 && fy >= 0 && fx < f->width_px && fy < f->height_px;
      double c = is_in ? f->coverage[fy * f->width_px + fx] / 255.0 : 0;
      // The plateau is the brightest 5 % of the lit part: in a disc, what d^2 < r^2 / 20 sees at least.
      double want_share = fmin(1, share(g, x, y) / (1 - FALL_OFF * 0.05));
      sum += want_share, diff += fabs(c - want_share);
    }
  if (!(diff < 0.01 * sum)) fail_msg("%s: coverage is off by %.2f %%", v->name, 100 * diff / sum);
}

typedef struct {
  double rotation_deg, focal, place; // worst; the last two as shares
} errors;

static errors compare(const sv_rig *rig, const sv_rig *want) {
  errors e = {0};
  sv_pose back = sv_pose_inv(&want->sub_views[0].cam_from_rig);
  double far[3];
  sv_pose last = sv_pose_mul(&want->sub_views[want->n_sub_views - 1].cam_from_rig, &back);
  sv_pose_centre(far, &last);
  for (int i = 0; i < rig->n_sub_views; i++) {
    const sv_sub_view *v = &rig->sub_views[i];
    sv_pose true_pose = sv_pose_mul(&want->sub_views[i].cam_from_rig, &back), inv = sv_pose_inv(&true_pose);
    double r[9], w[3], a[3], b[3];
    sv_mul33(r, v->cam_from_rig.r, inv.r);
    sv_rodrigues_inv(w, r);
    sv_pose_centre(a, &v->cam_from_rig), sv_pose_centre(b, &true_pose);
    sv_sub3(a, a, b);
    e.rotation_deg = fmax(e.rotation_deg, sv_norm3(w) * 180 / SV_PI);
    e.place = fmax(e.place, sv_norm3(a) / sv_norm3(far));
    e.focal = fmax(e.focal, fabs(v->model.p[0] / want->sub_views[i].model.p[0] - 1));
  }
  return e;
}

static void calibrate(const char *spec, bool is_board, int n_exposures, double limit_deg,
                      double limit_focal) {
  static uint8_t block[1 << 20], room[1 << 20];
  sv_sim *sim = calloc(1, sizeof *sim);
  sv_sim_config cfg;
  if (sv_sim_parse(&cfg, spec, &err) != SV_OK) fail_msg("%s", err.text);
  size_t n_bytes = sv_sim_bytes(&cfg) + 4096;
  void *memory = malloc(n_bytes);
  sv_arena arena = sv_arena_make(memory, n_bytes);
  if (sv_sim_init(sim, &cfg, &arena, &err) != SV_OK) fail_msg("%s", err.text);
  make_folders(n_exposures);
  make_pictures(sim, is_board ? 0 : n_exposures);
  if (is_board) make_board_pictures(sim, n_exposures);
  double a[3], b[3];
  sv_pose_centre(a, &sim->rig.sub_views[0].cam_from_rig),
      sv_pose_centre(b, &sim->rig.sub_views[1].cam_from_rig);
  sv_sub3(a, a, b);
  cal_options o = {.isolated = isolated,
                   .white = white,
                   .out = out,
                   .dark = -1,
                   .threads = 2,
                   .spacing_m = -1,
                   .focal_px = -1,
                   .is_quiet = true};
  if (is_board) o.board = "7x6", o.n_cols = COLS, o.n_rows = ROWS, o.spacing_m = SQUARE_M;
  else o.pitch_m = sv_norm3(a);
  assert_int_equal(cal_cmd_lenslets(&o), CAL_EXIT_OK);
  sv_rig rig;
  sv_arena arena2 = sv_arena_make(block, sizeof block), scratch = sv_arena_make(room, sizeof room);
  read_back(&rig, &arena2, &scratch);
  assert_int_equal(rig.n_sub_views, sim->rig.n_sub_views);
  assert_int_equal((int)rig.forward, SV_FORWARD_MULTIPLEXED);
  for (int i = 0; i < rig.n_sub_views; i++) check_footprint(&rig.sub_views[i], &sim->rig.sub_views[i]);
  errors e = compare(&rig, &sim->rig);
  printf("%s: rotation %.4f degrees, focal length %.3f %%, place %.3f %% of the array\n",
         is_board ? "board" : "texture", e.rotation_deg, 100 * e.focal, 100 * e.place);
  assert_true(e.rotation_deg < limit_deg && e.focal < limit_focal);
  sv_coverage_free(&rig);
  remove_folders();
  free(memory), free(sim);
}

static void test_texture(void **state) {
  (void)state;
  if (!sv_structure_available()) {
    printf("skip  this build has no OpenCV to match pictures with (libopencv-dev)\n");
    skip();
  }
  // A narrow array and a shaded scene: the focal length is known badly, directions much better.
  calibrate("textured,rig=multiplexed,size=480x480,grid=3x3", false, 3, 0.3, 0.12);
}

static void test_board(void **state) {
  (void)state;
  if (sv_boards_available(&err) != SV_OK || !sv_structure_available()) {
    printf("skip  this build has no mrcal or OpenCV\n");
    skip();
  }
  calibrate("textured,rig=multiplexed,size=600x600,grid=3x3", true, 12, 0.05, 0.005);
}

// Lenses and poses from points that are seen with noise: no pictures.
static void test_lens_array(void **state) {
  (void)state;
  enum { N = 9, N_POINTS = 1500 };
  static sv_sub_view views[N];
  static sv_camera_model models[N];
  static sv_pose poses[N];
  static double points[N_POINTS][3], centre[N][2];
  static sv_array_observation seen[N * N_POINTS];
  sv_rig rig = {.sub_views = views, .cap_sub_views = N};
  sv_device_params p = sv_device_defaults(SV_DEVICE_MULTIPLEXED);
  p.width_px = p.height_px = 480, p.focal_per_width = 1.1, p.distance_m = 4, p.angle_rad = 0.17,
  p.rows = p.cols = 3;
  if (sv_device_build(&rig, &p, &err) != SV_OK) fail_msg("%s", err.text);
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
    models[c].p[0] *= 1.1, models[c].p[1] *= 1.1;
    for (int k = 0; k < 2; k++) centre[c][k] = models[c].p[2 + k];
  }
  sv_array_stats st;
  if (sv_array_solve(&a, 5, &st, &err) != SV_OK) fail_msg("%s", err.text);
  sv_rig got = {.sub_views = calloc(N, sizeof(sv_sub_view)), .n_sub_views = N};
  for (int c = 0; c < N; c++) got.sub_views[c].cam_from_rig = poses[c], got.sub_views[c].model = models[c];
  errors e = compare(&got, &rig);
  printf("points: sigma %.4f px, %d left out, rotation %.4f degrees (sd %.4f), focal length %.3f %% (sd %.3f "
         "%%)\n",
         st.sigma_px, st.n_outliers, e.rotation_deg, st.rotation_sd_deg, 100 * e.focal,
         100 * st.focal_sd_px / models[0].p[0]);
  free(got.sub_views);
  assert_true(fabs(st.sigma_px / 0.1 - 1) < 0.15);
  assert_true(e.rotation_deg < 4 * st.rotation_sd_deg && e.rotation_deg < 0.1);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_lens_array), cmocka_unit_test(test_texture),
                                     cmocka_unit_test(test_board)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
