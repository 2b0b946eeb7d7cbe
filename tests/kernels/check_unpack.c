// SPDX-License-Identifier: Apache-2.0
#include <math.h>

#include "tests/kernels/check.h"

typedef struct {
  sv_unpack_args a;
} run_arg;

static sv_unpack_args make_args(ck *c, const uint8_t *src, int w, int h, int nc, int k, size_t stride) {
  sv_unpack_args a = {.src = src,
                      .src_stride_bytes = stride,
                      .n_channels = nc,
                      .width_px = w,
                      .height_px = h,
                      .k = k,
                      .bg = {0.1f, 0.5f, 1.0f},
                      .dst_stride = (w / k + 31) / 32 * 32,
                      .row1 = h / k};
  for (int i = 0; i < 3; i++) a.dst[i] = ck_floats(c, (size_t)(h / k) * (size_t)a.dst_stride);
  a.scratch = ck_floats(c, (size_t)SV_UNPACK_SCRATCH_FLOATS(w));
  return a;
}

// The formula in double, straight from the contract.
static double expected(const sv_unpack_args *a, int ch, int x, int y) {
  double colour = 0, alpha = 0, n = a->k * a->k;
  for (int j = 0; j < a->k; j++)
    for (int i = 0; i < a->k; i++) {
      const uint8_t *p =
          a->src + (size_t)(y * a->k + j) * a->src_stride_bytes + (x * a->k + i) * a->n_channels;
      double al = a->n_channels == 4 ? p[3] / 255.0 : 1;
      colour += p[ch] / 255.0 * al / n;
      alpha += al / n;
    }
  return colour + (1 - alpha) * (double)a->bg[ch];
}

static void one_case(ck *c, int w, int h, int nc, int k) {
  ck_begin(c, "%dx%d channels %d k %d", w, h, nc, k);
  size_t row = (size_t)(w * nc), stride = row + 5,
         bytes = stride * (size_t)(h - 1) + row; // ends with the last pixel
  uint8_t *src = ck_bytes_at_end(c, bytes);
  ck_fill_bytes(c, src, bytes);
  sv_unpack_args a = make_args(c, src, w, h, nc, k, stride), b = make_args(c, src, w, h, nc, k, stride);
  c->ref.unpack(&a);
  b.row1 = h / k / 2;
  c->var.unpack(&b);
  b.row0 = b.row1;
  b.row1 = h / k;
  c->var.unpack(&b);
  for (int ch = 0; ch < 3; ch++) {
    ck_same(c, "dst", a.dst[ch], b.dst[ch], (size_t)(h / k) * (size_t)a.dst_stride, 1e-6);
    for (int y = 0; y < h / k; y++)
      for (int x = 0; x < w / k; x++) {
        double e = expected(&a, ch, x, y), g = a.dst[ch][y * a.dst_stride + x];
        ck_true(c, fabs(e - g) < 3e-7, "formula: channel %d (%d,%d) is %.9g, must be %.9g", ch, x, y, g, e);
      }
  }
}

static void check_unpack(ck *c) {
  for (int k = 1; k <= SV_UNPACK_CAP_K; k++)
    for (int nc = 3; nc <= 4; nc++) {
      for (int n = 1; n <= 35; n += k > 2 ? 7 : 1) one_case(c, n * k + (n % k), 2 * k + 1, nc, k);
      one_case(c, 16 * k, 3 * k, nc, k);
      one_case(c, 64 * k + k - 1, k, nc, k);
    }
}

static void check_unpack16(ck *c) {
  for (int k = 1; k <= SV_UNPACK_CAP_K; k++)
    for (int n = 1; n <= 35; n += 7) {
      const int w = n * k + n % k, h = 2 * k + 1, stride = (n + 31) / 32 * 32;
      ck_begin(c, "%dx%d k %d", w, h, k);
      sv_unpack16_args a = {
          .width_px = w, .height_px = h, .k = k, .scale = 0.5f, .dst_stride = stride, .row1 = h / k};
      for (int i = 0; i < 3; i++) {
        uint16_t *src = ck_bytes_at_end(c, 2 * (size_t)(w * h));
        ck_fill_bytes(c, src, 2 * (size_t)(w * h));
        a.src[i] = src;
        a.dst[i] = ck_floats(c, (size_t)(stride * (h / k)));
      }
      c->var.unpack16(&a);
      for (int i = 0; i < 3; i++)
        for (int y = 0; y < h / k; y++)
          for (int x = 0; x < stride; x++) {
            double sum = 0;
            for (int j = 0; j < k * k && x < n; j++)
              sum += a.src[i][(y * k + j / k) * w + x * k + j % k] / (65535.0 * k * k);
            ck_true(c, fabs(0.5 * sum - (double)a.dst[i][y * stride + x]) < 2e-7, "value (%d,%d)", x, y);
          }
    }
}

static void run16(void *arg, const sv_kernels *k) { k->unpack16(arg); }
static void bench_unpack16(ck *c) {
  ck_begin(c, "bench");
  sv_unpack16_args a = {
      .width_px = 640, .height_px = 480, .k = 1, .scale = 1, .dst_stride = 640, .row1 = 480};
  for (int i = 0; i < 3; i++) {
    uint16_t *src = ck_bytes(c, 2 * 640 * 480);
    ck_fill_bytes(c, src, 2 * 640 * 480);
    a.src[i] = src;
    a.dst[i] = ck_floats(c, 640 * 480);
  }
  ck_time(c, "640x480 k1", 640 * 480, run16, &a);
}

static void run(void *arg, const sv_kernels *k) { k->unpack(&((run_arg *)arg)->a); }
static void bench_unpack(ck *c) {
  static const struct {
    int k, nc;
    const char *name;
  } t[] = {{1, 3, "640x480 RGB k1"}, {2, 3, "640x480 RGB k2"},  {4, 3, "640x480 RGB k4"},
           {3, 3, "640x480 RGB k3"}, {1, 4, "640x480 RGBA k1"}, {2, 4, "640x480 RGBA k2"}};
  for (int i = 0; i < 6; i++) {
    ck_begin(c, "bench");
    size_t stride = (size_t)(640 * t[i].nc);
    uint8_t *src = ck_bytes(c, stride * 480);
    ck_fill_bytes(c, src, stride * 480);
    run_arg r = {make_args(c, src, 640, 480, t[i].nc, t[i].k, stride)};
    ck_time(c, t[i].name, 640 * 480, run, &r);
  }
}
CK_REGISTER(unpack, check_unpack, bench_unpack)
CK_REGISTER(unpack16, check_unpack16, bench_unpack16)
