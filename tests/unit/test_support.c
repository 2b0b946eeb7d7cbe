// SPDX-License-Identifier: Apache-2.0
// Which views saw which Gaussians, and the angle between them.
#include <math.h>
#include <string.h>

#include "src/splat/support.h"
#include "tests/common/test.h"

#define W 96
#define H 64
#define N 5

enum { SUBJECT, BEHIND, BESIDE, HALF, FAINT };

static _Alignas(64) uint8_t block[8 << 20];
static sv_renderer r;
static sv_gaussians g;
static sv_support support;
static sv_planes zero;
static float *one;
static sv_kernels kernels;
static sv_pool pool;

static void put(int i, float x, float y, float z, float log_scale, float logit) {
  sv_gaussians_put(&g, i,
                   &(sv_gaussian){.mean = {x, y, z},
                                  .quat_wxyz = {1},
                                  .log_scale = {log_scale, log_scale, log_scale},
                                  .opacity_logit = logit});
}

// A wall of one large, opaque Gaussian at the origin and things around it.
static void open_scene(void) {
  const sv_renderer_cfg cfg = {
      .cap_gaussians = 16, .cap_width_px = W, .cap_height_px = H, .n_threads = 1, .has_grad = true};
  sv_arena a = sv_arena_make(block, sizeof block);
  pool = sv_pool_serial();
  sv_kernels_init(&kernels, ~0u);
  assert_int_equal(sv_gaussians_init(&g, N, 0, &a), SV_OK);
  assert_int_equal(sv_renderer_init(&r, &cfg, (sv_compute){&kernels, &pool}, &a), SV_OK);
  assert_int_equal(sv_planes_init(&zero, W, H, &a), SV_OK);
  one = SV_TAKE(&a, float, sv_plane_floats(W, H));
  const size_t before = a.used_bytes;
  assert_int_equal(sv_support_init(&support, N, 1, &a), SV_OK);
  assert_int_equal(a.used_bytes - before, sv_support_bytes(N, 1));
  put(SUBJECT, 0, 0, 0, -1.5f, 8);
  put(BEHIND, 0, 0, 1, -4, 8);           // hidden from in front, seen from the side
  put(BESIDE, 0, 3, 0, -4, 8);           // outside of all images
  put(HALF, -0.9f, -0.6f, -1, -3, 8);    // in front, in the image
  put(FAINT, 0.8f, 0.5f, -1, -2.3f, -4); // opacity 0.018
}

// From 4 before the origin, turned about the y axis.
static void look(double deg, int exposure) {
  sv_pose pose;
  const double turn = deg * 3.14159265358979 / 180, at[3] = {0}, up[3] = {0, -1, 0};
  const double eye[3] = {4 * sin(turn), 0, -4 * cos(turn)};
  assert_true(sv_pose_look_at(&pose, eye, at, up));
  const sv_view v = sv_view_make(W, H, (const double[]){120, 120, 48, 32}, &pose);
  sv_support_begin(&support, &v, exposure);
  assert_int_equal(sv_render(&r, &g, &v, &(sv_render_options){.near_z = 0.1f}), SV_OK);
  assert_int_equal(sv_support_add(&support, &r, &(sv_support_planes){&zero, one}), SV_OK);
  sv_support_end(&support);
}

static void check(int i, int n_views, int n_exposures, double angle_deg) {
  const sv_support_value v = sv_support_of(&support, &g, i);
  if (v.n_views != n_views || v.n_exposures != n_exposures || fabs(v.angle_deg - angle_deg) > 0.05)
    fail_msg("Gaussian %d: %d views of %d exposures, %.3f degrees; expected %d, %d, %.3f", i, v.n_views,
             v.n_exposures, v.angle_deg, n_views, n_exposures, angle_deg);
}

TEST(test_who_sees_what) {
  open_scene();
  look(0, 0);
  check(SUBJECT, 1, 1, 0);
  look(3, 0);
  check(BEHIND, 0, 0, 0);
  look(20, 1);
  check(SUBJECT, 3, 2, 20);
  check(BEHIND, 1, 1, 0);
  check(BESIDE, 0, 0, 0);
  check(FAINT, 3, 2, sv_support_of(&support, &g, FAINT).angle_deg);
  look(40, -1);
  look(41, -1); // instants of their own
  check(SUBJECT, 5, 4, 41);
  assert_int_equal(sv_support_of(&support, &g, BEHIND).n_views, 3);
  assert_int_equal(sv_support_of(&support, &g, BEHIND).n_exposures, 3);
  const sv_support_value few = {.angle_deg = 2.5}, many = {.angle_deg = 41};
  assert_true(sv_support_score(&few) == 0.5 && sv_support_score(&many) == 1);
  const sv_support_summary s = sv_support_sum_up(&support, &g); // all but the faint one
  assert_int_equal(s.n_views, 5);
  assert_true(fabs(s.unseen - 0.25) < 1e-9 && s.one_view < 1e-9 && s.angle_deg > 5);
}

// In closed form, the sum of alpha is that of the pixels.
TEST(test_alone) {
  open_scene();
  look(0, 0);
  print_message("weights %.4f, %.4f; alone %.4f, %.4f\n", (double)support.weight[HALF],
                (double)support.weight[FAINT], (double)support.alone[HALF], (double)support.alone[FAINT]);
  assert_true(fabsf(support.weight[HALF] / support.alone[HALF] - 1) < 0.02f);
  assert_true(fabsf(support.weight[FAINT] / support.alone[FAINT] - 1) < 0.06f);
  assert_true(support.weight[BEHIND] < 0.05f * support.alone[BEHIND]);
}

TEST(test_spread) {
  assert_int_equal(sv_support_n_asked(7), 7);
  assert_int_equal(sv_support_n_asked(1000), SV_SUPPORT_VIEWS);
  for (int k = 0; k < 7; k++) assert_int_equal(sv_support_asked(7, k), k);
  for (int k = 1; k < SV_SUPPORT_VIEWS; k++)
    assert_in_range(sv_support_asked(1000, k) - sv_support_asked(1000, k - 1), 15, 16);
  assert_true(sv_support_asked(1000, SV_SUPPORT_VIEWS - 1) < 1000);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_who_sees_what), cmocka_unit_test(test_alone),
                                     cmocka_unit_test(test_spread)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
