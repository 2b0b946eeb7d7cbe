// SPDX-License-Identifier: Apache-2.0
// Masked pixels of training views: no gradient and no error there, at any scale; what they hold has
// no influence on the model, whatever else is on, and all kernels and any number of threads give
// the same bits.
#include <string.h>

#include "src/base/rng.h"
#include "src/train/seed.h"
#include "src/train/train.h"
#include "tests/common/test.h"

#define W       136 // 68 at half the size: coarse to fine has two scales
#define H       130
#define N_VIEWS 3

static uint8_t block[48 << 20] __attribute__((aligned(64)));
static uint8_t pictures[N_VIEWS][H * W * 3], masks[N_VIEWS][H * W];
static sv_trainer t;

// A disk of another place in each view is masked; what it holds is up to `fill`.
static void make_pictures(uint64_t fill) {
  sv_rng rng = sv_rng_make(fill, 5);
  for (int v = 0; v < N_VIEWS; v++)
    for (int y = 0; y < H; y++)
      for (int x = 0; x < W; x++) {
        const int dx = x - 40 - 20 * v, dy = y - 60, at = y * W + x;
        masks[v][at] = dx * dx + dy * dy > 35 * 35;
        for (int c = 0; c < 3; c++)
          pictures[v][3 * at + c] =
              (uint8_t)(masks[v][at] ? 40 + (x * (c + 2) + 3 * y) % 170 : (int)sv_rng_below(&rng, 256));
      }
}

static void open_trainer(sv_train_cfg cfg, sv_compute compute, bool has_masks) {
  sv_arena a = sv_arena_make(block, sizeof block);
  sv_err err = {0};
  cfg.n_gaussians = 300;
  cfg.cap_views = N_VIEWS;
  cfg.cap_width_px = W;
  cfg.cap_height_px = H;
  cfg.expected_steps = 60;
  cfg.n_threads = compute.pool->n_threads;
  assert_ok(sv_trainer_init(&t, &cfg, compute, &a, &err), &err);
  for (int v = 0; v < N_VIEWS; v++) {
    sv_pose pose;
    const double eye[3] = {3, 0.6 * (v - 1), 0.5}, at[3] = {0, 0, 0}, up[3] = {0, 0, 1};
    assert_true(sv_pose_look_at(&pose, eye, at, up));
    const sv_view view = sv_view_make(W, H, (const double[]){150, 150, 0.5 * W, 0.5 * H}, &pose);
    const sv_image_u8 im = {pictures[v], W, H, 3, 3 * W, has_masks ? masks[v] : NULL};
    assert_ok(sv_train_add_view(&t, &view, &im, &err), &err);
    sv_train_set_appearance(&t, v, v % 2, v);
  }
  static sv_point points[300];
  const sv_bounds bounds = {{0, 0, 0}, 1};
  sv_seed_points(&t, &bounds, 3, points, 300);
  const sv_init_cfg init = {
      .kind = SV_INIT_POINTS, .radius = 1, .opacity = 0.3f, .scale_factor = 1, .seed = 3};
  assert_int_equal(sv_train_start(&t, &init, points, 300, &a), SV_OK);
}

static void train(int n_steps) {
  for (int i = 0; i < n_steps; i++)
    assert_int_equal(sv_train_step(&t, (float)i / (float)n_steps, NULL), SV_OK);
}

// After one step: exact zeros where one of the k x k pixels is masked, something elsewhere.
TEST(test_no_gradient) {
  const sv_compute compute = compute_serial();
  for (int scale = 1; scale <= 2; scale++) {
    sv_train_cfg cfg = sv_train_defaults();
    sv_step_stats st;
    int n_masked = 0, n_counted = 0;
    cfg.start_scale = scale;
    make_pictures(1);
    open_trainer(cfg, compute, true);
    assert_int_equal(sv_train_step(&t, 0, &st), SV_OK);
    assert_int_equal(st.scale, scale);
    for (int y = 0; y < H / scale; y++)
      for (int x = 0; x < W / scale; x++) {
        const int at = y * t.grad.stride + x;
        bool is_masked = false;
        for (int i = 0; i < scale * scale; i++)
          is_masked |= !masks[st.i_view][(y * scale + i / scale) * W + x * scale + i % scale];
        if (is_masked) {
          assert_true(t.err_plane[at] == 0.0f);
          for (int c = 0; c < 3; c++) assert_true(t.grad.c[c][at] == 0.0f);
        }
        n_masked += is_masked;
        n_counted += !is_masked && t.grad.c[0][at] != 0.0f;
      }
    assert_true(n_masked > 3500 / (scale * scale) && n_counted > 10000 / (scale * scale));
  }
}

static uint64_t digest(sv_train_cfg cfg, uint64_t fill, bool has_masks, uint32_t isa_mask, int n_threads) {
  const sv_compute c = compute_start(isa_mask, n_threads);
  make_pictures(fill);
  open_trainer(cfg, c, has_masks);
  train(60);
  const uint64_t d = sv_train_digest(&t);
  compute_end();
  return d;
}

// The pictures differ in their masked pixels alone: one model comes of them, with masks.
TEST(test_no_influence) {
  sv_train_cfg plain = sv_train_defaults(), all = plain;
  plain.relocate_every = all.relocate_every = 10;
  all.is_supersampled = true;
  all.supersample_from = 0.5f;
  all.appearance.n_cameras = 2;
  all.appearance.n_exposures = N_VIEWS;
  const sv_train_cfg cfgs[2] = {plain, all};
  for (int i = 0; i < 2; i++) {
    const uint64_t first = digest(cfgs[i], 1, true, ~0u, 2);
    assert_true(first == digest(cfgs[i], 2, true, ~0u, 2));
    assert_true(digest(cfgs[i], 1, false, ~0u, 2) != digest(cfgs[i], 2, false, ~0u, 2));
    assert_true(first ==
                // reference kernels, one thread
                digest(cfgs[i], 1, true, sv_isa_only(SV_ISA_REF), 1));
  }
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_no_gradient), cmocka_unit_test(test_no_influence)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
