// SPDX-License-Identifier: Apache-2.0
#include <math.h>
#include <string.h>

#include "tests/kernels/check.h"

static sv_tv_args make_args(ck *c, const float *x, int w, int h, int stride, sv_tv_form form) {
  sv_tv_args a = {.x = x,
                  .width_px = w,
                  .height_px = h,
                  .stride = stride,
                  .row1 = h,
                  .form = form,
                  .w_v = 0.7f,
                  .w_h = 0.3f};
  a.grad = ck_floats(c, (size_t)(stride * h));
  a.row_v = ck_floats(c, (size_t)h);
  a.row_h = ck_floats(c, (size_t)h);
  a.scratch = ck_floats(c, (size_t)SV_TV_SCRATCH_FLOATS(stride));
  return a;
}

static void one_case(ck *c, int w, int h, int fill, sv_tv_form form) {
  ck_begin(c, "%dx%d %s form %d", w, h, ck_fill_name(fill), (int)form);
  int stride = (w + 31) / 32 * 32;
  size_t n = (size_t)(stride * h), row = sizeof(float) * (size_t)h;
  float *x = ck_bytes_at_end(c, sizeof(float) * n); // the padding stays NaN
  for (int r = 0; r < h; r++) ck_fill(c, x + r * stride, (size_t)w, fill);
  for (int i = 0; i + 1 < w; i += 3) x[i] = x[i + 1]; // differences of exactly 0
  sv_tv_args a = make_args(c, x, w, h, stride, form), b = make_args(c, x, w, h, stride, form);
  ck_fill(c, a.grad, n, CK_SIGNED);
  memcpy(b.grad, a.grad, n * sizeof(float));
  c->ref.tv(&a);
  b.row1 = h / 2;
  c->var.tv(&b);
  b.row0 = h / 2;
  b.row1 = h;
  c->var.tv(&b);
  ck_same(c, "grad", a.grad, b.grad, n, 1e-6);
  ck_same(c, "row_v", a.row_v, b.row_v, (size_t)h, 1e-5);
  ck_same(c, "row_h", a.row_h, b.row_h, (size_t)h, 1e-5);
  sv_tv_args v = make_args(c, x, w, h, stride, form);
  v.grad = NULL;
  c->var.tv(&v);
  ck_same_bytes(c, "row_v without gradient", b.row_v, v.row_v, row);
  ck_same_bytes(c, "row_h without gradient", b.row_h, v.row_h, row);
}

static void check_tv(ck *c) {
  static const int sizes[][2] = {{1, 1},  {1, 5},  {5, 1},  {2, 2},  {15, 3}, {16, 4},
                                 {17, 5}, {31, 2}, {32, 3}, {33, 7}, {65, 6}};
  for (size_t s = 0; s < sizeof sizes / sizeof *sizes; s++)
    for (int fill = 0; fill < CK_N_FILLS; fill++)
      for (int form = 0; form < 2; form++)
        if (c->is_exact || fill < CK_HUGE) one_case(c, sizes[s][0], sizes[s][1], fill, (sv_tv_form)form);
}

static void run(void *arg, const sv_kernels *k) { k->tv(arg); }
static void bench_tv(ck *c) {
  ck_begin(c, "bench");
  float *x = ck_floats(c, 320 * 240);
  ck_fill(c, x, 320 * 240, CK_UNIT);
  sv_tv_args a = make_args(c, x, 320, 240, 320, SV_TV_SQUARED);
  a.w_v = a.w_h = 0; // the gradient is added: keep it finite over thousands of runs
  memset(a.grad, 0, sizeof(float) * 320 * 240);
  ck_time(c, "320x240 squared", 320 * 240, run, &a);
  a.form = SV_TV_ABSOLUTE;
  ck_time(c, "320x240 absolute", 320 * 240, run, &a);
}
CK_REGISTER(tv, check_tv, bench_tv)
