// SPDX-License-Identifier: Apache-2.0
// The chessboard solver on simulated rigs with 0.3 px of corner noise, and on inputs that cannot be
// solved.
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "calib/lens_view.h"
#include "calib/solve/boards.h"
#include "calib/solve/corners.h"
#include "src/base/mathx.h"
#include "src/base/rng.h"
#include "src/rig/device.h"
#include "src/rig/sizes.h"
#include "tests/common/test.h"
#include "tools/calibrate/calibrate.h"

enum { COLS = 10, ROWS = 9, CAP_VIEWS = 16 };
#define SPACING_M  0.08
#define DISTANCE_M 1.6
#define NOISE_PX   0.3

static sv_err err;

typedef struct {
  sv_sub_view views[CAP_VIEWS];
  sv_rig rig;
  int size[CAP_VIEWS][2];
  const char *names[CAP_VIEWS];
  double *uv;
  uint8_t *seen;
  sv_boards b;
} world;

static void make_rig(world *w, sv_device_id id, double angle_deg, int width_px, int height_px) {
  sv_device_params p = sv_device_defaults(id);
  p.width_px = width_px;
  p.height_px = height_px;
  p.focal_per_width = 1.0;
  p.distance_m = DISTANCE_M;
  p.angle_rad = angle_deg * SV_PI / 180;
  w->rig = (sv_rig){.cap_sub_views = CAP_VIEWS, .sub_views = w->views};
  assert_ok(sv_device_build(&w->rig, &p, &err), &err);
}

// Boards about the scene's centre, tilted by up to tilt_deg to all sides, within range metres; a
// negative range: every second board within a third of it.
static void make_boards(world *w, int n_frames, double tilt_deg, double range, uint64_t seed) {
  sv_rng rng = sv_rng_make(seed, 1);
  int n = w->rig.n_sub_views, corners = COLS * ROWS;
  w->uv = calloc((size_t)n * (size_t)n_frames * (size_t)corners * 2, sizeof(double));
  w->seen = calloc((size_t)n * (size_t)n_frames, 1);
  for (int f = 0; f < n_frames; f++) {
    double t = tilt_deg * SV_PI / 180, rot[3], at[3], span = range > 0 ? range : f % 2 ? -range : -range / 3;
    for (int k = 0; k < 3; k++) rot[k] = (k < 2 ? 2 * t : 0.6) * ((double)sv_rng_f(&rng) - 0.5);
    for (int k = 0; k < 3; k++) at[k] = span * ((double)sv_rng_f(&rng) - 0.5) * (k < 2 ? 0.9 : 0.7);
    sv_pose p;
    sv_rodrigues(p.r, rot);
    double middle[3] = {0.5 * (COLS - 1) * SPACING_M, 0.5 * (ROWS - 1) * SPACING_M, 0};
    sv_apply33(middle, p.r, middle);
    for (int k = 0; k < 3; k++) p.t[k] = at[k] - middle[k] + (k == 2 ? DISTANCE_M : 0);
    for (int c = 0; c < n; c++) {
      double *uv = w->uv + 2 * corners * (c * n_frames + f);
      bool is_in = true;
      for (int k = 0; k < corners; k++) {
        double x[3] = {k % COLS * SPACING_M, k / COLS * SPACING_M, 0};
        sv_pose_apply(x, &p, x);
        sv_pose_apply(x, &w->views[c].cam_from_rig, x);
        const sv_camera_model *m = &w->views[c].model;
        is_in = is_in && sv_model_project(m, x, uv + 2 * k, NULL, NULL) && uv[2 * k] > 0 &&
                uv[2 * k + 1] > 0 && uv[2 * k] < m->width_px && uv[2 * k + 1] < m->height_px;
        for (int a = 0; a < 2; a++) uv[2 * k + a] += NOISE_PX * (double)sv_rng_normal(&rng);
      }
      w->seen[c * n_frames + f] = is_in;
    }
  }
  for (int c = 0; c < n; c++) {
    w->names[c] = w->views[c].name;
    w->size[c][0] = w->views[c].model.width_px;
    w->size[c][1] = w->views[c].model.height_px;
  }
  w->b = (sv_boards){
      n,     n_frames, COLS, ROWS, SPACING_M, SV_MODEL_PINHOLE, false, w->names, (const int(*)[2])w->size,
      w->uv, w->seen};
}

