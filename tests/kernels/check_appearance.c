// SPDX-License-Identifier: Apache-2.0
#include <string.h>

#include "tests/kernels/check.h"

typedef struct {
  float *x[3], *out[3], *row_sum;
} buffers;

static buffers make(ck *c, int w, int h, int stride, int fill) {
  buffers b;
  const size_t n = (size_t)(stride * h);
  for (int k = 0; k < 3; k++) {
    b.x[k] = ck_bytes_at_end(c, sizeof(float) * n); // the padding stays NaN
    b.out[k] = ck_floats(c, n);
    for (int r = 0; r < h; r++) ck_fill(c, b.x[k] + r * stride, (size_t)w, fill);
    ck_fill(c, b.out[k], n, CK_SIGNED);
  }
  b.row_sum = ck_floats(c, (size_t)(h * SV_APPEARANCE_SUMS));
  return b;
}

static sv_appearance_args args_of(const buffers *b, int w, int h, int stride) {
  return (sv_appearance_args){.m = {0.9f, 0.05f, -0.02f, 0.1f, 1.2f, 0.03f, -0.07f, 0.01f, 0.8f},
                              .b = {0.02f, -0.03f, 0.01f},
                              .k = {-0.3f, 0.1f, -0.05f},
                              .cx = 0.47f * (float)w,
                              .cy = 0.55f * (float)h,
                              .inv_r2 = 4.0f / (float)(w * w + h * h),
                              .x = {b->x[0], b->x[1], b->x[2]},
                              .width_px = w,
                              .stride = stride,
                              .row1 = h,
                              .out = {b->out[0], b->out[1], b->out[2]},
                              .row_sum = b->row_sum};
}

static void one_case(ck *c, int w, int h, int fill) {
  ck_begin(c, "%dx%d %s", w, h, ck_fill_name(fill));
  const int stride = (w + 31) / 32 * 32;
  const size_t n = (size_t)(stride * h);
  buffers a = make(c, w, h, stride, fill), b = a;
  for (int k = 0; k < 3; k++) {
    b.out[k] = ck_floats(c, n);
    memcpy(b.out[k], a.out[k], n * sizeof(float));
  }
  b.row_sum = ck_floats(c, (size_t)(h * SV_APPEARANCE_SUMS));
  sv_appearance_args ra = args_of(&a, w, h, stride), va = args_of(&b, w, h, stride);
  c->ref.appearance_bwd(&ra);
  va.row1 = h / 2;
  c->var.appearance_bwd(&va);
  va.row0 = h / 2;
  va.row1 = h;
  c->var.appearance_bwd(&va);
  for (int k = 0; k < 3; k++) ck_same(c, "dL/dx", a.out[k], b.out[k], n, 1e-6);
  ck_same(c, "row_sum", a.row_sum, b.row_sum, (size_t)(h * SV_APPEARANCE_SUMS), 1e-5);
  va.row0 = 0;
  c->ref.appearance(&ra);
  c->var.appearance(&va);
  for (int k = 0; k < 3; k++) ck_same(c, "out", a.out[k], b.out[k], n, 1e-6);
}

static void check_appearance(ck *c) {
  static const int sizes[][2] = {{1, 1},  {1, 5},  {5, 2},  {15, 3}, {16, 4},
                                 {17, 5}, {31, 2}, {33, 7}, {65, 6}};
  for (size_t s = 0; s < sizeof sizes / sizeof *sizes; s++)
    for (int fill = 0; fill < CK_N_FILLS; fill++)
      if (c->is_exact || fill < CK_HUGE) one_case(c, sizes[s][0], sizes[s][1], fill);
}

static void run(void *arg, const sv_kernels *k) { k->appearance(arg); }
static void run_bwd(void *arg, const sv_kernels *k) { k->appearance_bwd(arg); }
static void bench_appearance(ck *c) {
  ck_begin(c, "bench");
  buffers b = make(c, 320, 240, 320, CK_UNIT);
  sv_appearance_args a = args_of(&b, 320, 240, 320);
  ck_time(c, "320x240", 320 * 240, run, &a);
}
static void bench_appearance_bwd(ck *c) {
  ck_begin(c, "bench");
  buffers b = make(c, 320, 240, 320, CK_UNIT);
  sv_appearance_args a = args_of(&b, 320, 240, 320);
  ck_time(c, "320x240", 320 * 240, run_bwd, &a);
}
CK_REGISTER(appearance, check_appearance, bench_appearance)
CK_REGISTER(appearance_bwd, check_appearance, bench_appearance_bwd)
