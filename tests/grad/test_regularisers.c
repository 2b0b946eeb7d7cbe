// SPDX-License-Identifier: Apache-2.0
// The regularisers that the projection's backward pass adds: reg_opacity sum(o) + reg_scale sum(s)
// over the touched Gaussians, against central differences in double.
#include <math.h>
#include <string.h>

#include "src/splat/render.h"
#include "tests/common/test.h"

#define N 40

static _Alignas(64) unsigned char block[8 << 20];

static double value(double logit, const double *ls, const sv_regularisers *reg) {
  double s = 0;
  for (int k = 0; k < 3; k++) s += exp(ls[k]);
  return (double)reg->opacity / (1 + exp(-logit)) + (double)reg->scale * s;
}

static void test_isa(sv_isa isa) {
  sv_arena a = sv_arena_make(block, sizeof block);
  sv_kernels k;
  sv_gaussians g;
  sv_renderer r;
  sv_planes zero;
  sv_pool pool = sv_pool_serial();
  sv_regularisers reg = {0.3f, 0.7f};
  sv_renderer_cfg cfg = {
      .cap_gaussians = N, .cap_width_px = 64, .cap_height_px = 48, .n_threads = 1, .has_grad = true};
  sv_kernels_init(&k, sv_isa_only(isa));
  assert_int_equal(sv_gaussians_init(&g, N, 1, &a), SV_OK);
  assert_int_equal(sv_renderer_init(&r, &cfg, (sv_compute){&k, &pool}, &a), SV_OK);
  assert_int_equal(sv_planes_init(&zero, 64, 48, &a), SV_OK);
  float *grad = SV_TAKE(&a, float, SV_CAP_ROWS * 16), *err = SV_TAKE(&a, float, 16);
  sv_rng rng = sv_rng_make(5, 1);
  for (int i = 0; i < N; i++) {
    sv_gaussian v = {.quat_wxyz = {1, 0, 0, 0}, .opacity_logit = 3 * sv_rng_normal(&rng)};
    for (int c = 0; c < 3; c++) {
      v.mean[c] = sv_rng_f(&rng) - 0.5f;
      v.log_scale[c] = -2.5f + sv_rng_normal(&rng) * 0.5f;
    }
    sv_gaussians_put(&g, i, &v);
  }
  sv_pose pose = sv_pose_identity();
  pose.t[2] = 3;
  sv_view view = sv_view_make(64, 48, (const double[]){80, 80, 32, 24}, &pose);
  sv_render_options o = {.sh_degree = 1, .near_z = 0.01f};
  assert_int_equal(sv_render(&r, &g, &view, &o), SV_OK);
  assert_int_equal(sv_render_bwd(&r, &zero, NULL, NULL, NULL), SV_OK); // only the regularisers act
  int n = 0;
  for (int b = 0; b < g.cap / 16; b++) {
    uint32_t touched = sv_render_bwd_block(&r, b, 0, &reg, &(sv_block_grads){grad, err, NULL});
    for (int lane = 0; lane < 16; lane++) {
      const float *p = sv_gaussians_at(&g, 16 * b + lane, 0);
      double l = (double)p[16 * SV_ROW_LOGIT], h = 1e-6, ls[3];
      bool is_on = touched >> lane & 1;
      n += is_on;
      for (int c = 0; c < 3; c++) ls[c] = (double)p[16 * (SV_ROW_SCALE + c)];
      double d = is_on ? (value(l + h, ls, &reg) - value(l - h, ls, &reg)) / (2 * h) : 0;
      assert_true(fabs((double)grad[16 * SV_ROW_LOGIT + lane] - d) < 1e-6);
      for (int c = 0; c < 3; c++) {
        double keep = ls[c];
        ls[c] = keep + h;
        double up = value(l, ls, &reg);
        ls[c] = keep - h;
        d = is_on ? (up - value(l, ls, &reg)) / (2 * h) : 0;
        ls[c] = keep;
        assert_true(fabs((double)grad[16 * (SV_ROW_SCALE + c) + lane] - d) < 1e-6);
      }
    }
  }
  assert_true(n > N / 2);
}

TEST(test_all) {
  for (int i = 0; i < SV_N_ISAS; i++)
    if (sv_cpu_isas() & SV_ISA_BIT(i)) test_isa((sv_isa)i);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_all)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
