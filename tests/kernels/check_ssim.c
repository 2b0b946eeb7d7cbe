// SPDX-License-Identifier: Apache-2.0
#include <stdio.h>
#include <string.h>

#include "tests/kernels/check.h"

typedef struct {
  int w, h, stride;
  size_t n;
  float *x, *y, *scratch;
} pair;

static pair make_pair(ck *c, int w, int h, int fill) {
  pair p = {.w = w, .h = h, .stride = (w + 31) / 32 * 32};
  p.n = (size_t)p.stride * (size_t)h;
  p.x = ck_bytes_at_end(c, sizeof(float) * p.n);
  p.y = ck_bytes_at_end(c, sizeof(float) * p.n);
  p.scratch = ck_floats(c, (size_t)SV_SSIM_SCRATCH_FLOATS(p.stride));
  for (int r = 0; r < h; r++) { // the padding stays NaN: it must not matter
    ck_fill(c, p.x + r * p.stride, (size_t)w, fill);
    ck_fill(c, p.y + r * p.stride, (size_t)w, fill == CK_FLAT ? CK_UNIT : fill);
  }
  return p;
}

static int windows(const pair *p, int phase) { return (p->h - phase + 1) / 2; }

static sv_ssim_args forward_args(ck *c, const pair *p, int phase, bool has_maps) {
  sv_ssim_args a = {.x = p->x,
                    .y = p->y,
                    .width_px = p->w,
                    .height_px = p->h,
                    .stride = p->stride,
                    .phase = phase,
                    .row1 = windows(p, phase),
                    .scratch = p->scratch};
  const size_t n = (size_t)(a.row1 * p->stride);
  a.row_ssim = ck_floats(c, (size_t)a.row1);
  if (has_maps) {
    a.dm1 = ck_floats(c, n);
    a.ds1 = ck_floats(c, n);
    a.ds12 = ck_floats(c, n);
  }
  return a;
}

static void set_padding(float *plane, const pair *p, float v) {
  for (int r = 0; r < p->h; r++)
    for (int i = p->w; i < p->stride; i++) plane[r * p->stride + i] = v;
}

static double largest(const float *p, size_t n) {
  double m = 0;
  for (size_t i = 0; i < n; i++)
    if (p[i] > m || -p[i] > m) m = p[i] > 0 ? p[i] : -p[i];
  return m;
}

static const int sizes[][2] = {{1, 1},   {2, 3},  {5, 11},  {15, 4},  {16, 16}, {17, 5},
                               {31, 12}, {32, 2}, {33, 10}, {47, 21}, {64, 13}, {70, 9}};
#define N_SIZES ((int)(sizeof sizes / sizeof *sizes))

static void compare_maps(ck *c, const char *name, const float *a, const float *b, const pair *p, int n_rows) {
  for (int r = 0; r < n_rows; r++) // behind the width there may be anything
    ck_same_abs(c, name, a + r * p->stride, b + r * p->stride, (size_t)p->w,
                2e-3 * (1 + largest(a, (size_t)(n_rows * p->stride))));
}

static void forward_case(ck *c, int w, int h, int fill, int phase) {
  ck_begin(c, "%dx%d %s phase %d", w, h, ck_fill_name(fill), phase);
  pair p = make_pair(c, w, h, fill);
  const int n = windows(&p, phase);
  sv_ssim_args a = forward_args(c, &p, phase, true), b = forward_args(c, &p, phase, true),
               v = forward_args(c, &p, phase, false);
  c->ref.ssim(&a);
  b.row1 = n / 2; // in two bands: the banding must not matter
  c->var.ssim(&b);
  b.row0 = n / 2;
  b.row1 = n;
  c->var.ssim(&b);
  c->var.ssim(&v);
  ck_same_abs(c, "row_ssim", a.row_ssim, b.row_ssim, (size_t)n, 1e-4 * (1 + p.w / 16));
  ck_same_bytes(c, "row_ssim without maps", b.row_ssim, v.row_ssim, sizeof(float) * (size_t)n);
  compare_maps(c, "dm1", a.dm1, b.dm1, &p, n);
  compare_maps(c, "ds1", a.ds1, b.ds1, &p, n);
  compare_maps(c, "ds12", a.ds12, b.ds12, &p, n);
}

static void check_ssim(ck *c) {
  for (int s = 0; s < N_SIZES; s++)
    for (int fill = 0; fill < CK_N_FILLS; fill++) {
      if (!c->is_exact && fill >= CK_HUGE) continue; // cancellation: no bound without FMA
      forward_case(c, sizes[s][0], sizes[s][1], fill, 0);
      if (sizes[s][1] > 1) forward_case(c, sizes[s][0], sizes[s][1], fill, 1);
    }
}

