// SPDX-License-Identifier: Apache-2.0
#include <math.h>

#include "tests/kernels/check.h"

static const char *const names[SV_N_RGB8] = {"grey", "bgr", "rgbx", "bgrx", "yuyv", "uyvy", "nv12"};
static const int bytes_of[SV_N_RGB8] = {1, 3, 4, 4, 2, 2, 1};

// The standards' formula in double: Y'CbCr of limited or full range.
static void expected(int is_709, int is_full, int y, int u, int v, double rgb[3]) {
  double kr = is_709 ? 0.2126 : 0.299, kb = is_709 ? 0.0722 : 0.114, kg = 1 - kr - kb;
  double l = is_full ? y : (y - 16) * 255.0 / 219.0, s = is_full ? 1.0 : 255.0 / 224.0;
  double cb = s * (u - 128), cr = s * (v - 128);
  rgb[0] = l + 2 * (1 - kr) * cr;
  rgb[2] = l + 2 * (1 - kb) * cb;
  rgb[1] = l - 2 * (1 - kr) * kr / kg * cr - 2 * (1 - kb) * kb / kg * cb;
}

static void against_formula(ck *c, const sv_rgb8_args *a, int is_709, int is_full) {
  for (int y = 0; y < a->row1; y++)
    for (int x = 0; x < a->width_px; x++) {
      const uint8_t *s = a->src + (size_t)y * a->src_stride_bytes, *q = s + x / 2 * 4;
      const uint8_t *p = a->dst + (size_t)y * a->dst_stride_bytes + 3 * x;
      double rgb[3];
      int k = x & 1;
      switch (a->layout) {
      case SV_RGB8_YUYV: expected(is_709, is_full, q[2 * k], q[1], q[3], rgb); break;
      case SV_RGB8_UYVY: expected(is_709, is_full, q[2 * k + 1], q[0], q[2], rgb); break;
      case SV_RGB8_NV12:
        q = a->chroma + (size_t)(y / 2) * a->chroma_stride_bytes + x / 2 * 2;
        expected(is_709, is_full, s[x], q[0], q[1], rgb);
        break;
      default:
        for (int ch = 0; ch < 3; ch++) {
          int from = a->layout == SV_RGB8_RGBX ? ch : a->layout == SV_RGB8_GREY ? 0 : 2 - ch;
          rgb[ch] = s[bytes_of[a->layout] * x + from];
        }
      }
      for (int ch = 0; ch < 3; ch++) {
        double e = rgb[ch] < 0 ? 0 : rgb[ch] > 255 ? 255 : rgb[ch];
        ck_true(c, fabs(e - p[ch]) < 0.52, "(%d,%d) channel %d is %d, must be %.3f", x, y, ch, p[ch], e);
      }
    }
}

static void one_case(ck *c, int layout, int w, int h, int matrix) {
  ck_begin(c, "%s %dx%d matrix %d", names[layout], w, h, matrix);
  size_t row = (size_t)(w * bytes_of[layout]), stride = row + 3, dst_stride = (size_t)(3 * w + 5);
  size_t bytes = stride * (size_t)(h - 1) + row, c_bytes = stride * (size_t)((h + 1) / 2 - 1) + (size_t)w;
  size_t out = dst_stride * (size_t)(h - 1) + (size_t)(3 * w);
  uint8_t *src = ck_bytes_at_end(c, bytes), *chroma = ck_bytes_at_end(c, c_bytes);
  ck_fill_bytes(c, src, bytes);
  ck_fill_bytes(c, chroma, c_bytes);
  sv_rgb8_args a = {.layout = (sv_rgb8_layout)layout,
                    .src = src,
                    .src_stride_bytes = stride,
                    .chroma = layout == SV_RGB8_NV12 ? chroma : NULL,
                    .chroma_stride_bytes = stride,
                    .yuv = sv_rgb8_matrix(matrix & 1, matrix >> 1),
                    .width_px = w,
                    .dst = ck_bytes(c, out),
                    .dst_stride_bytes = dst_stride,
                    .row1 = h};
  sv_rgb8_args b = a;
  b.dst = ck_bytes(c, out);
  c->ref.rgb8(&a);
  b.row1 = h / 2;
  c->var.rgb8(&b);
  b.row0 = h / 2;
  b.row1 = h;
  c->var.rgb8(&b);
  ck_same_bytes(c, "dst", a.dst, b.dst, out);
  against_formula(c, &a, matrix & 1, matrix >> 1);
}

static void check_rgb8(ck *c) {
  for (int layout = 0; layout < SV_N_RGB8; layout++)
    for (int w = 1; w <= 70; w += w < 36 ? 1 : 7)
      if (layout < SV_RGB8_YUYV || w % 2 == 0) one_case(c, layout, w, 3, w / 2 % 4);
}

static void run(void *arg, const sv_kernels *k) { k->rgb8(arg); }
static void bench_rgb8(ck *c) {
  for (int layout = 0; layout < SV_N_RGB8; layout++) {
    char name[40] = "640x480 ";
    size_t stride = (size_t)(640 * bytes_of[layout]);
    ck_begin(c, "bench");
    uint8_t *src = ck_bytes(c, stride * 480 + 640 * 240);
    ck_fill_bytes(c, src, stride * 480 + 640 * 240);
    for (int i = 0; names[layout][i]; i++) name[8 + i] = names[layout][i];
    sv_rgb8_args a = {.layout = (sv_rgb8_layout)layout,
                      .src = src,
                      .src_stride_bytes = stride,
                      .chroma = src + stride * 480,
                      .chroma_stride_bytes = 640,
                      .yuv = sv_rgb8_matrix(0, 0),
                      .width_px = 640,
                      .dst = ck_bytes(c, (size_t)640 * 480 * 3),
                      .dst_stride_bytes = (size_t)640 * 3,
                      .row1 = 480};
    ck_time(c, name, 640 * 480, run, &a);
  }
}
CK_REGISTER(rgb8, check_rgb8, bench_rgb8)