static void drop(world *w) {
  free(w->uv);
  free(w->seen);
}

static void need_mrcal(void) {
  if (sv_boards_available(&err) == SV_OK && sv_corners_has_opencv()) return;
  printf("skip  this build has no mrcal or OpenCV\n");
  skip();
}

typedef struct {
  double focal, rotation_deg, place; // the worst camera: error, or what the solver says of its
                                     // deviation
  double chi2;                       // of the rotations: mean of (error / deviation)^2
} accuracy;

static accuracy solve(world *w, const char *name, accuracy *told) {
  sv_boards_result r;
  accuracy e = {0};
  *told = (accuracy){0};
  if (sv_boards_solve(&w->b, &r, &err) != SV_OK) fail_msg("%s: %s", name, err.text);
  sv_pose back = sv_pose_inv(&w->views[0].cam_from_rig);
  for (int c = 0; c < w->b.n_cameras; c++) {
    const sv_boards_camera *q = &r.cameras[c];
    sv_pose want = sv_pose_mul(&w->views[c].cam_from_rig, &back), inv = sv_pose_inv(&want);
    double rot[9], v[3], d[3];
    sv_mul33(rot, r.cam_from_rig[c].r, inv.r);
    sv_rodrigues_inv(v, rot);
    sv_sub3(d, r.cam_from_rig[c].t, want.t);
    double deg = sv_norm3(v) * 180 / SV_PI;
    e.focal = fmax(e.focal, fabs(r.models[c].p[0] / w->views[c].model.p[0] - 1));
    e.rotation_deg = fmax(e.rotation_deg, deg);
    e.place = fmax(e.place, sv_norm3(d) / DISTANCE_M);
    told->focal = fmax(told->focal, q->fx_sd_px / r.models[c].p[0]);
    told->rotation_deg = fmax(told->rotation_deg, q->rotation_sd_deg);
    told->place = fmax(told->place, q->translation_sd_m / DISTANCE_M);
    if (c) e.chi2 += deg * deg / (q->rotation_sd_deg * q->rotation_sd_deg) / (w->b.n_cameras - 1);
  }
  assert_true(fabs(r.rms_px / (NOISE_PX * sqrt(2)) - 1) < 0.05);
  sv_boards_free(&r);
  return e;
}

static void check_rig(world *w, const char *name) {
  accuracy sd, e = solve(w, name, &sd);
  printf(
      "%s: %d boards; focal length %.3f %% (sd %.3f), rotation %.4f degrees (sd %.4f), translation %.3f %% "
      "(sd %.3f)\n",
      name, w->b.n_frames, 100 * e.focal, 100 * sd.focal, e.rotation_deg, sd.rotation_deg, 100 * e.place,
      100 * sd.place);
  assert_true(e.focal < 0.001 && e.rotation_deg < 0.02 && e.place < 0.002);
  // Not by luck: the deviations that the normal equations tell are below half of the limits.
  assert_true(sd.focal < 0.0005 && sd.rotation_deg < 0.01 && sd.place < 0.001);
}

// Pictures of 1280 px: a rotation's deviation of 0.01 degrees takes 120 boards, of which each
// camera sees half.
TEST(test_stereo) {
  need_mrcal();
  world w;
  make_rig(&w, SV_DEVICE_STEREO, 15, 1280, 960);
  make_boards(&w, 120, 45, 0.9, 1);
  check_rig(&w, "stereo");
  drop(&w);
}

