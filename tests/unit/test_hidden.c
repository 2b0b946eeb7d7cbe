// SPDX-License-Identifier: Apache-2.0
// Gaussians that no view sees and that lie far behind the surface become dead.
#include <string.h>

#include "src/splat/constants.h"
#include "src/train/hidden.h"
#include "tests/common/test.h"

#define W 64
#define H 64
#define N 6

enum { WALL, FAR_BEHIND, BEHIND, BESIDE, OUTSIDE, BACKGROUND };

static _Alignas(64) unsigned char block[16 << 20];
static uint8_t black[H][W][3];
static sv_kernels kernels;
static sv_pool pool;
static sv_trainer t;

static void put(int i, float x, float z, float log_scale, float logit) {
  sv_gaussians_put(&t.g, i,
                   &(sv_gaussian){.mean = {x, 0, z},
                                  .quat_wxyz = {1},
                                  .log_scale = {log_scale, log_scale, log_scale},
                                  .opacity_logit = logit});
}

// A wall at z = 0, two cameras before it, side by side. The scene's radius is 1.
static void open_scene(int hidden_every) {
  sv_arena a = sv_arena_make(block, sizeof block);
  sv_train_cfg c = sv_train_defaults();
  sv_err err = {0};
  pool = sv_pool_serial();
  sv_kernels_init(&kernels, ~0u);
  c.n_gaussians = N;
  c.cap_views = 2;
  c.cap_width_px = W;
  c.cap_height_px = H;
  c.relocate_every = 10;
  c.hidden_every = hidden_every;
  assert_ok(sv_trainer_init(&t, &c, (sv_compute){&kernels, &pool}, &a, &err), &err);
  for (int i = 0; i < 2; i++) {
    const sv_view v = {W, H, 60, 60, W / 2.0f, H / 2.0f, {1, 0, 0, 0, 1, 0, 0, 0, 1}, {0.1f * (float)i, 0, 4},
                       0, 0, 0};
    assert_ok(sv_train_add_view(&t, &v, &(sv_image_u8){&black[0][0][0], W, H, 3, 3 * W, NULL}, &err), &err);
  }
  t.g.n = N;
  t.radius = 1;
  put(WALL, 0, 0, -0.7f, 6);
  put(FAR_BEHIND, 0, 0.8f, -4, 2);
  put(BEHIND, 0.05f, 0.3f, -4, 2);
  put(BESIDE, 1.9f, 0.8f, -4, 2); // the cameras see past the wall
  put(OUTSIDE, 9, 0.8f, -4, 2);   // of both images
  put(BACKGROUND, 0, 11, -1, 2);
}

static float logit(int i) { return *sv_gaussians_at(&t.g, i, SV_ROW_LOGIT); }

TEST(test_far_behind) {
  int n = -1;
  open_scene(10);
  assert_int_equal(sv_train_prune_hidden(&t, &n), SV_OK);
  assert_int_equal(n, 1);
  assert_true(logit(FAR_BEHIND) < -5.3f && logit(WALL) == 6);
  for (int i = BEHIND; i < N; i++) assert_true(logit(i) == 2);
}

// One view that sees it is enough.
TEST(test_seen_once) {
  int n = -1;
  open_scene(10);
  t.views[1].view.t[0] = -3; // past the wall
  t.views[1].view.cx += 45;
  assert_int_equal(sv_train_prune_hidden(&t, &n), SV_OK);
  assert_int_equal(n, 0);
}

TEST(test_due) {
  open_scene(20);
  t.step = 40;
  assert_true(sv_train_is_hidden_due(&t, 0.5f));
  assert_false(sv_train_is_hidden_due(&t, 0.9f)); // what relocation would not take
  t.step = 30;
  assert_false(sv_train_is_hidden_due(&t, 0.5f));
  open_scene(0);
  assert_false(sv_train_is_hidden_due(&t, 0.5f));
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_far_behind), cmocka_unit_test(test_seen_once),
                                     cmocka_unit_test(test_due)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