static sv_ssim_bwd_args backward_args(ck *c, const pair *p, const sv_ssim_args *f, int mode) {
  sv_ssim_bwd_args a = {.x = p->x,
                        .y = p->y,
                        .width_px = p->w,
                        .height_px = p->h,
                        .stride = p->stride,
                        .row1 = p->h,
                        .w_l1 = 0.3f,
                        .w_ssim = -0.7f,
                        .err_scale = 1.0f / 3,
                        .is_grad_add = mode & 1,
                        .is_err_add = mode >> 1 & 1,
                        .scratch = p->scratch};
  if (f) {
    a.dm1 = f->dm1;
    a.ds1 = f->ds1;
    a.ds12 = f->ds12;
    a.phase = f->phase;
  }
  a.grad = ck_floats(c, p->n);
  a.row_l1 = ck_floats(c, (size_t)p->h);
  if (!(mode & 4)) a.err = ck_floats(c, p->n);
  return a;
}

static void backward_case(ck *c, int w, int h, int fill, int mode, int phase, bool has_ssim) {
  ck_begin(c, "%dx%d %s mode %d phase %d%s", w, h, ck_fill_name(fill), mode, phase,
           has_ssim ? "" : " L1 only");
  pair p = make_pair(c, w, h, fill);
  for (int r = 0; r < h; r += 3)
    for (int i = 0; i < w; i += 5) p.y[r * p.stride + i] = p.x[r * p.stride + i]; // sign(0)
  sv_ssim_args f = forward_args(c, &p, phase, true);
  c->ref.ssim(&f);
  sv_ssim_bwd_args a = backward_args(c, &p, has_ssim ? &f : NULL, mode);
  sv_ssim_bwd_args b = backward_args(c, &p, has_ssim ? &f : NULL, mode);
  if (a.is_grad_add) {
    ck_fill(c, a.grad, p.n, CK_SIGNED);
    set_padding(a.grad, &p, 0);
    memcpy(b.grad, a.grad, sizeof(float) * p.n);
  }
  if (a.err && a.is_err_add) {
    ck_fill(c, a.err, p.n, CK_UNIT);
    set_padding(a.err, &p, 0);
    memcpy(b.err, a.err, sizeof(float) * p.n);
  }
  c->ref.ssim_bwd(&a);
  b.row1 = h / 3;
  c->var.ssim_bwd(&b);
  b.row0 = h / 3;
  b.row1 = h;
  c->var.ssim_bwd(&b);
  ck_same_abs(c, "grad", a.grad, b.grad, p.n, 1e-5 * (1 + largest(a.grad, p.n)));
  ck_same(c, "row_l1", a.row_l1, b.row_l1, (size_t)h, 1e-5);
  if (a.err) ck_same(c, "err", a.err, b.err, p.n, 1e-6);
  sv_ssim_bwd_args v = b; // without a gradient: the same sums
  v.grad = v.err = NULL;
  v.row0 = 0;
  v.row_l1 = ck_floats(c, (size_t)h);
  c->var.ssim_bwd(&v);
  ck_same_bytes(c, "row_l1 without gradient", b.row_l1, v.row_l1, sizeof(float) * (size_t)h);
  for (int r = 0; r < h; r++)
    for (int i = w; i < p.stride; i++)
      ck_true(c, b.grad[r * p.stride + i] == 0 && (!b.err || b.err[r * p.stride + i] == 0),
              "padding of row %d column %d is not 0", r, i);
}

static void check_ssim_bwd(ck *c) {
  for (int s = 0; s < N_SIZES; s++)
    for (int fill = 0; fill < CK_N_FILLS; fill++) {
      if (!c->is_exact && fill >= CK_HUGE) continue;
      for (int mode = 0; mode < 8; mode++)
        backward_case(c, sizes[s][0], sizes[s][1], fill, mode, sizes[s][1] > 1 ? (mode + s) & 1 : 0,
                      mode % 3 != 2);
    }
}

typedef struct {
  sv_ssim_args f;
  sv_ssim_bwd_args b;
} both;

static void run_forward(void *arg, const sv_kernels *k) { k->ssim(&((both *)arg)->f); }
static void run_backward(void *arg, const sv_kernels *k) { k->ssim_bwd(&((both *)arg)->b); }

static both bench_args(ck *c) {
  ck_begin(c, "bench");
  both a;
  pair p = make_pair(c, 320, 240, CK_UNIT);
  a.f = forward_args(c, &p, 0, true);
  a.b = backward_args(c, &p, &a.f, 0);
  c->ref.ssim(&a.f);
  return a;
}

static void bench_ssim(ck *c) {
  both a = bench_args(c);
  ck_time(c, "320x240", 320 * 240, run_forward, &a);
}
static void bench_ssim_bwd(ck *c) {
  both a = bench_args(c);
  ck_time(c, "320x240", 320 * 240, run_backward, &a);
  a.b.dm1 = a.b.ds1 = a.b.ds12 = NULL;
  ck_time(c, "320x240 L1 only", 320 * 240, run_backward, &a);
}

CK_REGISTER(ssim, check_ssim, bench_ssim)
CK_REGISTER(ssim_bwd, check_ssim_bwd, bench_ssim_bwd)