// A phone's pictures have 4000 px.
TEST(test_phone) {
  need_mrcal();
  world w;
  make_rig(&w, SV_DEVICE_PHONE, 5, 4000, 3000);
  // The long lens needs a board of its own size: it sees the whole only from afar.
  for (int c = 0; c < w.rig.n_sub_views; c++)
    if (strcmp(w.views[c].name, "tele") == 0) {
      w.views[c].model.p[0] /= 2;
      w.views[c].model.p[1] /= 2;
    }
  make_boards(&w, 240, 45, -2, 2); // far to the sides, too, for the widest lens
  check_rig(&w, "phone");
  drop(&w);
}

// A sensor of 4000 px: 1000 for each lens. Deviations go with 1 / (pixels sqrt(boards)).
TEST(test_grid) {
  need_mrcal();
  world w;
  make_rig(&w, SV_DEVICE_LIGHTFIELD, 10, 4000, 4000);
  make_boards(&w, 80, 45, 0.7, 3);
  check_rig(&w, "grid");
  drop(&w);
}

// The solver is as good as theory allows and knows how good it is: errors over many draws of noise
// have the deviation that the normal equations tell, which goes with pixels and boards as it must.
TEST(test_theory) {
  enum { N_DRAWS = 8 };
  need_mrcal();
  world w;
  accuracy sd, more;
  double chi2 = 0;
  for (int k = 0; k < N_DRAWS; k++) {
    make_rig(&w, SV_DEVICE_STEREO, 15, 640, 480);
    make_boards(&w, 30, 45, 0.6, (uint64_t)(100 + k));
    chi2 += solve(&w, "a draw", &sd).chi2 / N_DRAWS;
    drop(&w);
  }
  make_rig(&w, SV_DEVICE_STEREO, 15, 1280, 960);
  make_boards(&w, 120, 45, 0.6, 100);
  (void)solve(&w, "twice the pixels, four times the boards", &more);
  drop(&w);
  printf("errors over deviations: %.2f; four times better: %.4f, %.4f degrees\n", sqrt(chi2), sd.rotation_deg,
         more.rotation_deg);
  assert_true(chi2 > 0.4 && chi2 < 2);
  assert_true(fabs(sd.rotation_deg / more.rotation_deg / 4 - 1) < 0.25);
}

static void refused(world *w, const char *word) {
  sv_boards_result r;
  if (sv_boards_solve(&w->b, &r, &err) == SV_OK) fail_msg("solved, but %s was expected", word);
  if (!strstr(err.text, word)) fail_msg("'%s' was expected in: %s", word, err.text);
}

TEST(test_ill_posed) {
  need_mrcal();
  world w;
  make_rig(&w, SV_DEVICE_STEREO, 15, 1280, 960);
  make_boards(&w, 20, 0, 0.5, 4); // always frontal
  refused(&w, "single direction");
  drop(&w);
  make_boards(&w, 20, 45, 0.5, 5);
  for (int f = 0; f < 20; f++) w.seen[(f % 2) * 20 + f] = 0; // never together
  refused(&w, "same time");
  for (int f = 2; f < 20; f++) w.seen[20 + f] = 0;
  w.seen[20] = w.seen[0] = 1;
  refused(&w, "at least 3");
  drop(&w);
}

// --- fisheyes ------------------------------------------------------------------------------------

