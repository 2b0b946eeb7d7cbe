// SPDX-License-Identifier: Apache-2.0
// `motion` and `motion_bwd`.
#include <string.h>

#include "kernels/project/project.h"
#include "tests/kernels/check.h"

#define N_BLOCKS 3

static const int counts[][4] = {{14, 3, 2, 1}, {23, 0, 0, 0}, {14, 12, 12, 12}, {59, 6, 0, 3}, {38, 1, 3, 0}};
static const uint32_t masks[] = {0xffff, 0, 1, 0x8000, 0x5a5a};

typedef struct {
  sv_motion_args a;
  float *grad, *out;
  int n_motion_rows;
} job;

static job make_job(ck *c, const int n[4], int fill) {
  int n_m = SV_N_MROWS(n[1], n[2], n[3]);
  size_t n_p = (size_t)N_BLOCKS * (size_t)n[0] * 16, n_mo = (size_t)N_BLOCKS * (size_t)n_m * 16;
  float *param = ck_floats(c, n_p), *motion = ck_floats(c, n_mo), *f = ck_floats(c, SV_CAP_MOTION_FUNCTIONS);
  job j = {.n_motion_rows = n_m, .grad = ck_floats(c, (size_t)n[0] * 16)};
  ck_fill(c, param, n_p, fill);
  ck_fill(c, motion, n_mo, fill);
  ck_fill(c, f, SV_CAP_MOTION_FUNCTIONS, CK_SIGNED);
  ck_fill(c, j.grad, (size_t)n[0] * 16, fill);
  for (int b = 0; b < N_BLOCKS; b++) // sharpnesses are logarithms; one lane at rest
    for (int k = 0; k < 16; k++) {
      float *m = motion + (size_t)b * (size_t)n_m * 16 + k;
      m[16 * SV_MROW_SHARPNESS] = k == 3 ? -60.0f : (float)(k - 6);
      for (int r = SV_MROW_FUNCTIONS; r < n_m && k == 5; r++) m[16 * r] = 0.0f;
    }
  j.a = (sv_motion_args){.param = param,
                         .motion = motion,
                         .n_rows = n[0],
                         .n_pos = n[1],
                         .n_rot = n[2],
                         .n_colour = n[3],
                         .f_pos = f,
                         .f_rot = f,
                         .f_colour = f,
                         .t = 0.3f,
                         .reg_pos = 0.01f,
                         .reg_rot = 0.02f,
                         .reg_col = 0.03f};
  return j;
}

static void check_motion(ck *c) {
  for (size_t i = 0; i < sizeof counts / sizeof *counts; i++)
    for (int fill = 0; fill < CK_N_FILLS; fill++) {
      if (!c->is_exact && fill >= CK_DENORM) continue;
      ck_begin(c, "rows %d functions %d %d %d %s", counts[i][0], counts[i][1], counts[i][2], counts[i][3],
               ck_fill_name(fill));
      job j = make_job(c, counts[i], fill);
      size_t n = (size_t)N_BLOCKS * (size_t)j.a.n_rows * 16;
      float *a = ck_floats(c, n), *b = ck_floats(c, n);
      j.a.moved = a;
      c->ref.motion(&j.a, 0, N_BLOCKS);
      j.a.moved = b;
      c->var.motion(&j.a, 0, 1);
      c->var.motion(&j.a, 1, N_BLOCKS);
      ck_same(c, "moved", a, b, n, 1e-5);
    }
}

static void check_motion_bwd(ck *c) {
  for (size_t i = 0; i < sizeof counts / sizeof *counts; i++)
    for (size_t m = 0; m < sizeof masks / sizeof *masks; m++)
      for (int fill = 0; fill < CK_N_FILLS; fill++) {
        if (!c->is_exact && fill >= CK_DENORM) continue;
        ck_begin(c, "functions %d %d %d mask %04x %s", counts[i][1], counts[i][2], counts[i][3], masks[m],
                 ck_fill_name(fill));
        job j = make_job(c, counts[i], fill);
        size_t n = (size_t)j.n_motion_rows * 16;
        float *a = ck_floats(c, n), *b = ck_floats(c, n);
        c->ref.motion_bwd(&j.a, 1, masks[m], j.grad, a);
        c->var.motion_bwd(&j.a, 1, masks[m], j.grad, b);
        ck_same(c, "gradient", a, b, n, 1e-4);
        for (size_t k = 0; k < n; k++)
          ck_true(c, (masks[m] >> k % 16 & 1) || b[k] == 0.0f, "lane %zu is not touched, but has a gradient",
                  k % 16);
      }
}

static void run_motion(void *arg, const sv_kernels *k) {
  job *j = arg;
  k->motion(&j->a, 0, N_BLOCKS);
}
static void run_motion_bwd(void *arg, const sv_kernels *k) {
  job *j = arg;
  k->motion_bwd(&j->a, 1, 0xffff, j->grad, j->out);
}

static job bench_job(ck *c) {
  static const int n[4] = {23, 6, 3, 3};
  ck_begin(c, "bench");
  job j = make_job(c, n, CK_SIGNED);
  j.a.moved = ck_floats(c, (size_t)N_BLOCKS * (size_t)n[0] * 16);
  j.out = ck_floats(c, (size_t)j.n_motion_rows * 16);
  return j;
}
static void bench_motion(ck *c) {
  job j = bench_job(c);
  ck_time(c, "23 rows, 6 3 3 functions; per Gaussian", 16 * N_BLOCKS, run_motion, &j);
}
static void bench_motion_bwd(ck *c) {
  job j = bench_job(c);
  ck_time(c, "23 rows, 6 3 3 functions; per Gaussian", 16, run_motion_bwd, &j);
}

CK_REGISTER(motion, check_motion, bench_motion)
CK_REGISTER(motion_bwd, check_motion_bwd, bench_motion_bwd)
