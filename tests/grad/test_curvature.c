// SPDX-License-Identifier: Apache-2.0
// The estimate of the Gauss-Newton matrix, its diagonal and what couples the coordinates of each
// mean: the mean over many probes against J^T J / (n w) whose rows of J are gradients of single
// pixel values, of pictures with one sample a pixel and with four, of all tiles and of half of
// them, and of a measurement through its forward model; then how a step uses it.
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "kernels/simd/s1_math.h"
#include "platform/linux/linux.h"
#include "src/base/mathx.h"
#include "src/train/train.h"
#include "src/train/curvature.h"
#include "src/train/supersample.h"
#include "tests/common/test.h"

#define W           42 // two tiles, and the scene on both
#define H           18
#define N_GAUSSIANS 20
#define N_PROBES    1500 // of all tiles
#define N_HALVES    3000 // of half of them
#define N_ROWS      23   // SH of degree 1

static uint8_t block[32 << 20] __attribute__((aligned(64)));
static uint8_t picture[H * W * 3];
static uint16_t measured[H * W * 3];
static sv_trainer t;
static sv_lens lenses[2];

// --- a scene -------------------------------------------------------------------------------------

static sv_view view_from(int i) {
  sv_pose pose;
  double eye[3] = {3, i - 0.5, 0.7}, at[3] = {0, 0, 0}, up[3] = {0, 0, 1};
  assert_true(sv_pose_look_at(&pose, eye, at, up));
  return sv_view_make(W, H, (const double[]){24, 25, 31, 9.5}, &pose);
}

static void place_gaussians(void) {
  sv_rng rng = sv_rng_make(9, 9);
  for (int i = 0; i < N_GAUSSIANS; i++) {
    sv_gaussian g = {.opacity_logit = 0.5f * sv_rng_normal(&rng)};
    for (int q = 0; q < 4; q++) g.quat_wxyz[q] = sv_rng_normal(&rng);
    for (int q = 0; q < 3; q++) {
      g.mean[q] = sv_rng_f(&rng) - 0.5f;
      g.log_scale[q] = -1.8f + 0.3f * sv_rng_normal(&rng);
      for (int k = 0; k < 4; k++) g.sh[k][q] = 0.4f * (sv_rng_f(&rng) - (k ? 0.5f : 0.2f));
    }
    sv_gaussians_put(&t.g, i, &g);
  }
}

static void add_measurement(sv_err *err) {
  for (int i = 0; i < 2; i++) lenses[i] = (sv_lens){view_from(i), {0, 0, W, H, NULL}};
  for (int i = 0; i < H * W * 3; i++) measured[i] = (uint16_t)(i * 977 % 65536);
  sv_multiplexed c = {
      .width_px = W, .height_px = H, .n_lenses = 2, .lenses = lenses, .max_overlap = 2, .is_linear = true};
  if (sv_train_add_measurement(&t, &c, measured, err) < 0) fail_msg("%s", err->text);
}

// No parameter moves, so that each step looks at the same.
static void open_training(sv_train_cfg cfg, bool is_measurement) {
  static sv_kernels k;
  static sv_pool pool;
  sv_arena a = sv_arena_make(block, sizeof block);
  sv_err err;
  sv_kernels_init(&k, ~0u);
  pool = sv_pool_serial();
  cfg.n_gaussians = N_GAUSSIANS;
  cfg.sh_degree = 1;
  cfg.sh_step = 0;
  cfg.cap_views = !is_measurement;
  cfg.cap_measurements = cfg.cap_regions = is_measurement;
  cfg.cap_width_px = cfg.cap_height_px = cfg.region_px = 64; // one region is the whole sensor
  cfg.reg_opacity = cfg.reg_scale = cfg.noise = 0;
  cfg.relocate_every = 0;
  cfg.start_scale = 1;
  cfg.newton.first_every = cfg.newton.every = 1;
  cfg.newton.cap = cfg.newton.cap_scale = cfg.newton.cap_mean = 0;
  if (sv_trainer_init(&t, &cfg, (sv_compute){&k, &pool}, &a, &err) < 0) fail_msg("%s", err.text);
  for (int px = 0; px < W * H * 3; px++) picture[px] = (px / 20) % 2 ? 255 : 0;
  sv_view view = view_from(0);
  sv_image_u8 im = {picture, W, H, 3, W * 3};
  if (is_measurement) add_measurement(&err);
  else assert_ok(sv_train_add_view(&t, &view, &im, &err), &err);
  sv_arena scratch = sv_arena_sub(&a, 1 << 20);
  sv_init_cfg init = {.kind = SV_INIT_SPHERE, .radius = 1, .opacity = 0.5f, .scale_factor = 1, .seed = 1};
  assert_int_equal(sv_train_start(&t, &init, NULL, 0, &scratch), SV_OK);
  place_gaussians();
}