// The rig's lenses become fisheyes; boards all around, facing it, tilted by up to 25 degrees.
static void make_wide(world *w, double half_deg, int n_frames, uint64_t seed) {
  sv_rng rng = sv_rng_make(seed, 1);
  make_rig(w, SV_DEVICE_STEREO, 5, 1280, 960);
  for (int c = 0; c < 2; c++) {
    sv_camera_model *m = &w->views[c].model;
    const double k[4] = {-0.02, 0.005, -0.002, 0.0003}, f = 800 / (half_deg * SV_PI / 180);
    *m = (sv_camera_model){.kind = SV_MODEL_KB4, .width_px = 1280, .height_px = 960};
    memcpy(m->p, (const double[8]){f, 1.003 * f, 652, 471, k[0], k[1], k[2], k[3]}, 8 * sizeof(double));
  }
  make_boards(w, n_frames, 25, 0.1, seed);
  const int corners = COLS * ROWS;
  for (int frame = 0; frame < n_frames; frame++) {
    const double off = 0.8 * half_deg * SV_PI / 180 * sqrt((double)sv_rng_f(&rng)),
                 about = 2 * SV_PI * (double)sv_rng_f(&rng), far = 0.8 + 0.5 * (double)sv_rng_f(&rng);
    const double eye[3] = {0, 0, 0}, up[3] = {0, -1, 0.01},
                 at[3] = {sin(off) * cos(about), sin(off) * sin(about), cos(off)};
    double tilt[9], rot[3], middle[3] = {-0.5 * (COLS - 1) * SPACING_M, -0.5 * (ROWS - 1) * SPACING_M, 0};
    sv_pose look, p;
    for (int k = 0; k < 3; k++) rot[k] = (k < 2 ? 0.9 : 0.6) * ((double)sv_rng_f(&rng) - 0.5);
    assert_true(sv_pose_look_at(&look, eye, at, up));
    look = sv_pose_inv(&look);
    sv_rodrigues(tilt, rot);
    sv_mul33(p.r, look.r, tilt);
    sv_apply33(p.t, p.r, middle);
    for (int k = 0; k < 3; k++) p.t[k] += far * at[k];
    for (int c = 0; c < 2; c++) {
      const sv_camera_model *m = &w->views[c].model;
      double *uv = w->uv + 2 * corners * (c * n_frames + frame);
      bool is_in = true;
      for (int k = 0; k < corners; k++) {
        double x[3] = {k % COLS * SPACING_M, k / COLS * SPACING_M, 0};
        sv_pose_apply(x, &p, x);
        sv_pose_apply(x, &w->views[c].cam_from_rig, x);
        is_in = is_in && sv_model_project(m, x, uv + 2 * k, NULL, NULL) && uv[2 * k] > 0 &&
                uv[2 * k + 1] > 0 && uv[2 * k] < m->width_px && uv[2 * k + 1] < m->height_px;
        for (int a = 0; a < 2; a++) uv[2 * k + a] += NOISE_PX * (double)sv_rng_normal(&rng);
      }
      w->seen[c * n_frames + frame] = is_in;
    }
  }
  w->b.model = SV_MODEL_SPLINED;
}

enum { N_RAYS = 11 * 9 };
// The rotation that a calibration of one camera leaves open: rays `from` are turned to `to`.
static void turn_to(double from[N_RAYS][3], const double to[N_RAYS][3]) {
  for (int round = 0; round < 5; round++) {
    double h[3][3] = {{0}}, g[3] = {0}, w[3], r[9];
    for (int i = 0; i < N_RAYS; i++)
      for (int a = 0; a < 3; a++) {
        const int b = (a + 1) % 3, c = (a + 2) % 3;
        g[a] += from[i][b] * to[i][c] - from[i][c] * to[i][b];
        for (int k = 0; k < 3; k++) h[a][k] += (a == k) - from[i][a] * from[i][k];
      }
    const double det = h[0][0] * (h[1][1] * h[2][2] - h[1][2] * h[2][1]) -
                       h[0][1] * (h[1][0] * h[2][2] - h[1][2] * h[2][0]) +
                       h[0][2] * (h[1][0] * h[2][1] - h[1][1] * h[2][0]);
    for (int a = 0; a < 3; a++) { // Cramer's rule
      double m[3][3];
      memcpy(m, h, sizeof m);
      for (int k = 0; k < 3; k++) m[k][a] = g[k];
      w[a] = (m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) -
              m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0]) +
              m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0])) /
             det;
    }
    sv_rodrigues(r, w);
    for (int i = 0; i < N_RAYS; i++)
      sv_apply33(from[i], r, (const double[3]){from[i][0], from[i][1], from[i][2]});
  }
}

