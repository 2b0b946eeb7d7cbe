// SPDX-License-Identifier: Apache-2.0
// Supersampled training pictures: their value against four renderings' mean in double, a whole step's gradient against
// central differences, and the same bits from all kernels and any number of threads.
// clang-format off
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <cmocka.h>
// clang-format on
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "platform/linux/linux.h"
#include "src/base/mathx.h"
#include "src/splat/render.h"
#include "src/train/train.h"

#define W           37
#define H           26
#define N_GAUSSIANS 20

static uint8_t block[24 << 20] __attribute__((aligned(64)));
static uint8_t picture[2][H * W * 3];
static sv_trainer t;
static float caught[N_GAUSSIANS][SV_CAP_ROWS];
static int n_rows;

// In Adam's place: keeps the gradients, and the parameters as they are.
static void catch_gradients(const sv_adam_args *a, uint32_t touched, const float *grad, float *p, float *m,
                            float *v) {
  int block_of_16 = (int)((p - t.g.param) / (16 * t.g.n_rows));
  (void)m, (void)v;
  n_rows = a->n_rows;
  for (int i = 0; i < a->n_rows; i++)
    for (int k = 0; k < 16; k++)
      if ((touched >> k & 1) && 16 * block_of_16 + k < N_GAUSSIANS)
        caught[16 * block_of_16 + k][i] = grad[16 * i + k];
}

static void open_training(const sv_kernels *k, const sv_pool *pool, sv_train_cfg cfg, float log_scale) {
  sv_arena a = sv_arena_make(block, sizeof block);
  sv_rng rng = sv_rng_make(9, 9);
  sv_err err;
  cfg.n_gaussians = N_GAUSSIANS;
  cfg.cap_views = 2, cfg.cap_width_px = W, cfg.cap_height_px = H;
  cfg.n_threads = pool->n_threads;
  cfg.reg_opacity = cfg.reg_scale = cfg.noise = 0;
  cfg.relocate_every = 0;
  cfg.start_scale = 1;
  if (sv_trainer_init(&t, &cfg, k, pool, &a, &err) < 0) fail_msg("%s", err.text);
  for (int i = 0; i < 2; i++) {
    // The nearest and the farthest value there are: the absolute difference does not bend in between.
    for (int px = 0; px < W * H * 3; px++) picture[i][px] = (px / (20 + 7 * i)) % 2 ? 255 : 0;
    sv_pose pose;
    double eye[3] = {3, i - 0.5, 0.7}, at[3] = {0, 0, 0}, up[3] = {0, 0, 1};
    assert_true(sv_pose_look_at(&pose, eye, at, up));
    sv_view view = sv_view_make(W, H, 40, 41, 18, 13.5, &pose);
    sv_image_u8 im = {picture[i], W, H, 3, W * 3};
    if (sv_train_add_view(&t, &view, &im, &err) < 0) fail_msg("%s", err.text);
  }
  sv_arena scratch = sv_arena_sub(&a, 1 << 20);
  sv_init_cfg init = {.kind = SV_INIT_SPHERE, .radius = 1, .opacity = 0.5f, .scale_factor = 1, .seed = 1};
  assert_int_equal(sv_train_start(&t, &init, NULL, 0, &scratch), SV_OK);
  for (int i = 0; i < N_GAUSSIANS; i++) {
    sv_gaussian g = {.opacity_logit = -1.5f + 0.5f * sv_rng_normal(&rng)};
    for (int q = 0; q < 4; q++) g.quat_wxyz[q] = sv_rng_normal(&rng);
    for (int q = 0; q < 3; q++) {
      g.mean[q] = sv_rng_f(&rng) - 0.5f;
      g.log_scale[q] = log_scale + 0.2f * sv_rng_normal(&rng);
      g.sh[0][q] = 0.8f * (sv_rng_f(&rng) - 0.4f);
    }
    sv_gaussians_put(&t.g, i, &g);
  }
}

static sv_train_cfg settings(void) {
  sv_train_cfg cfg = sv_train_defaults();
  cfg.optimizer = SV_OPTIMIZER_ADAM; // whose kernel keeps the gradients here
  cfg.is_supersampled = true;
  cfg.sh_step = 0;
  return cfg;
}

// --- value ---------------------------------------------------------------------------------------

