// SPDX-License-Identifier: Apache-2.0
// The running means of the Gaussians' errors, which relocation asks for: which steps add to them.
#include <string.h>

#include "platform/linux/linux.h"
#include "src/train/train.h"
#include "src/train/optimize.h"
#include "tests/common/test.h"

#define W           48
#define H           40
#define N_GAUSSIANS 200
#define N_STEPS     40

static uint8_t block[32 << 20] __attribute__((aligned(64)));
static uint8_t picture[H * W * 3];
static sv_trainer t;

static void open_training(uint64_t seed, int relocate_every) {
  static sv_kernels k;
  static sv_pool pool;
  sv_arena a = sv_arena_make(block, sizeof block);
  sv_err err;
  sv_kernels_init(&k, ~0u);
  pool = sv_pool_serial();
  sv_train_cfg cfg = sv_train_defaults();
  cfg.n_gaussians = N_GAUSSIANS;
  cfg.cap_views = 1;
  cfg.cap_width_px = W;
  cfg.cap_height_px = H;
  cfg.seed = seed;
  cfg.relocate_every = relocate_every;
  cfg.start_scale = 1;
  sv_arena scratch = sv_arena_sub(&a, sv_init_scratch_bytes(N_GAUSSIANS, 0) + SV_ARENA_ALIGN);
  if (sv_trainer_init(&t, &cfg, (sv_compute){&k, &pool}, &a, &err) < 0) fail_msg("%s", err.text);
  for (int i = 0; i < W * H * 3; i++) picture[i] = (uint8_t)(i * 37 % 251);
  sv_pose pose = sv_pose_identity();
  pose.t[2] = 4;
  sv_view view = sv_view_make(W, H, (const double[]){60, 60, W / 2.0, H / 2.0}, &pose);
  sv_image_u8 im = {picture, W, H, 3, W * 3};
  assert_ok(sv_train_add_view(&t, &view, &im, &err), &err);
  sv_init_cfg init = {
      .kind = SV_INIT_SPHERE, .radius = 1.0f, .opacity = 0.3f, .scale_factor = 1, .seed = seed};
  assert_int_equal(sv_train_start(&t, &init, NULL, 0, &scratch), SV_OK);
}

// Steps that change the means, as bits.
static uint64_t steps_with_errors(float progress) {
  uint64_t steps = 0;
  for (int i = 0; i < N_STEPS; i++) {
    float before[N_GAUSSIANS];
    sv_step_stats st;
    const bool is_due = sv_train_is_error_due(&t, progress);
    memcpy(before, t.err, sizeof before);
    assert_int_equal(sv_train_step(&t, progress, &st), SV_OK);
    const bool has_changed = memcmp(before, t.err, sizeof before) != 0;
    assert_int_equal(has_changed, is_due);
    steps |= (uint64_t)has_changed << i;
  }
  return steps;
}

TEST(test_one_of_four_adds) {
  uint64_t of_seed[2], in_turn = 0;
  for (uint64_t seed = 0; seed < 2; seed++) {
    open_training(seed + 1, 1000);
    of_seed[seed] = steps_with_errors(0.5f);
    for (int i = 0; i < N_STEPS; i += 4) assert_int_equal(__builtin_popcountll(of_seed[seed] >> i & 15), 1);
  }
  assert_true(of_seed[0] != of_seed[1]);
  for (int i = 0; i < N_STEPS; i += 4) in_turn |= (of_seed[0] >> i) & 15;
  assert_int_equal(in_turn, 15); // no step of the four is always passed over
}

TEST(test_nobody_asks) {
  open_training(1, 1000);
  assert_true(steps_with_errors(0.95f) == 0); // behind the last relocation
  open_training(1, 0);
  assert_true(steps_with_errors(0.5f) == 0);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_one_of_four_adds),
      cmocka_unit_test(test_nobody_asks),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
