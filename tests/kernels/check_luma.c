// SPDX-License-Identifier: Apache-2.0
#include <math.h>

#include "tests/kernels/check.h"

static void check_luma(ck *c) {
  for (int w = 1; w < 75; w++) {
    int h = 1 + w % 3, stride = (w + 31) / 32 * 32;
    ck_begin(c, "%dx%d", w, h);
    uint8_t *src = ck_bytes_at_end(c, (size_t)(3 * w * h));
    ck_fill_bytes(c, src, (size_t)(3 * w * h));
    sv_luma_args a = {
        .src = src, .src_stride_bytes = (size_t)(3 * w), .width_px = w, .dst_stride = stride, .row1 = h};
    sv_luma_args b = a;
    a.dst = ck_floats(c, (size_t)(stride * h));
    b.dst = ck_floats(c, (size_t)(stride * h));
    c->ref.luma(&a);
    b.row1 = h / 2;
    c->var.luma(&b);
    b.row0 = h / 2;
    b.row1 = h;
    c->var.luma(&b);
    ck_same_bytes(c, "dst", a.dst, b.dst, sizeof(float) * (size_t)(stride * h));
    const uint8_t *p = src + 3 * (w - 1);
    double y = (77.0 * p[0] + 150.0 * p[1] + 29.0 * p[2]) / 65280.0;
    ck_true(c, fabs(b.dst[w - 1] - y) < 1e-7, "grey is %g, expected %g", (double)b.dst[w - 1], y);
  }
}

static void run(void *arg, const sv_kernels *k) { k->luma(arg); }
static void bench_luma(ck *c) {
  ck_begin(c, "bench");
  uint8_t *src = ck_bytes(c, 640 * 480 * 3);
  ck_fill_bytes(c, src, 640 * 480 * 3);
  sv_luma_args a = {.src = src, .src_stride_bytes = 1920, .width_px = 640, .dst_stride = 640, .row1 = 480};
  a.dst = ck_floats(c, 640 * 480);
  ck_time(c, "640x480", 640 * 480, run, &a);
}
CK_REGISTER(luma, check_luma, bench_luma)