// --- the exact diagonal --------------------------------------------------------------------------

static double exact[N_GAUSSIANS][N_ROWS], exact_cross[N_GAUSSIANS][3];
static const int first[3] = {0, 0, 1}, second[3] = {1, 2, 2};

// Adds the squares and products of the gradients that the renderer holds.
static void add_squares(void) {
  float grad[SV_CAP_ROWS * 16], err[16];
  for (int b = 0; b < (N_GAUSSIANS + 15) / 16; b++) {
    if (!sv_render_bwd_block(&t.render, b, 0, NULL, &(sv_block_grads){grad, err, NULL})) continue;
    for (int r = 0; r < N_ROWS; r++)
      for (int k = 0; k < 16 && 16 * b + k < N_GAUSSIANS; k++)
        exact[16 * b + k][r] += (double)grad[16 * r + k] * (double)grad[16 * r + k];
    for (int r = 0; r < 3; r++)
      for (int k = 0; k < 16 && 16 * b + k < N_GAUSSIANS; k++)
        exact_cross[16 * b + k][r] += (double)grad[16 * first[r] + k] * (double)grad[16 * second[r] + k];
  }
}

static void add_view_pixel(void) {
  if (t.cfg.is_supersampled) assert_int_equal(sv_train_supersample_bwd(&t, &t.grad, NULL), SV_OK);
  else assert_int_equal(sv_render_bwd(&t.render, &t.grad, NULL, NULL, NULL), SV_OK);
  add_squares();
}

static void add_lens_pixel(const sv_crop *crop) {
  sv_forward_bwd(&t.forward, &t.measurements[0].model, crop, &t.render.rgb,
                 &(sv_forward_grad){&t.grad, NULL, &t.part_grad, NULL, NULL});
  assert_int_equal(sv_render_bwd(&t.render, &t.part_grad, NULL, NULL, NULL), SV_OK);
  add_squares();
}

// One pixel value after the other has the gradient 1 and all others 0.
static void add_all_pixels(const sv_crop *crop) {
  sv_planes_clear(&t.grad);
  for (int c = 0; c < 3; c++)
    for (int i = 0; i < W * H; i++) {
      float *one = t.grad.c[c] + i / W * t.grad.stride + i % W;
      *one = 1;
      if (crop) add_lens_pixel(crop);
      else add_view_pixel();
      *one = 0;
    }
}

static void find_exact(double l1) {
  memset(exact, 0, sizeof exact);
  memset(exact_cross, 0, sizeof exact_cross);
  if (!t.n_measurements) add_all_pixels(NULL); // the renderer holds the step's picture
  for (int m = 0; t.n_measurements && m < 2; m++) {
    sv_crop crop;
    const sv_region whole = {0, 0, W, H};
    const sv_render_options o = sv_train_render_options(&t, 1, false);
    assert_true(sv_multiplexed_crop(&t.measurements[0].model, m, &whole, &crop));
    assert_int_equal(sv_render(&t.render, &t.g, &crop.view, &o), SV_OK);
    add_all_pixels(&crop);
  }
  for (int i = 0; i < N_GAUSSIANS; i++)
    for (int r = 0; r < N_ROWS; r++) exact[i][r] /= 3.0 * W * H * l1;
  for (int i = 0; i < N_GAUSSIANS; i++)
    for (int r = 0; r < 3; r++) exact_cross[i][r] /= 3.0 * W * H * l1;
}

