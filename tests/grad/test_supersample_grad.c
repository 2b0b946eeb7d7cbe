// SPDX-License-Identifier: Apache-2.0
// Supersampled training pictures: their value against four renderings' mean in double, a whole
// step's gradient against central differences, and the same bits from all kernels and any number of
// threads.
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "platform/linux/linux.h"
#include "src/base/mathx.h"
#include "src/splat/render.h"
#include "src/train/supersample.h"
#include "tests/common/step_gradient.h"
#include "tests/common/test.h"

#define W 37
#define H 26

static uint8_t block[24 << 20] __attribute__((aligned(64)));
static uint8_t picture[2][H * W * 3];
static sv_trainer t;
static void open_training(const sv_kernels *k, const sv_pool *pool, sv_train_cfg cfg, float log_scale) {
  sv_arena a = sv_arena_make(block, sizeof block);
  sv_err err;
  step_gradient_settings(&cfg);
  cfg.cap_views = 2;
  cfg.cap_width_px = W;
  cfg.cap_height_px = H;
  cfg.n_threads = pool->n_threads;
  if (sv_trainer_init(&t, &cfg, (sv_compute){k, pool}, &a, &err) < 0) fail_msg("%s", err.text);
  for (int i = 0; i < 2; i++) {
    // The nearest and the farthest value there are: the absolute difference has no kink in
    // between.
    for (int px = 0; px < W * H * 3; px++) picture[i][px] = (px / (20 + 7 * i)) % 2 ? 255 : 0;
    sv_pose pose;
    double eye[3] = {3, i - 0.5, 0.7}, at[3] = {0, 0, 0}, up[3] = {0, 0, 1};
    assert_true(sv_pose_look_at(&pose, eye, at, up));
    sv_view view = sv_view_make(W, H, (const double[]){40, 41, 18, 13.5}, &pose);
    sv_image_u8 im = {picture[i], W, H, 3, W * 3};
    assert_ok(sv_train_add_view(&t, &view, &im, &err), &err);
  }
  step_gradient_start(&t, log_scale, &a);
}

static sv_train_cfg settings(void) {
  sv_train_cfg cfg = sv_train_defaults();
  cfg.is_supersampled = true;
  return cfg;
}

// --- value ---------------------------------------------------------------------------------------

// Each sample is the pixel of a picture of the same size whose principal point is half a sample
// off; small splats, so that four samples of one pixel differ.
TEST(test_value) {
  static double sum[3][H][W];
  double worst = 0, spread = 0;
  sv_kernels k;
  sv_pool pool = sv_pool_serial();
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
    shifted.cx += s % 2 ? -0.25f : 0.25f;
    shifted.cy += s / 2 ? -0.25f : 0.25f;
    assert_int_equal(sv_render(&t.render, &t.g, &shifted, &fine), SV_OK);
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

static void check_gradients(float tv, bool has_novel) {
  sv_kernels k;
  sv_pool pool = sv_pool_serial();
  sv_train_cfg cfg = settings();
  step_gradient sum = {0};
  char what[80];
  step_gradient_kernels(&k);
  cfg.weight_tv = tv;
  if (has_novel) {
    cfg.n_novel = 1;
    cfg.weight_tv_novel = 200.0f;
    cfg.novel_px = 30;
  }
  open_training(&k, &pool, cfg, 0.9f);
  for (int i = 0; i < 2; i++) step_gradient_check(&t, &sum);
  snprintf(what, sizeof what, "supersampled step, tv %g%s", (double)tv, has_novel ? ", novel views" : "");
  step_gradient_agrees(&sum, what, 100, 300, 8);
}

TEST(test_gradients) {
  if (is_emulated()) {
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

TEST(test_same_bits) {
  uint64_t ref = digest(SV_ISA_BIT(SV_ISA_REF), 1);
  for (int n = 1; n <= 4; n *= 2) assert_true(digest(~0u, n) == ref);
  for (int isa = 0; isa < SV_N_ISAS; isa++)
    if ((sv_cpu_isas() & SV_ISA_BIT(isa)) && isa != SV_ISA_SSE41)
      assert_true(digest(sv_isa_only((sv_isa)isa), 2) == ref);
}

TEST(test_from_and_scale) {
  sv_kernels k;
  sv_pool pool = sv_pool_serial();
  sv_train_cfg cfg = settings();
  sv_kernels_init(&k, ~0u);
  cfg.supersample_from = 0.5f;
  open_training(&k, &pool, cfg, 0);
  assert_false(sv_train_is_supersampled(&t, 1, 0.4f));
  assert_true(sv_train_is_supersampled(&t, 1, 0.5f));
  // reduced pictures are means of pixels already
  assert_false(sv_train_is_supersampled(&t, 2, 0.9f));
  cfg.is_supersampled = false;
  open_training(&k, &pool, cfg, 0);
  assert_false(sv_train_is_supersampled(&t, 1, 0.9f));
}

TEST(test_too_large) {
  sv_kernels k;
  sv_pool pool = sv_pool_serial();
  sv_arena a = sv_arena_make(block, sizeof block);
  sv_err err;
  sv_train_cfg cfg = settings();
  sv_kernels_init(&k, ~0u);
  cfg.cap_width_px = 9000;
  assert_int_equal(sv_trainer_init(&t, &cfg, (sv_compute){&k, &pool}, &a, &err), SV_E_ARG);
  assert_contains(err.text, "9000x480");
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_value),     cmocka_unit_test(test_gradients),
      cmocka_unit_test(test_same_bits), cmocka_unit_test(test_from_and_scale),
      cmocka_unit_test(test_too_large),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
