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

// Two cameras that see nothing, or a sensor of two lenses that does.
static void add_cameras(sv_trainer *t, bool is_multiplexed) {
  static uint16_t measured[3 * W * H], clear[W * H];
  static sv_lens lens[2];
  sv_err err = {0};
  for (int i = 0; i < 2; i++) {
    lens[i] = (sv_lens){
        .view =
            {W, H, 60, 60, W / 2.0f, H / 2.0f, {1, 0, 0, 0, 1, 0, 0, 0, 1}, {0.3f * (float)i, 0, 3}, 0, 0, 0},
        .footprint = {0, 0, W, H, NULL}};
    if (is_multiplexed) continue;
    assert_int_equal(
        sv_train_add_view(t, &lens[i].view, &(sv_image_u8){&transparent[0][0][0], W, H, 4, 4 * W}, &err),
        SV_OK);
  }
  if (!is_multiplexed) return;
  for (int i = 0; i < W * H; i++) clear[i] = 65535;
  const sv_multiplexed c = {W, H, 2, lens, 2, true};
  assert_ok(sv_train_add_measurement(t, &c, measured, &err), &err);
  sv_train_set_clear(t, clear);
}

// Mean opacity of black Gaussians in front of them, after 60 steps over black.
static double opacity_after(float random_until, bool is_multiplexed) {
  static sv_trainer t;
  const sv_pool serial = sv_pool_serial();
  sv_arena a = sv_arena_make(block, sizeof block);
  sv_err err = {0};
  sv_train_cfg c = sv_train_defaults();
  const sv_init_cfg init = {
      .kind = SV_INIT_SPHERE, .radius = 1, .opacity = 0.5f, .scale_factor = 1, .seed = 4};
  c.n_gaussians = N;
  c.cap_views = is_multiplexed ? 0 : 2;
  c.cap_measurements = c.cap_regions = is_multiplexed;
  c.region_px = W;
  c.cap_width_px = W;
  c.cap_height_px = H;
  c.n_threads = 1;
  c.reg_opacity = 0;
  c.relocate_every = 0;
  c.random_until = random_until;
  assert_int_equal(sv_trainer_init(&t, &c, (sv_compute){&kernels, &serial}, &a, &err), SV_OK);
  add_cameras(&t, is_multiplexed);
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
  for (int is_multiplexed = 0; is_multiplexed < 2; is_multiplexed++) {
    const double over_black = opacity_after(0, is_multiplexed),
                 over_random = opacity_after(1, is_multiplexed);
    print_message("opacity %.3f over black, %.3f over random colors\n", over_black, over_random);
    assert_true(over_black > 0.45 && over_random < 0.15);
  }
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_black_on_black)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