// The means of many, each of which is kept as 16 bits.
static double estimate[N_GAUSSIANS][N_ROWS], estimate_cross[N_GAUSSIANS][3];

static void add_estimate(int n) {
  for (int i = 0; i < N_GAUSSIANS; i++)
    for (int r = 0; r < N_ROWS; r++)
      estimate[i][r] += (double)s1_from_high(t.v[sv_gaussians_at(&t.g, i, r) - t.g.param]) / n;
  for (int i = 0; i < N_GAUSSIANS; i++)
    for (int r = 0; r < 3; r++)
      estimate_cross[i][r] += (double)s1_from_high(sv_train_cross_at(&t, i)[16 * r]) / n;
}

// A mean of n squares of about normal numbers scatters by sqrt(2 / n) = 3.7 % of itself. With twice
// the squares of what is in half of the tiles by sqrt(5 / n) = 4.1 % at most, where all is in one
// tile.
static void compare(const char *what) {
  double sum = 0, worst = 0, largest[N_ROWS] = {0};
  int n = 0;
  for (int i = 0; i < N_GAUSSIANS; i++)
    for (int r = 0; r < N_ROWS; r++) largest[r] = exact[i][r] > largest[r] ? exact[i][r] : largest[r];
  for (int i = 0; i < N_GAUSSIANS; i++)
    for (int r = 0; r < N_ROWS; r++) {
      if (!(exact[i][r] > 1e-3 * largest[r])) continue;
      double ratio = estimate[i][r] / exact[i][r];
      sum += ratio;
      n++;
      worst = fabs(ratio - 1) > worst ? fabs(ratio - 1) : worst;
    }
  print_message("%s: %d entries, mean ratio %.4f, worst deviation %.3f\n", what, n, sum / n, worst);
  assert_true(n > N_GAUSSIANS * N_ROWS / 2);
  assert_true(fabs(sum / n - 1) < 0.02);
  assert_true(worst < 0.25);
}

// Products of two normal numbers scatter by 1 / sqrt(n) to sqrt(2 / n) of the geometric mean of
// their variances, whatever their correlation: a deviation is measured by that.
static void compare_cross(const char *what) {
  double sum = 0, worst = 0, most = 0;
  int n = 0;
  for (int i = 0; i < N_GAUSSIANS; i++)
    for (int r = 0; r < 3; r++) {
      const double size = sqrt(exact[i][first[r]] * exact[i][second[r]]);
      if (!(size > 0)) continue;
      const double off = (estimate_cross[i][r] - exact_cross[i][r]) / size;
      sum += off;
      n++;
      worst = fabs(off) > worst ? fabs(off) : worst;
      most = fabs(exact_cross[i][r]) / size > most ? fabs(exact_cross[i][r]) / size : most;
    }
  print_message("%s: %d products, mean deviation %.4f, worst %.3f; correlations up to %.2f\n", what, n,
                sum / n, worst, most);
  assert_true(n > 3 * N_GAUSSIANS / 2);
  assert_true(most > 0.5); // there is something to see
  assert_true(fabs(sum / n) < 0.02);
  assert_true(worst < 0.25);
}

// n estimates, of half of the tiles or of all.
static void check_estimate(const char *what, sv_train_cfg cfg, bool is_measurement, bool is_half, int n) {
  sv_step_stats st;
  cfg.newton.half_from = is_half ? 0 : n;
  open_training(cfg, is_measurement);
  memset(estimate, 0, sizeof estimate);
  memset(estimate_cross, 0, sizeof estimate_cross);
  t.cfg.newton.keep = 0.0f;
  for (int k = 0; k < n; k++) {
    assert_int_equal(sv_train_step(&t, 0.9f, &st), SV_OK);
    add_estimate(n);
  }
  find_exact(st.l1);
  compare(what);
  compare_cross(what);
}

TEST(test_picture) { check_estimate("picture", sv_train_defaults(), false, false, N_PROBES); }