// Each sample is the pixel of a picture of the same size whose principal point is half a sample off; small splats, so
// that four samples of one pixel differ.
static void test_value(void **state) {
  static double sum[3][H][W];
  double worst = 0, spread = 0;
  sv_kernels k;
  sv_pool pool = sv_pool_serial();
  (void)state;
  sv_kernels_init(&k, ~0u);
  open_training(&k, &pool, settings(), -2.5f);
  sv_render_options o = sv_train_render_options(&t, 1.0f, false);
  const sv_view *v = &t.views[0].view;
  assert_int_equal(sv_train_supersample(&t, v, &o), SV_OK);
  assert_int_equal(t.supersample.mean.width_px, W);
  assert_int_equal(t.supersample.mean.height_px, H);
  // A sample's low-pass is dilation_px2 of its own size: a quarter of that at the pixel's.
  sv_render_options fine = o;
  fine.dilation_px2 = 0.25f * o.dilation_px2;
  for (int s = 0; s < 4; s++) {
    sv_view shifted = *v;
    shifted.cx += s % 2 ? -0.25f : 0.25f, shifted.cy += s / 2 ? -0.25f : 0.25f;
    assert_int_equal(sv_render(&t.render, &k, &pool, &t.g, &shifted, &fine), SV_OK);
    for (int c = 0; c < 3; c++)
      for (int y = 0; y < H; y++)
        for (int x = 0; x < W; x++) {
          double p = (double)t.render.rgb.c[c][y * t.render.rgb.stride + x];
          if (s == 3) spread = fmax(spread, fabs(p - sum[c][y][x] / 3));
          sum[c][y][x] = (s ? sum[c][y][x] : 0) + p;
        }
  }
  for (int c = 0; c < 3; c++)
    for (int y = 0; y < H; y++)
      for (int x = 0; x < W; x++)
        worst = fmax(worst, fabs(0.25 * sum[c][y][x] -
                                 (double)t.supersample.mean.c[c][y * t.supersample.mean.stride + x]));
  print_message("means off by at most %.2g; samples of a pixel differ by up to %.2g\n", worst, spread);
  assert_true(worst < 2e-5);
  assert_true(spread > 0.02);
}

// --- gradient ------------------------------------------------------------------------------------

// The loss of the next view in the order; the trainer is where it was before.
static double loss_of(const sv_trainer *before) {
  sv_step_stats st;
  t.rng = before->rng, t.i_order = before->i_order, t.step = before->step;
  memset(caught, 0, sizeof caught);
  assert_int_equal(sv_train_step(&t, 0.5f, &st), SV_OK);
  return st.loss;
}

typedef struct {
  double diff2, size2;
  int n, n_jumps;
} deviation;

static double quotient(const sv_trainer *before, float *p, float h) {
  float kept = *p;
  *p = kept + h;
  double up_at = (double)*p, up = loss_of(before);
  *p = kept - h;
  double down_at = (double)*p, down = loss_of(before);
  *p = kept;
  return (up - down) / (up_at - down_at);
}

// A quotient that depends on its step straddles a jump (a splat's end, its place in depth): dropped and counted.
static void compare(const sv_trainer *before, float *p, double is, deviation *d) {
  double expected = quotient(before, p, 0.01f), wide = quotient(before, p, 0.02f);
  bool is_jump = fabs(expected - wide) > 0.03 * fabs(expected) + 5e-7;
  d->n += expected != 0, d->n_jumps += is_jump;
  if (is_jump) return;
  d->diff2 += (is - expected) * (is - expected), d->size2 += expected * expected;
}

