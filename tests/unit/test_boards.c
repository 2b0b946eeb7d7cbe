// SPDX-License-Identifier: Apache-2.0
// The chessboard solver on simulated rigs with 0.3 px of corner noise, and on inputs that cannot be
// solved.
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "calib/solve/boards.h"
#include "calib/solve/corners.h"
#include "src/base/mathx.h"
#include "src/base/rng.h"
#include "src/rig/device.h"
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

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_stereo),      cmocka_unit_test(test_phone),
                                     cmocka_unit_test(test_grid),        cmocka_unit_test(test_theory),
                                     cmocka_unit_test(test_ill_posed),   cmocka_unit_test(test_spacing),
                                     cmocka_unit_test(test_three_boards)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
