// SPDX-License-Identifier: Apache-2.0
// Where the trainer looks: regions cover their sensor wherever an epoch shifts them, and views that
// no camera took stand about the scene's centre like those that were.
#include <math.h>
#include <string.h>

#include "src/base/mathx.h"
#include "src/train/train.h"
#include "src/train/measurement.h"
#include "src/train/novel.h"
#include "tests/common/test.h"

#define N_LENSES  4
#define REGION_PX 32

static _Alignas(64) unsigned char block[8 << 20];
static sv_trainer t;
static sv_kernels kernels;
static sv_pool pool;
static sv_lens lens[N_LENSES];
static uint16_t measured[3 * 90 * 70];

static void open_trainer(void) {
  static const int size[N_LENSES][2] = {{40, 30}, {41, 30}, {64, 48}, {50, 10}};
  sv_arena a = sv_arena_make(block, sizeof block);
  sv_err err;
  sv_train_cfg cfg = sv_train_defaults();
  pool = sv_pool_serial();
  sv_kernels_init(&kernels, ~0u);
  cfg.n_gaussians = 4;
  cfg.cap_views = 0;
  cfg.cap_measurements = 1;
  cfg.region_px = REGION_PX;
  cfg.cap_regions = sv_train_n_regions(90, 70, REGION_PX);
  cfg.cap_width_px = cfg.cap_height_px = 64;
  if (sv_trainer_init(&t, &cfg, (sv_compute){&kernels, &pool}, &a, &err) < 0) fail_msg("%s", err.text);
  for (int i = 0; i < N_LENSES; i++) {
    int w = size[i][0], h = size[i][1];
    sv_pose pose = sv_pose_identity();
    pose.t[0] = 0.3 * (i - 2);
    pose.t[1] = 0.1 * i;
    pose.t[2] = 4;
    lens[i] = (sv_lens){sv_view_make(w, h, (const double[]){40, 42, 0.5 * w, 0.5 * h}, &pose),
                        {5 * i, 3 * i, w, h, NULL}};
  }
  sv_multiplexed c = {90, 70, N_LENSES, lens, N_LENSES, true};
  assert_ok(sv_train_add_measurement(&t, &c, measured, &err), &err);
}

static void check_cover(int width_px, int height_px, float jx, float jy) {
  static unsigned char seen[200][200];
  sv_train_measurement c = {.model = {.width_px = width_px, .height_px = height_px}};
  memset(seen, 0, sizeof seen);
  t.jitter[0] = jx;
  t.jitter[1] = jy;
  int n = sv_train_n_regions(width_px, height_px, t.cfg.region_px);
  c.n_x = sv_train_n_regions(width_px, 1, t.cfg.region_px);
  c.n_y = sv_train_n_regions(1, height_px, t.cfg.region_px);
  assert_int_equal(c.n_x * c.n_y, n);
  for (int i = 0; i < n; i++) {
    sv_region r = sv_train_region(&t, &c, i);
    assert_true(r.x0 >= 0 && r.y0 >= 0 && r.x1 <= width_px && r.y1 <= height_px);
    assert_int_equal(r.x1 - r.x0, sv_mini(width_px, t.cfg.region_px));
    assert_int_equal(r.y1 - r.y0, sv_mini(height_px, t.cfg.region_px));
    for (int y = r.y0; y < r.y1; y++) memset(&seen[y][r.x0], 1, (size_t)(r.x1 - r.x0));
  }
  for (int y = 0; y < height_px; y++)
    for (int x = 0; x < width_px; x++)
      if (!seen[y][x])
        fail_msg("%dx%d, shifted by %g %g: pixel %d %d", width_px, height_px, (double)jx, (double)jy, x, y);
}

TEST(test_regions_cover) {
  static const float shifts[] = {0, 0.01f, 0.3f, 0.5f, 0.77f, 0.99999994f};
  memset(&t, 0, sizeof t);
  t.cfg.region_px = REGION_PX;
  for (int w = 1; w < 140; w += 3)
    for (size_t i = 0; i < 6; i++)
      for (size_t j = 0; j < 6; j++) check_cover(w, 1 + w * 7 % 131, shifts[i], shifts[j]);
  check_cover(64, 32, 0.5f, 0.5f); // whole multiples
  check_cover(33, 31, 0.99999994f, 0);
}

static void project(const sv_view *v, const float p[3], double out[3]) {
  double x[3];
  for (int i = 0; i < 3; i++) {
    x[i] = (double)v->t[i];
    for (int k = 0; k < 3; k++) x[i] += (double)v->r[3 * i + k] * (double)p[k];
  }
  out[0] = (double)v->fx * x[0] / x[2] + (double)v->cx;
  out[1] = (double)v->fy * x[1] / x[2] + (double)v->cy;
  out[2] = x[2];
}

TEST(test_novel_views) {
  open_trainer();
  const float centre[3] = {0.2f, -0.1f, 0.3f};
  sv_train_set_scene(&t, centre, 1);
  double largest = 0;
  int n_of[N_LENSES] = {0};
  for (int i = 0; i < 600; i++) {
    t.cfg.novel_px = i & 1 ? 16 : 100;
    sv_view v = sv_train_novel_view(&t);
    int m = 0; // whose view it was: their frames differ in size
    double was[3], is[3], trace = 0;
    for (; m < N_LENSES; m++) {
      int side = sv_maxi(lens[m].view.width_px, lens[m].view.height_px);
      sv_view s = sv_view_scaled(&lens[m].view, (side + t.cfg.novel_px - 1) / t.cfg.novel_px);
      project(&s, centre, was);
      project(&v, centre, is);
      if (s.width_px == v.width_px && s.height_px == v.height_px && fabs(was[0] - is[0]) < 1e-3) break;
    }
    assert_true(m < N_LENSES);
    assert_true(sv_maxi(v.width_px, v.height_px) <= t.cfg.novel_px);
    // place and distance are kept
    assert_true(fabs(was[1] - is[1]) < 1e-3 && fabs(was[2] - is[2]) < 1e-5);
    n_of[m]++;
    for (int r = 0; r < 3; r++)
      for (int q = 0; q < 3; q++) {
        double dot = 0;
        for (int j = 0; j < 3; j++) dot += (double)v.r[3 * r + j] * (double)v.r[3 * q + j];
        assert_true(fabs(dot - (r == q)) < 1e-5);
        trace += (double)v.r[3 * r + q] * (double)lens[m].view.r[3 * r + q];
      }
    double angle = acos(fmin(1, 0.5 * (trace - 1)));
    assert_true(angle <= (double)t.cfg.novel_rad + 1e-3);
    largest = fmax(largest, angle);
  }
  assert_true(largest > 0.8 * (double)t.cfg.novel_rad);
  for (int m = 0; m < N_LENSES; m++) assert_true(n_of[m] > 40);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_regions_cover),
      cmocka_unit_test(test_novel_views),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
