// SPDX-License-Identifier: Apache-2.0
// Backgrounds of images with alpha.
#include <string.h>

#include "src/base/mathx.h"
#include "src/train/train.h"
#include "tests/common/test.h"

enum { W = 64, H = 64, N = 100 };

static _Alignas(64) unsigned char block[8 << 20];
static uint8_t transparent[H][W][4];
static sv_kernels kernels;

// Mean opacity of black Gaussians in front of cameras that see nothing, after 60 steps over black.
static double opacity_after(float random_until) {
  static sv_trainer t;
  const sv_pool serial = sv_pool_serial();
  sv_arena a = sv_arena_make(block, sizeof block);
  sv_err err = {0};
  sv_train_cfg c = sv_train_defaults();
  const sv_init_cfg init = {
      .kind = SV_INIT_SPHERE, .radius = 1, .opacity = 0.5f, .scale_factor = 1, .seed = 4};
  c.n_gaussians = N;
  c.cap_views = 2;
  c.cap_width_px = W;
  c.cap_height_px = H;
  c.n_threads = 1;
  c.reg_opacity = 0;
  c.relocate_every = 0;
  c.random_until = random_until;
  assert_int_equal(sv_trainer_init(&t, &c, (sv_compute){&kernels, &serial}, &a, &err), SV_OK);
  for (int i = 0; i < 2; i++) {
    const sv_view v = {W, H, 60, 60, W / 2.0f, H / 2.0f, {1, 0, 0, 0, 1, 0, 0, 0, 1}, {0.3f * (float)i, 0, 3},
                       0, 0, 0};
    assert_int_equal(sv_train_add_view(&t, &v, &(sv_image_u8){&transparent[0][0][0], W, H, 4, 4 * W}, &err),
                     SV_OK);
  }
  assert_int_equal(sv_train_start(&t, &init, NULL, 0, &a), SV_OK);
  for (int i = 0; i < N; i++)
    for (int k = 0; k < 3; k++) *sv_gaussians_at(&t.g, i, SV_ROW_SH + k) = -1.8f; // black
  for (int i = 0; i < 60; i++) assert_int_equal(sv_train_step(&t, (float)i / 60, NULL), SV_OK);
  double sum = 0;
  for (int i = 0; i < N; i++) sum += 1 / (1 + sv_exp(-(double)*sv_gaussians_at(&t.g, i, SV_ROW_LOGIT))) / N;
  return sum;
}

// Over black they look like nothing; over random colors they go.
TEST(test_black_on_black) {
  memset(transparent, 0, sizeof transparent);
  sv_kernels_init(&kernels, ~0u);
  const double over_black = opacity_after(0), over_random = opacity_after(1);
  print_message("opacity %.3f over black, %.3f over random colors\n", over_black, over_random);
  assert_true(over_black > 0.45 && over_random < 0.15);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_black_on_black)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