// Fisheyes of 185 degrees by mrcal's splined model: the lens, apart from a rotation, and the pose.
TEST(test_fisheyes) {
  need_mrcal();
  world w;
  sv_boards_result r;
  make_wide(&w, 92.5, 160, 31);
  if (sv_boards_solve(&w.b, &r, &err) != SV_OK) fail_msg("%s", err.text);
  for (int c = 0; c < 2; c++) {
    static double rays[2][N_RAYS][3];
    double sum = 0, worst = 0, corner[3], uv[2];
    const sv_camera_model *m = &w.views[c].model;
    for (int k = 0; k < N_RAYS; k++) {
      uv[0] = 1280 * (0.05 + 0.09 * (k % 11));
      uv[1] = 960 * (0.06 + 0.11 * (k / 11));
      assert_true(sv_model_unproject(m, uv, rays[0][k]));
      assert_true(sv_model_unproject(&r.models[c], uv, rays[1][k]));
    }
    turn_to(rays[0], (const double(*)[3])rays[1]);
    for (int k = 0; k < N_RAYS; k++) {
      double at[2];
      assert_true(sv_model_project(&r.models[c], rays[0][k], at, NULL, NULL));
      const double off =
          hypot(at[0] - 1280 * (0.05 + 0.09 * (k % 11)), at[1] - 960 * (0.06 + 0.11 * (k / 11)));
      sum += off * off;
      worst = fmax(worst, off);
    }
    printf("%s: %d boards, %.3f px RMS; the lens off by %.2f px, at most %.2f px; grid %dx%d, %.0f degrees\n",
           w.names[c], r.cameras[c].n_boards, r.cameras[c].rms_px, sqrt(sum / N_RAYS), worst,
           r.models[c].spline.nx, r.models[c].spline.ny, r.models[c].spline.fov_x_deg);
    assert_true(fabs(r.cameras[c].rms_px / (NOISE_PX * sqrt(2)) - 1) < 0.1);
    assert_true(sqrt(sum / N_RAYS) < 0.6 && worst < 4);
    // In the corners, too, where no board was; a view holds the whole field.
    sv_lens_view view;
    for (int k = 0; k < 4; k++)
      assert_true(
          sv_model_unproject(&r.models[c], (const double[2]){1280 * (k & 1), 960 * (k >> 1)}, corner));
    assert_true(sv_lens_view_make(&view, &r.models[c]) && view.is_fisheye);
    assert_true(r.cameras[c].uncertainty_px[4][5] < 0.3);
  }
  sv_boards_free(&r);
  drop(&w);
}

// Millimetres given for metres.
TEST(test_spacing) {
  cal_advice *a = calloc(1, sizeof *a);
  cal_advise_spacing(a, -1); // none was given
  cal_advise_spacing(a, 0.5);
  assert_int_equal(a->n, 0);
  cal_advise_spacing(a, 25);
  assert_int_equal(a->n, 1);
  assert_string_equal(a->text[0], "--spacing is in meters: 25 m between corners?");
  free(a);
}

// Three boards can be solved, and are flagged.
TEST(test_three_boards) {
  need_mrcal();
  world w;
  sv_boards_result r;
  make_rig(&w, SV_DEVICE_STEREO, 15, 1280, 960);
  make_boards(&w, 3, 45, 0.3, 6);
  cal_advice *a = calloc(1, sizeof *a);
  cal_camera cameras[2] = {{.name = "left"}, {.name = "right"}};
  char *frames[] = {"0", "1", "2"};
  cal_boards b = {.n_cameras = 2,
                  .n_frames = 3,
                  .n_cols = COLS,
                  .n_rows = ROWS,
                  .cameras = cameras,
                  .frames = frames,
                  .is_seen = w.seen,
                  .uv_px = w.uv};
  if (sv_boards_solve(&w.b, &r, &err) == SV_OK) {
    cal_advise_boards(a, &b, &r);
    assert_true(a->n > 0);
    assert_contains(a->text[0], "left saw the board in only 3 images");
    sv_boards_free(&r);
  }
  free(a);
  drop(&w);
}

// --- other modes of the sensor -------------------------------------------------------------------
// A lens that was calibrated on 12 megapixels, fitted to another mode of its sensor, against a
// calibration of that mode: boards of its own, with corners where crop and binning put them. Both
// have their noise; many boards make it small.
typedef struct {
  const char *name;
  int width_px, height_px;
  double x0_px, y0_px, area_width_px, area_height_px;
} mode;