static void check_gradients(float tv, bool has_unseen) {
  static float grad[N_GAUSSIANS][SV_CAP_ROWS];
  static sv_trainer before;
  sv_kernels k;
  sv_pool pool = sv_pool_serial();
  sv_train_cfg cfg = settings();
  deviation colour = {0, 0, 0, 0}, shape = {0, 0, 0, 0};
  sv_kernels_init(&k, ~0u);
  k.adam = catch_gradients;
  cfg.weight_tv = tv;
  if (has_unseen) cfg.n_unseen = 1, cfg.weight_tv_unseen = 200.0f, cfg.unseen_px = 30;
  open_training(&k, &pool, cfg, 0.9f);
  for (int i = 0; i < 2; i++) {
    before = t;
    (void)loss_of(&before);
    memcpy(grad, caught, sizeof grad);
    for (int g = 0; g < N_GAUSSIANS; g++)
      for (int r = 0; r < n_rows; r++)
        compare(&before, sv_gaussians_at(&t.g, g, r), (double)grad[g][r], r < SV_ROW_SH ? &shape : &colour);
    (void)loss_of(&before); // and on to the next
  }
  double of_colour = sqrt(colour.diff2 / colour.size2), of_shape = sqrt(shape.diff2 / shape.size2);
  print_message(
      "supersampled step, tv %g%s: %d colours off by %.2g (%d jumps), %d shapes by %.2g (%d jumps)\n",
      (double)tv, has_unseen ? ", unseen views" : "", colour.n, of_colour, colour.n_jumps, shape.n, of_shape,
      shape.n_jumps);
  assert_true(colour.n > 100 && shape.n > 300);
  assert_true(colour.n_jumps < 20 && shape.n_jumps < shape.n / 8);
  assert_true(of_colour < 2e-3);
  assert_true(of_shape < 0.015);
}

static void test_gradients(void **state) {
  const char *emulator = getenv("SV_EMULATE");
  (void)state;
  if (emulator && *emulator) {
    print_message("skip the quotients of whole steps: they take minutes under emulation\n");
    skip();
  }
  check_gradients(0, false);
  check_gradients(2000.0f, false);
  check_gradients(0, true);
}

// --- bits, sizes, settings -----------------------------------------------------------------------

static uint64_t digest(uint32_t isa_mask, int n_threads) {
  sv_kernels k;
  sv_linux_pool threads;
  sv_err err;
  assert_int_equal(sv_linux_pool_start(&threads, n_threads, -1, &err), SV_OK);
  sv_pool pool = sv_linux_pool_port(&threads);
  sv_train_cfg cfg = settings();
  sv_step_stats st;
  sv_kernels_init(&k, isa_mask);
  cfg.supersample_from = 0.5f;
  cfg.weight_tv = 0.1f;
  open_training(&k, &pool, cfg, -1.5f);
  for (int i = 0; i < 12; i++) assert_int_equal(sv_train_step(&t, (float)i / 12.0f, &st), SV_OK);
  sv_linux_pool_stop(&threads);
  return sv_train_digest(&t);
}

static void test_same_bits(void **state) {
  (void)state;
  uint64_t ref = digest(SV_ISA_BIT(SV_ISA_REF), 1);
  for (int n = 1; n <= 4; n *= 2) assert_true(digest(~0u, n) == ref);
  for (int isa = 0; isa < SV_N_ISAS; isa++)
    if ((sv_cpu_isas() & SV_ISA_BIT(isa)) && isa != SV_ISA_SSE41)
      assert_true(digest(sv_isa_only((sv_isa)isa), 2) == ref);
}

static void test_from_and_scale(void **state) {
  sv_kernels k;
  sv_pool pool = sv_pool_serial();
  sv_train_cfg cfg = settings();
  (void)state;
  sv_kernels_init(&k, ~0u);
  cfg.supersample_from = 0.5f;
  open_training(&k, &pool, cfg, 0);
  assert_false(sv_train_is_supersampled(&t, 1, 0.4f));
  assert_true(sv_train_is_supersampled(&t, 1, 0.5f));
  assert_false(sv_train_is_supersampled(&t, 2, 0.9f)); // reduced pictures are means of pixels already
  cfg.is_supersampled = false;
  open_training(&k, &pool, cfg, 0);
  assert_false(sv_train_is_supersampled(&t, 1, 0.9f));
}

static void test_too_large(void **state) {
  sv_kernels k;
  sv_pool pool = sv_pool_serial();
  sv_arena a = sv_arena_make(block, sizeof block);
  sv_err err;
  sv_train_cfg cfg = settings();
  (void)state;
  sv_kernels_init(&k, ~0u);
  cfg.cap_width_px = 9000;
  assert_int_equal(sv_trainer_init(&t, &cfg, &k, &pool, &a, &err), SV_E_ARG);
  assert_non_null(strstr(err.text, "9000x480"));
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_value),     cmocka_unit_test(test_gradients),
      cmocka_unit_test(test_same_bits), cmocka_unit_test(test_from_and_scale),
      cmocka_unit_test(test_too_large),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