TEST(test_half) { check_estimate("half of the tiles", sv_train_defaults(), false, true, N_HALVES); }

TEST(test_supersampled) {
  sv_train_cfg cfg = sv_train_defaults();
  cfg.is_supersampled = true;
  check_estimate("four samples a pixel, half of the tiles", cfg, false, true, N_HALVES);
}

// Light is added, of which each lens gives half: the curves and the share of both are in J. Always
// of all tiles.
TEST(test_measurement) {
  check_estimate("measurement of two lenses", sv_train_defaults(), true, true, N_PROBES);
}

// --- backward on half of the tiles ---------------------------------------------------------------

static bool is_masked(int i_px, uint32_t colour) {
  return ((uint32_t)(i_px % t.grad.stride / SV_TILE_PX + i_px / t.grad.stride / SV_TILE_PX) & 1) != colour;
}

// The same bits as of a gradient that is 0 in the other half, and the same Gaussians are touched.
TEST(test_chessboard) {
  static float half[SV_CAP_ROWS * 16], whole[SV_CAP_ROWS * 16], probe[3][64 * 32];
  float err[16];
  open_training(sv_train_defaults(), false);
  assert_int_equal(sv_train_step(&t, 0.9f, NULL), SV_OK);
  const int n_px = t.grad.stride * t.grad.rows_padded;
  assert_int_equal(n_px, 64 * 32);
  for (int c = 0; c < 3; c++) memcpy(probe[c], t.grad.c[c], sizeof probe[c]);
  for (uint32_t colour = 0; colour < 2; colour++)
    for (int b = 0; b < (N_GAUSSIANS + 15) / 16; b++) {
      for (int c = 0; c < 3; c++) memcpy(t.grad.c[c], probe[c], sizeof probe[c]);
      assert_int_equal(sv_render_bwd_half(&t.render, &t.grad, colour), SV_OK);
      uint32_t touched = sv_render_bwd_block(&t.render, b, 0, NULL, &(sv_block_grads){half, err, NULL});
      for (int i = 0; i < 3 * n_px; i++)
        if (is_masked(i % n_px, colour)) t.grad.c[i / n_px][i % n_px] = 0;
      assert_int_equal(sv_render_bwd(&t.render, &t.grad, NULL, NULL, NULL), SV_OK);
      assert_int_equal(sv_render_bwd_block(&t.render, b, 0, NULL, &(sv_block_grads){whole, err, NULL}),
                       touched);
      assert_true(touched != 0);
      for (int i = 0; i < 16 * N_ROWS; i++) assert_true(half[i] == whole[i]);
    }
}

// --- what a step does with it --------------------------------------------------------------------

// Rows without an estimate rest; after the first step with one no Gaussian has moved by more than
// the cap.
TEST(test_step) {
  static float before[2 * 16 * N_ROWS];
  sv_train_cfg cfg = sv_train_defaults();
  open_training(cfg, false);
  t.cfg.newton = cfg.newton;
  t.step = 1; // no estimate is due
  memcpy(before, t.g.param, sizeof before);
  assert_int_equal(sv_train_step(&t, 0.5f, NULL), SV_OK);
  assert_memory_equal(before, t.g.param, sizeof before);
  t.step = (uint32_t)cfg.newton.first_every;
  assert_int_equal(sv_train_step(&t, 0.5f, NULL), SV_OK);
  int n_moved = 0;
  float most = 0;
  for (int i = 0; i < N_GAUSSIANS; i++) {
    const float *p = sv_gaussians_at(&t.g, i, SV_ROW_LOGIT);
    float by = fabsf(*p - before[p - t.g.param]);
    n_moved += by > 0;
    most = by > most ? by : most;
  }
  assert_true(n_moved > N_GAUSSIANS / 2);
  assert_true(most <= 1.001f * cfg.newton.cap * cfg.lr.logit);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_picture),      cmocka_unit_test(test_half),
                                     cmocka_unit_test(test_supersampled), cmocka_unit_test(test_measurement),
                                     cmocka_unit_test(test_chessboard),   cmocka_unit_test(test_step)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