static sv_camera_model calibrated(const mode *m, uint64_t seed) {
  world w;
  sv_boards_result r;
  make_rig(&w, SV_DEVICE_MONO, 0, 4056, 3040);
  w.views[0].model.kind = SV_MODEL_OPENCV5;
  memcpy(w.views[0].model.p + 4, (const double[5]){-0.08, 0.03, 2e-4, -1e-4, 0}, 5 * sizeof(double));
  make_boards(&w, 400, 45, 0.75 * m->area_width_px / 4056, seed);
  w.b.model = SV_MODEL_OPENCV5;
  const int corners = COLS * ROWS;
  const double scale = m->width_px / m->area_width_px;
  for (int f = 0; f < w.b.n_frames; f++)
    for (int k = 0; k < corners; k++) {
      double *uv = w.uv + 2 * (f * corners + k);
      uv[0] = (uv[0] - m->x0_px) * scale;
      uv[1] = (uv[1] - m->y0_px) * scale;
      w.seen[f] = w.seen[f] && uv[0] > 0 && uv[1] > 0 && uv[0] < m->width_px && uv[1] < m->height_px;
    }
  w.size[0][0] = m->width_px;
  w.size[0][1] = m->height_px;
  if (sv_boards_solve(&w.b, &r, &err) != SV_OK) fail_msg("%s: %s", m->name, err.text);
  const sv_camera_model lens = r.models[0];
  sv_boards_free(&r);
  drop(&w);
  return lens;
}

TEST(test_other_modes) {
  static const mode full = {"4056x3040", 4056, 3040, 0, 0, 4056, 3040};
  static const mode modes[] = {{"1014x760, scaled", 1014, 760, 0, 0, 4056, 3040},
                               {"1332x990, binned 2x2 and cropped", 1332, 990, 696, 528, 2664, 1980}};
  need_mrcal();
  const sv_camera_model large = calibrated(&full, 21);
  for (int i = 0; i < 2; i++) {
    const mode *m = &modes[i];
    const sv_camera_model native = calibrated(m, 22 + (uint64_t)i);
    const sv_image_mode frame = {
        m->width_px, m->height_px, {4056, 3040, m->x0_px, m->y0_px, m->area_width_px, m->area_height_px}};
    sv_sub_view v = {.name = "one", .model = large};
    static double rays[2][N_RAYS][3];
    double uv[N_RAYS][2], worst = 0;
    sv_size_fit how;
    sv_image_map map;
    assert_ok(sv_sub_view_fit(&v, &frame, &how, &map, &err), &err);
    for (int k = 0; k < N_RAYS; k++) {
      uv[k][0] = m->width_px * (0.05 + 0.09 * (k % 11));
      uv[k][1] = m->height_px * (0.06 + 0.11 * (k / 11));
      assert_true(sv_model_unproject(&native, uv[k], rays[0][k]));
      assert_true(sv_model_unproject(&v.model, uv[k], rays[1][k]));
    }
    turn_to(rays[0], (const double(*)[3])rays[1]);
    for (int k = 0; k < N_RAYS; k++) {
      double at[2];
      assert_true(sv_model_project(&v.model, rays[0][k], at, NULL, NULL));
      worst = fmax(worst, hypot(at[0] - uv[k][0], at[1] - uv[k][1]));
    }
    printf("%s: the rig of 4056x3040 against a calibration of its own: at most %.3f px apart\n", m->name,
           worst);
    assert_true(worst < 0.1);
  }
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_stereo),       cmocka_unit_test(test_phone),
                                     cmocka_unit_test(test_grid),         cmocka_unit_test(test_theory),
                                     cmocka_unit_test(test_ill_posed),    cmocka_unit_test(test_spacing),
                                     cmocka_unit_test(test_three_boards), cmocka_unit_test(test_other_modes),
                                     cmocka_unit_test(test_fisheyes)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
