// SPDX-License-Identifier: Apache-2.0
// A trainer that smooths rendered depth: smoother, by the same bits for any order of tasks, in the
// memory that was announced.
#include <math.h>

#include "src/train/train.h"
#include "tests/common/test.h"

enum { W = 64, H = 64, N = 300, STEPS = 60 };

static _Alignas(64) unsigned char block[8 << 20];
static uint8_t px[H][W][3];
static sv_kernels kernels;
static sv_trainer t;

static void run_backwards(void *self, sv_task_fn fn, void *arg, int n_tasks) {
  (void)self;
  for (int i = n_tasks; i-- > 0;) fn(arg, i, i % 3);
}

static sv_train_cfg config(float weight) {
  sv_train_cfg c = sv_train_defaults();
  c.n_gaussians = N;
  c.cap_views = 2;
  c.cap_width_px = W;
  c.cap_height_px = H;
  c.n_threads = 3;
  c.weight_smooth = weight;
  return c;
}

static void train(float weight, const sv_pool *pool) {
  sv_arena a = sv_arena_make(block, sizeof block);
  const sv_train_cfg c = config(weight);
  const sv_init_cfg init = {
      .kind = SV_INIT_SPHERE, .radius = 1, .opacity = 0.3f, .scale_factor = 1, .seed = 4};
  sv_err err = {0};
  assert_ok(sv_trainer_init(&t, &c, (sv_compute){&kernels, pool}, &a, &err), &err);
  assert_true(a.used_bytes == sv_trainer_bytes(&c));
  for (int i = 0; i < 2; i++) {
    const sv_view v = {
        W, H, 60, 60, W / 2.0f, H / 2.0f, {1, 0, 0, 0, 1, 0, 0, 0, 1}, {-0.3f * (float)i, 0, 3}, 0, 0, 0};
    assert_ok(sv_train_add_view(&t, &v, &(sv_image_u8){&px[0][0][0], W, H, 3, 3 * W, NULL}, &err), &err);
  }
  assert_int_equal(sv_train_start(&t, &init, NULL, 0, &a), SV_OK);
  for (int i = 0; i < STEPS; i++) assert_int_equal(sv_train_step(&t, (float)i / STEPS, NULL), SV_OK);
}

// Mean absolute difference of expected depth to the right, where there is some.
static double roughness(void) {
  const sv_render_options o = sv_train_render_options(&t, 1, true);
  double sum = 0;
  int n = 0;
  assert_int_equal(sv_render(&t.render, &t.g, &t.views[0].view, &o), SV_OK);
  for (int y = 0; y < H; y++)
    for (int x = 0; x + 1 < W; x++) {
      const size_t i = (size_t)y * (size_t)t.render.rgb.stride + (size_t)x;
      const double a = 1 - (double)t.render.trans[i], b = 1 - (double)t.render.trans[i + 1];
      if (a < 0.5 || b < 0.5) continue;
      sum += fabs((double)t.render.depth[i] / a - (double)t.render.depth[i + 1] / b);
      n++;
    }
  assert_true(n > 100);
  return sum / n;
}

TEST(test_smoother) {
  const sv_pool in_order = sv_pool_serial(), backwards = {NULL, 3, run_backwards};
  for (int i = 0; i < H * W * 3; i++) px[i / (W * 3)][i / 3 % W][i % 3] = (uint8_t)(i * 2654435761u >> 25);
  sv_kernels_init(&kernels, ~0u);
  train(0, &in_order);
  const double before = roughness();
  train(0.4f, &in_order);
  const double after = roughness();
  const uint64_t digest = sv_train_digest(&t);
  if (!(after < 0.9 * before)) fail_msg("roughness %.5f, without the loss %.5f", after, before);
  train(0.4f, &backwards);
  assert_true(sv_train_digest(&t) == digest);
}

// Planes for it are taken only where it has a weight.
TEST(test_memory) {
  const sv_train_cfg with = config(0.4f), without = config(0);
  const size_t planes = 3 * sv_plane_floats(W, H) * sizeof(float);
  const size_t more = sv_trainer_bytes(&with) - sv_trainer_bytes(&without);
  assert_true(more >= planes && more < planes + 1024);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_smoother), cmocka_unit_test(test_memory)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
