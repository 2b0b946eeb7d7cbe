// SPDX-License-Identifier: Apache-2.0
#include "tests/kernels/check.h"

static int pad(int n) { return (n + 31) / 32 * 32; }

static sv_resize_args make_args(ck *c, const float *src, int w, int h, int dw, int dh) {
  sv_resize_args a = {.src = src,
                      .src_width_px = w,
                      .src_height_px = h,
                      .src_stride = pad(w),
                      .dst_width_px = dw,
                      .dst_height_px = dh,
                      .dst_stride = pad(dw),
                      .row1 = dh};
  a.dst = ck_floats(c, (size_t)(pad(dw) * dh));
  a.scratch = ck_floats(c, (size_t)SV_RESIZE_SCRATCH_FLOATS(pad(w)));
  return a;
}

static float *source(ck *c, int w, int h, int fill) {
  float *p = ck_bytes_at_end(c, sizeof(float) * (size_t)(pad(w) * h)); // the padding stays NaN
  for (int r = 0; r < h; r++) ck_fill(c, p + r * pad(w), (size_t)w, fill);
  return p;
}

static void check_resize(ck *c) {
  static const int from[][2] = {{1, 1}, {2, 3}, {16, 5}, {33, 7}, {64, 4}};
  static const int to[][2] = {{1, 1}, {3, 2}, {16, 9}, {17, 5}, {70, 8}, {320, 3}};
  for (int i = 0; i < 5; i++)
    for (int j = 0; j < 6; j++)
      for (int fill = 0; fill < CK_N_FILLS; fill++) {
        if (!c->is_exact && fill >= CK_HUGE) continue;
        int w = from[i][0], h = from[i][1], dw = to[j][0], dh = to[j][1];
        ck_begin(c, "%dx%d to %dx%d %s", w, h, dw, dh, ck_fill_name(fill));
        float *src = source(c, w, h, fill);
        sv_resize_args a = make_args(c, src, w, h, dw, dh), b = make_args(c, src, w, h, dw, dh);
        c->ref.resize(&a);
        b.row1 = dh / 2;
        c->var.resize(&b);
        b.row0 = dh / 2;
        b.row1 = dh;
        c->var.resize(&b);
        ck_same(c, "dst", a.dst, b.dst, (size_t)(pad(dw) * dh), 1e-5);
        for (int k = 0; k < w * h && w == dw && h == dh; k++)
          ck_true(c, a.dst[k / w * pad(w) + k % w] == src[k / w * pad(w) + k % w],
                  "same size is no copy at %d", k);
      }
}

static void check_half(ck *c) {
  for (int w = 2; w < 75; w++)
    for (int fill = 0; fill < CK_N_FILLS; fill++) {
      int h = 2 + w % 5, dw = w / 2, dh = h / 2;
      ck_begin(c, "%dx%d %s", w, h, ck_fill_name(fill));
      float *src = source(c, w, h, fill);
      sv_resize_args a = make_args(c, src, w, h, dw, dh), b = make_args(c, src, w, h, dw, dh);
      c->ref.half(&a);
      c->var.half(&b);
      ck_same_bytes(c, "dst", a.dst, b.dst, sizeof(float) * (size_t)(pad(dw) * dh));
    }
}

static void check_half_bwd(ck *c) {
  for (int w = 1; w < 37; w++)
    for (int fill = 0; fill < CK_N_FILLS; fill++) {
      int h = 1 + w % 5;
      size_t n = (size_t)(pad(2 * w) * 2 * h);
      ck_begin(c, "%dx%d %s", w, h, ck_fill_name(fill));
      sv_half_bwd_args a = {.grad = source(c, w, h, fill),
                            .width_px = w,
                            .stride = pad(w),
                            .src_stride = pad(2 * w),
                            .row1 = h},
                       b = a;
      a.src_grad = ck_floats(c, n);
      b.src_grad = ck_floats(c, n);
      c->ref.half_bwd(&a);
      b.row1 = h / 2;
      c->var.half_bwd(&b);
      b.row0 = h / 2;
      b.row1 = h;
      c->var.half_bwd(&b);
      ck_same_bytes(c, "gradient", a.src_grad, b.src_grad, sizeof(float) * n);
      // The mean of what it spreads is a quarter of what it was given; a quarter of a power of two
      // is exact.
      sv_resize_args back = make_args(c, a.src_grad, 2 * w, 2 * h, w, h);
      c->ref.half(&back);
      for (int k = 0; k < w * h && fill == CK_UNIT; k++)
        ck_true(c, back.dst[k / w * pad(w) + k % w] == 0.25f * a.grad[k / w * pad(w) + k % w],
                "pixel %d did not get all of its gradient", k);
    }
}

static void run_resize(void *arg, const sv_kernels *k) { k->resize(arg); }
static void run_half(void *arg, const sv_kernels *k) { k->half(arg); }
static void run_half_bwd(void *arg, const sv_kernels *k) { k->half_bwd(arg); }
static void bench_resize(ck *c) {
  ck_begin(c, "bench");
  float *src = source(c, 320, 240, CK_UNIT);
  sv_resize_args a = make_args(c, src, 320, 240, 480, 360), b = make_args(c, src, 320, 240, 200, 150);
  ck_time(c, "320x240 to 480x360", 480 * 360, run_resize, &a);
  ck_time(c, "320x240 to 200x150", 200 * 150, run_resize, &b);
}
static void bench_half(ck *c) {
  ck_begin(c, "bench");
  float *src = source(c, 640, 480, CK_UNIT);
  sv_resize_args a = make_args(c, src, 640, 480, 320, 240);
  ck_time(c, "640x480", 640 * 480, run_half, &a);
}
CK_REGISTER(resize, check_resize, bench_resize)
static void bench_half_bwd(ck *c) {
  ck_begin(c, "bench");
  sv_half_bwd_args a = {.grad = source(c, 320, 240, CK_UNIT),
                        .width_px = 320,
                        .stride = 320,
                        .src_grad = ck_floats(c, 640 * 480),
                        .src_stride = 640,
                        .row1 = 240};
  ck_time(c, "640x480", 640 * 480, run_half_bwd, &a);
}
CK_REGISTER(half, check_half, bench_half)
CK_REGISTER(half_bwd, check_half_bwd, bench_half_bwd)
