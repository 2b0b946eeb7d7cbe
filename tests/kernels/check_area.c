// SPDX-License-Identifier: Apache-2.0
#include <math.h>

#include "tests/kernels/check.h"

// The mean over what pixel (x, y) covers, in doubles.
static double mean_of(const sv_area_args *a, int x, int y, int channel) {
  const double sx = (double)a->src_width_px / a->dst_width_px,
               sy = (double)a->src_height_px / a->dst_height_px;
  double sum = 0;
  for (int i = 0; i < a->src_height_px; i++)
    for (int j = 0; j < a->src_width_px; j++) {
      const double h = fmin(i + 1, (y + 1) * sy) - fmax(i, y * sy),
                   w = fmin(j + 1, (x + 1) * sx) - fmax(j, x * sx);
      if (h > 0 && w > 0) sum += h * w * a->src[(size_t)i * a->src_stride_bytes + (size_t)(3 * j + channel)];
    }
  return sum / (sx * sy);
}

static void check_one(ck *c, int w, int h, int dw, int dh) {
  ck_begin(c, "%dx%d to %dx%d", w, h, dw, dh);
  uint8_t *src = ck_bytes_at_end(c, (size_t)(3 * w * h));
  ck_fill_bytes(c, src, (size_t)(3 * w * h));
  sv_area_args a = {.src = src,
                    .src_stride_bytes = (size_t)(3 * w),
                    .src_width_px = w,
                    .src_height_px = h,
                    .dst_stride_bytes = (size_t)(3 * dw),
                    .dst_width_px = dw,
                    .dst_height_px = dh,
                    .row1 = dh,
                    .scratch = ck_floats(c, SV_AREA_SCRATCH_FLOATS(w))};
  sv_area_args b = a;
  a.dst = ck_bytes(c, (size_t)(3 * dw * dh));
  b.dst = ck_bytes(c, (size_t)(3 * dw * dh));
  c->ref.area(&a);
  b.row1 = dh / 2;
  c->var.area(&b);
  b.row0 = dh / 2;
  b.row1 = dh;
  c->var.area(&b);
  ck_same_bytes(c, "dst", a.dst, b.dst, (size_t)(3 * dw * dh)); // SSE4.1, too
  for (int k = 0; k < 4; k++) {
    const int x = k % 2 ? dw - 1 : 0, y = k / 2 ? dh - 1 : 0, channel = k % 3;
    const double want = mean_of(&a, x, y, channel), got = b.dst[3 * (y * dw + x) + channel];
    ck_true(c, fabs(got - want) < 0.5001, "%d,%d is %g, expected %g", x, y, got, want);
  }
}

static void check_area(ck *c) {
  for (int w = 1; w < 75; w++)
    for (int dw = 1; dw <= w; dw += 1 + w / 7) check_one(c, w, 1 + w % 5, dw, 1 + w % 5 / 2);
  check_one(c, 64, 48, 64, 48); // the same size: the same bytes
  check_one(c, 97, 61, 32, 20);
  check_one(c, 1014, 12, 253, 3);
  check_one(c, 16384, 3, 1, 2);
}

static void run(void *arg, const sv_kernels *k) { k->area(arg); }
static void bench_area(ck *c) {
  ck_begin(c, "bench");
  uint8_t *src = ck_bytes(c, 1280 * 960 * 3);
  ck_fill_bytes(c, src, 1280 * 960 * 3);
  sv_area_args a = {.src = src,
                    .src_stride_bytes = 3840,
                    .src_width_px = 1280,
                    .src_height_px = 960,
                    .dst_stride_bytes = 960,
                    .dst_width_px = 320,
                    .dst_height_px = 240,
                    .row1 = 240,
                    .scratch = ck_floats(c, SV_AREA_SCRATCH_FLOATS(1280))};
  a.dst = ck_bytes(c, 320 * 240 * 3);
  ck_time(c, "1280x960 to 320x240", 1280 * 960, run, &a);
}
CK_REGISTER(area, check_area, bench_area)
