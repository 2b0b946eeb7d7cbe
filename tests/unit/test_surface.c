// SPDX-License-Identifier: Apache-2.0
// The depth of a large flat Gaussian that lies aslant, at each pixel against its plane.
#include <math.h>
#include <string.h>

#include "src/splat/render.h"
#include "src/splat/surface.h"
#include "tests/common/test.h"

#define W 96
#define H 64

static _Alignas(64) uint8_t block[4 << 20];
static float depth[2][H * 128];

static sv_renderer r;

static void make(sv_gaussians *g, sv_compute compute, sv_arena *a) {
  const sv_gaussian flat = {.mean = {0.1f, -0.05f, 3},
                            .quat_wxyz = {0.92388f, 0.2f, 0.3f, 0.1f},
                            .log_scale = {-0.7f, -0.7f, -7},
                            .opacity_logit = 6};
  const sv_renderer_cfg cfg = {.cap_gaussians = 16, .cap_width_px = W, .cap_height_px = H, .n_threads = 1};
  assert_int_equal(sv_gaussians_init(g, 1, 0, a), SV_OK);
  sv_gaussians_put(g, 0, &flat);
  assert_int_equal(sv_renderer_init(&r, &cfg, compute, a), SV_OK);
}

// Of the ray through a pixel with the plane of the Gaussian, whose normal is its third axis.
static double truth(const sv_gaussians *g, const sv_view *v, int x, int y) {
  sv_gaussian flat;
  double q[4], axes[9], along = 0, to = 0;
  float ray[3];
  sv_gaussians_get(g, 0, &flat);
  for (int k = 0; k < 4; k++) q[k] = (double)flat.quat_wxyz[k];
  sv_quat_to_mat(axes, q);
  assert_true(sv_view_ray(v, (float)x + 0.5f, (float)y + 0.5f, ray));
  for (int k = 0; k < 3; k++) {
    along += axes[3 * k + 2] * (double)ray[k];
    to += axes[3 * k + 2] * (double)flat.mean[k];
  }
  return to / along;
}

TEST(depth_follows_the_plane) {
  const sv_pose pose = {.r = {1, 0, 0, 0, 1, 0, 0, 0, 1}};
  const sv_view v = sv_view_make(W, H, (const double[]){120, 120, 48, 32}, &pose);
  const sv_render_options plain = {.near_z = 0.1f, .has_depth = true};
  sv_arena a = sv_arena_make(block, sizeof block);
  sv_kernels k;
  sv_pool pool = sv_pool_serial();
  sv_gaussians g;
  double error[2] = {0};
  int n = 0;
  sv_kernels_init(&k, ~0u);
  make(&g, (sv_compute){&k, &pool}, &a);
  assert_int_equal(sv_render(&r, &g, &v, &plain), SV_OK);
  sv_render_expected_depth(&r, 0.5f, depth[0]);
  sv_render_surface(&r, &g, &v, sv_surface_slab, depth[1]);
  for (int y = 0; y < H; y++)
    for (int x = 0; x < W; x++) {
      const float *d = depth[0] + y * r.rgb.stride + x;
      if (!(*d > 0)) continue;
      n++;
      for (int i = 0; i < 2; i++)
        error[i] += fabs((double)depth[i][y * r.rgb.stride + x] / truth(&g, &v, x, y) - 1);
    }
  assert_true(n > 500);
  print_message("%d pixels: off by %.2f %% with depths of centers, %.2f %% with planes\n", n,
                100 * error[0] / n, 100 * error[1] / n);
  assert_true(error[0] > 0.04 * n && error[1] < 0.01 * n);
}

// A wide faint Gaussian before a surface of translucent ones, and another surface behind it.
TEST(floaters_and_what_is_behind_do_not_count) {
  const sv_pose pose = {.r = {1, 0, 0, 0, 1, 0, 0, 0, 1}};
  const sv_view v = sv_view_make(W, H, (const double[]){120, 120, 48, 32}, &pose);
  const sv_render_options o = {.near_z = 0.1f, .has_depth = true};
  // Depth, opacity, log-scale.
  static const float layer[][3] = {{1, 0.2f, 0}, {3, 0.4f, 1}, {4, 0.95f, 1}};
  sv_arena a = sv_arena_make(block, sizeof block);
  sv_kernels k;
  sv_pool pool = sv_pool_serial();
  sv_gaussians g;
  const sv_renderer_cfg cfg = {.cap_gaussians = 16, .cap_width_px = W, .cap_height_px = H, .n_threads = 1};
  sv_kernels_init(&k, ~0u);
  assert_int_equal(sv_gaussians_init(&g, 3, 0, &a), SV_OK);
  for (int i = 0; i < 3; i++) {
    const sv_gaussian flat = {.mean = {0, 0, layer[i][0]},
                              .quat_wxyz = {1, 0, 0, 0},
                              .log_scale = {layer[i][2], layer[i][2], -7},
                              .opacity_logit = logf(layer[i][1] / (1 - layer[i][1]))};
    sv_gaussians_put(&g, i, &flat);
  }
  assert_int_equal(sv_renderer_init(&r, &cfg, (sv_compute){&k, &pool}, &a), SV_OK);
  assert_int_equal(sv_render(&r, &g, &v, &o), SV_OK);
  sv_render_expected_depth(&r, 0.5f, depth[0]);
  sv_render_surface(&r, &g, &v, sv_surface_slab, depth[1]);
  const long middle = H / 2 * r.rgb.stride + W / 2;
  print_message("expected %.3f, surface %.3f\n", (double)depth[0][middle], (double)depth[1][middle]);
  assert_true(fabsf(depth[1][middle] - 3) < 0.001f);
  assert_true(fabsf(depth[0][middle] - 3) > 0.05f);
  // The layers in front of the slab alone.
  sv_render_surface(&r, &g, &v, (sv_depth_slab){0.9f, 0.85f, 0}, depth[1]);
  assert_true(fabsf(depth[1][middle] - 1) < 0.001f);
  // More light passes than the slab lets through: nothing is there.
  g.n = 1;
  assert_int_equal(sv_render(&r, &g, &v, &o), SV_OK);
  sv_render_surface(&r, &g, &v, sv_surface_slab, depth[1]);
  assert_true(depth[1][middle] == 0);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(depth_follows_the_plane),
                                     cmocka_unit_test(floaters_and_what_is_behind_do_not_count)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
