// SPDX-License-Identifier: Apache-2.0
// Relocation with a share: what matters least moves to where the error is, and a long Gaussian is
// cut in two there.
#include <math.h>
#include <string.h>

#include "platform/linux/linux.h"
#include "src/base/mathx.h"
#include "src/splat/constants.h"
#include "src/train/relocate.h"
#include "tests/common/test.h"

#define N 100

static uint8_t block[32 << 20] __attribute__((aligned(64)));
static sv_trainer t;

// In a row along x, of equal size and error; that number `weak` is nearly transparent, and all
// error that counts is in `wrong`, `ratio` times as long along y as across.
static void open_row(float share, int weak, int wrong, double ratio) {
  static sv_kernels k;
  static sv_pool pool;
  sv_arena a = sv_arena_make(block, sizeof block);
  sv_err err;
  sv_kernels_init(&k, ~0u);
  pool = sv_pool_serial();
  sv_train_cfg cfg = sv_train_defaults();
  cfg.n_gaussians = N;
  cfg.cap_views = 1;
  cfg.cap_width_px = cfg.cap_height_px = 32;
  cfg.relocate_share = share;
  if (sv_trainer_init(&t, &cfg, (sv_compute){&k, &pool}, &a, &err) < 0) fail_msg("%s", err.text);
  for (int i = 0; i < N; i++) {
    sv_gaussian g = {
        .mean = {(float)i, 0, 0}, .quat_wxyz = {1, 0, 0, 0}, .opacity_logit = i == weak ? -4 : 1};
    for (int c = 0; c < 3; c++) g.log_scale[c] = -2;
    if (i == wrong) g.log_scale[1] += (float)log(ratio);
    sv_gaussians_put(&t.g, i, &g);
    t.err[i] = i == wrong ? 1e6f : 1;
  }
}

static sv_gaussian at(int i) {
  sv_gaussian g;
  sv_gaussians_get(&t.g, i, &g);
  return g;
}

TEST(test_least) {
  open_row(0.01f, 7, 20, 1);
  t.err[8] = 0.9f;
  assert_int_equal(sv_train_relocate(&t, 0.1f), 1);
  assert_true(fabsf(at(7).mean[0] - 20) < 1 && at(8).mean[0] == 8);
  open_row(0.02f, 7, 20, 1);
  t.err[8] = 0.9f;
  assert_int_equal(sv_train_relocate(&t, 0.1f), 2);
  assert_true(fabsf(at(7).mean[0] - 20) < 1 && fabsf(at(8).mean[0] - 20) < 1);
  assert_true(at(9).mean[0] == 9);
  open_row(0.02f, 7, 20, 1);
  assert_int_equal(sv_train_relocate(&t, 0.5f), 0); // fine-tuning
  open_row(0, 7, 20, 1);
  assert_int_equal(sv_train_relocate(&t, 0.1f), 0); // none is dead
}

// The halves lie on both sides, have the whole's mean and second moment, and are as thick.
TEST(test_cut) {
  open_row(0.01f, 7, 20, 4);
  const sv_gaussian whole = at(20);
  assert_int_equal(sv_train_relocate(&t, 0.1f), 1);
  const sv_gaussian a = at(20), b = at(7);
  const double sigma = exp((double)whole.log_scale[1]), half = exp((double)a.log_scale[1]);
  assert_true(fabs((double)(a.mean[1] + b.mean[1])) < 1e-5 && fabsf(b.mean[0] - 20) < 1e-5f);
  assert_true(fabs((double)a.mean[1]) > 0.5 * sigma);
  assert_true(fabs(half * half + (double)a.mean[1] * (double)a.mean[1] - sigma * sigma) <
              0.05 * sigma * sigma);
  for (int c = 0; c < 3; c++) assert_true(a.log_scale[c] == b.log_scale[c]);
  assert_true(a.log_scale[0] == whole.log_scale[0] && a.opacity_logit == b.opacity_logit);
  assert_true(a.opacity_logit < whole.opacity_logit);
  // a round one becomes two smaller ones as in 3DGS-MCMC
  open_row(0.01f, 7, 20, 1);
  assert_int_equal(sv_train_relocate(&t, 0.1f), 1);
  assert_true(at(20).mean[1] == 0 && at(20).log_scale[0] == at(20).log_scale[1]);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_least), cmocka_unit_test(test_cut)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
