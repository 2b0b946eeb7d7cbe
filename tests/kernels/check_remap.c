// SPDX-License-Identifier: Apache-2.0
#include <math.h>

#include "tests/kernels/check.h"

static sv_remap_args make_args(ck *c, int w, int h, int dw, int dh, bool has_mask) {
  sv_remap_args a = {.src_width_px = w,
                     .src_height_px = h,
                     .src_stride_bytes = (size_t)(3 * w + 1),
                     .dst_width_px = dw,
                     .dst_stride_bytes = (size_t)(3 * dw + 2),
                     .fill = {7, 99, 255},
                     .row1 = dh};
  size_t bytes = a.src_stride_bytes * (size_t)(h - 1) + (size_t)(3 * w); // ends with the last pixel
  uint8_t *src = ck_bytes_at_end(c, bytes);
  ck_fill_bytes(c, src, bytes);
  sv_remap_tap *t = ck_bytes(c, sizeof *t * (size_t)(dw * dh));
  for (int i = 0; i < dw * dh; i++) {
    bool is_none = sv_rng_below(&c->rng, 9) == 0, is_edge = sv_rng_below(&c->rng, 5) == 0;
    t[i].x = is_none ? SV_REMAP_NONE : (int16_t)(is_edge ? w - 1 : (int)sv_rng_below(&c->rng, (uint32_t)w));
    t[i].y = (int16_t)(is_edge && (i & 1) ? h - 1 : (int)sv_rng_below(&c->rng, (uint32_t)h));
    t[i].fx = (uint8_t)sv_rng_u32(&c->rng);
    t[i].fy = (uint8_t)(i % 7 == 0 ? 255 : sv_rng_u32(&c->rng));
  }
  a.src = src;
  a.table = t;
  a.dst = ck_bytes(c, a.dst_stride_bytes * (size_t)(dh - 1) + (size_t)(3 * dw));
  if (has_mask) a.mask = ck_bytes(c, (size_t)(dw * dh));
  return a;
}

static double tap_value(const sv_remap_args *a, int x, int y, int ch) {
  x = x < a->src_width_px ? x : a->src_width_px - 1;
  y = y < a->src_height_px ? y : a->src_height_px - 1;
  return a->src[(size_t)y * a->src_stride_bytes + (size_t)(3 * x + ch)];
}

static void against_formula(ck *c, const sv_remap_args *a, int dh) {
  for (int i = 0; i < a->dst_width_px * dh; i++) {
    const sv_remap_tap *t = a->table + i;
    const uint8_t *p =
        a->dst + (size_t)(i / a->dst_width_px) * a->dst_stride_bytes + 3 * (i % a->dst_width_px);
    if (a->mask) ck_true(c, a->mask[i] == (t->x == SV_REMAP_NONE ? 0 : 255), "mask of entry %d", i);
    for (int ch = 0; ch < 3; ch++) {
      if (t->x == SV_REMAP_NONE) {
        ck_true(c, p[ch] == a->fill[ch], "fill of entry %d", i);
        continue;
      }
      double fx = t->fx / 256.0, fy = t->fy / 256.0;
      double v =
          (1 - fy) * ((1 - fx) * tap_value(a, t->x, t->y, ch) + fx * tap_value(a, t->x + 1, t->y, ch)) +
          fy * ((1 - fx) * tap_value(a, t->x, t->y + 1, ch) + fx * tap_value(a, t->x + 1, t->y + 1, ch));
      ck_true(c, p[ch] == (int)floor(v + 0.5), "entry %d is %d, must be %.3f", i, p[ch], v);
    }
  }
}

static void check_remap(ck *c) {
  static const int sizes[][2] = {{1, 1}, {2, 2}, {3, 40}, {17, 5}, {64, 48}};
  for (int s = 0; s < 5; s++)
    for (int dw = 1; dw < 40; dw++) {
      int dh = 1 + dw % 3;
      ck_begin(c, "%dx%d to %dx%d", sizes[s][0], sizes[s][1], dw, dh);
      sv_remap_args a = make_args(c, sizes[s][0], sizes[s][1], dw, dh, dw & 1), b = a;
      size_t bytes = a.dst_stride_bytes * (size_t)(dh - 1) + (size_t)(3 * dw);
      b.dst = ck_bytes(c, bytes);
      if (b.mask) b.mask = ck_bytes(c, (size_t)(dw * dh));
      c->ref.remap(&a);
      b.row1 = dh / 2;
      c->var.remap(&b);
      b.row0 = dh / 2;
      b.row1 = dh;
      c->var.remap(&b);
      ck_same_bytes(c, "dst", a.dst, b.dst, bytes);
      if (a.mask) ck_same_bytes(c, "mask", a.mask, b.mask, (size_t)(dw * dh));
      against_formula(c, &b, dh);
    }
}

static void run(void *arg, const sv_kernels *k) { k->remap(arg); }
static void bench_remap(ck *c) {
  ck_begin(c, "bench");
  sv_remap_args a = make_args(c, 640, 480, 640, 480, false);
  sv_remap_tap *t = (sv_remap_tap *)(uintptr_t)a.table; // ours, made above
  for (int i = 0; i < 640 * 480; i++)                   // neighbouring places, as a lens has them
    t[i] = (sv_remap_tap){(int16_t)(i % 640), (int16_t)(i / 640), (uint8_t)(i * 7), (uint8_t)(i * 3)};
  ck_time(c, "640x480", 640 * 480, run, &a);
}
CK_REGISTER(remap, check_remap, bench_remap)
