// SPDX-License-Identifier: Apache-2.0
#include "tests/kernels/check.h"

static sv_demosaic_args make_args(ck *c, const uint8_t *src, size_t stride, int w, int h, int phase) {
  size_t dst_stride = (size_t)(3 * w + 1), bytes = dst_stride * (size_t)(h - 1) + (size_t)(3 * w);
  return (sv_demosaic_args){.src = src,
                            .src_stride_bytes = stride,
                            .width_px = w,
                            .height_px = h,
                            .phase = phase,
                            .dst = ck_bytes(c, bytes),
                            .dst_stride_bytes = dst_stride,
                            .row1 = h,
                            .scratch = ck_bytes(c, SV_DEMOSAIC_SCRATCH_BYTES(w))};
}

static void one_case(ck *c, int w, int h, int phase) {
  ck_begin(c, "%dx%d phase %d", w, h, phase);
  size_t stride = (size_t)w + 7, bytes = stride * (size_t)(h - 1) + (size_t)w;
  uint8_t *src = ck_bytes_at_end(c, bytes);
  ck_fill_bytes(c, src, bytes);
  sv_demosaic_args a = make_args(c, src, stride, w, h, phase), b = make_args(c, src, stride, w, h, phase);
  c->ref.demosaic(&a);
  b.row1 = h / 2;
  c->var.demosaic(&b);
  b.row0 = h / 2;
  b.row1 = h;
  c->var.demosaic(&b);
  ck_same_bytes(c, "dst", a.dst, b.dst, a.dst_stride_bytes * (size_t)(h - 1) + (size_t)(3 * w));
}

// A picture that is linear in x and y, the same in all colours, comes back as it was, away from the
// border; and a flat colour comes back everywhere. Both follow from the filters' sums, for each of
// the four patterns.
static void known_pictures(ck *c, int phase) {
  const int w = 37, h = 20, flat[3] = {200, 90, 17};
  ck_begin(c, "known pictures, phase %d", phase);
  uint8_t *ramp = ck_bytes(c, (size_t)(w * h)), *colour = ck_bytes(c, (size_t)(w * h));
  for (int y = 0; y < h; y++)
    for (int x = 0; x < w; x++) {
      int is_red_row = (y & 1) == phase >> 1, is_red_column = (x & 1) == (phase & 1);
      ramp[y * w + x] = (uint8_t)(3 * x + 4 * y + 10);
      colour[y * w + x] = (uint8_t)flat[is_red_row != is_red_column ? 1 : is_red_row ? 0 : 2];
    }
  sv_demosaic_args a = make_args(c, ramp, (size_t)w, w, h, phase),
                   b = make_args(c, colour, (size_t)w, w, h, phase);
  c->var.demosaic(&a);
  c->var.demosaic(&b);
  for (int y = 0; y < h; y++)
    for (int x = 0; x < w; x++)
      for (int ch = 0; ch < 3; ch++) {
        int inside = x >= 2 && y >= 2 && x < w - 2 && y < h - 2;
        int got = a.dst[(size_t)y * a.dst_stride_bytes + (size_t)(3 * x + ch)];
        ck_true(c, !inside || got == ramp[y * w + x], "ramp (%d,%d) channel %d is %d, must be %d", x, y, ch,
                got, ramp[y * w + x]);
        got = b.dst[(size_t)y * b.dst_stride_bytes + (size_t)(3 * x + ch)];
        ck_true(c, got == flat[ch], "colour (%d,%d) channel %d is %d, must be %d", x, y, ch, got, flat[ch]);
      }
}

static void check_demosaic(ck *c) {
  for (int phase = 0; phase < 4; phase++) {
    for (int w = 4; w <= 40; w++) one_case(c, w, 4 + w % 3, phase);
    one_case(c, 64, 33, phase);
    known_pictures(c, phase);
  }
}

static void run(void *arg, const sv_kernels *k) { k->demosaic(arg); }
static void bench_demosaic(ck *c) {
  ck_begin(c, "bench");
  uint8_t *src = ck_bytes(c, 640 * 480);
  ck_fill_bytes(c, src, 640 * 480);
  sv_demosaic_args a = make_args(c, src, 640, 640, 480, 0);
  ck_time(c, "640x480", 640 * 480, run, &a);
}
CK_REGISTER(demosaic, check_demosaic, bench_demosaic)
