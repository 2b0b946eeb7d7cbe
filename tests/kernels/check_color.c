// SPDX-License-Identifier: Apache-2.0
#include <math.h>
#include <string.h>

#include "tests/kernels/check.h"

typedef void (*curve_fn)(const sv_curve_args *a);

static void curve_cases(ck *c, curve_fn ref, curve_fn var) {
  for (int n = 0; n < 70; n++)
    for (int fill = 0; fill < CK_N_FILLS; fill++) {
      if (!c->is_exact && fill >= CK_HUGE) continue;
      ck_begin(c, "n %d %s", n, ck_fill_name(fill));
      float *src = ck_bytes_at_end(c, sizeof(float) * (size_t)n);
      ck_fill(c, src, (size_t)n, fill);
      sv_curve_args a = {src, ck_floats(c, (size_t)n), ck_floats(c, (size_t)n), n};
      sv_curve_args b = {src, ck_floats_odd(c, (size_t)n), ck_floats(c, (size_t)n), n};
      ref(&a);
      var(&b);
      ck_same(c, "dst", a.dst, b.dst, (size_t)n, 2e-6);
      ck_same(c, "slope", a.slope, b.slope, (size_t)n, 1e-5);
      sv_curve_args in_place = {src, src, NULL, n};
      var(&in_place);
      ck_same_bytes(c, "in place", b.dst, src, sizeof(float) * (size_t)n);
    }
}

// The stated error against double over [0, 1], and the slope.
static void curve_accuracy(ck *c, curve_fn var, double (*f)(double), double (*df)(double)) {
  enum { N = 20001 };
  ck_begin(c, "accuracy");
  float *src = ck_floats(c, N), *dst = ck_floats(c, N), *slope = ck_floats(c, N);
  for (int i = 0; i < N; i++) src[i] = (float)i / (N - 1);
  sv_curve_args a = {src, dst, slope, N};
  var(&a);
  double worst = 0, worst_slope = 0;
  for (int i = 0; i < N; i++) {
    worst = fmax(worst, fabs(dst[i] - f(src[i])));
    worst_slope = fmax(worst_slope, fabs(slope[i] / df(src[i]) - 1));
  }
  ck_true(c, worst < (c->is_exact ? 6e-7 : 2e-6), "worst error %.3g", worst);
  ck_true(c, worst_slope < 5e-6, "worst relative error of the slope %.3g", worst_slope);
}

static double lin(double v) { return v <= (double)0.04045f ? v / 12.92 : pow((v + 0.055) / 1.055, 2.4); }
static double dlin(double v) {
  return v <= (double)0.04045f ? 1 / 12.92 : 2.4 / 1.055 * pow((v + 0.055) / 1.055, 1.4);
}
static double srgb(double l) { return l <= (double)0.0031308f ? 12.92 * l : 1.055 * pow(l, 1 / 2.4) - 0.055; }
static double dsrgb(double l) { return l <= (double)0.0031308f ? 12.92 : 1.055 / 2.4 * pow(l, 1 / 2.4 - 1); }

static void check_to_linear(ck *c) {
  curve_cases(c, c->ref.srgb_to_linear, c->var.srgb_to_linear);
  curve_accuracy(c, c->var.srgb_to_linear, lin, dlin);
}
static void check_to_srgb(ck *c) {
  curve_cases(c, c->ref.linear_to_srgb, c->var.linear_to_srgb);
  curve_accuracy(c, c->var.linear_to_srgb, srgb, dsrgb);
}

static void check_noise_curve(ck *c) {
  static const float noise[][2] = {{1e-6f, 1e-3f}, {1e-4f, 0}, {1e-9f, 0.5f}};
  for (int n = 0; n < 70; n++)
    for (int fill = 0; fill < CK_N_FILLS; fill++) {
      if (!c->is_exact && fill >= CK_HUGE) continue;
      ck_begin(c, "n %d %s", n, ck_fill_name(fill));
      float *src = ck_bytes_at_end(c, sizeof(float) * (size_t)n);
      ck_fill(c, src, (size_t)n, fill);
      sv_noise_curve_args a = {src, ck_floats(c, (size_t)n), ck_floats(c, (size_t)n),
                               n,   noise[n % 3][0],         noise[n % 3][1]};
      sv_noise_curve_args b = a;
      b.dst = ck_floats_odd(c, (size_t)n);
      b.slope = ck_floats(c, (size_t)n);
      c->ref.noise_curve(&a);
      c->var.noise_curve(&b);
      ck_same(c, "dst", a.dst, b.dst, (size_t)n, 2e-6);
      ck_same(c, "slope", a.slope, b.slope, (size_t)n, 1e-5);
    }
  enum { N = 2001 };
  ck_begin(c, "accuracy");
  float *src = ck_floats(c, N), *dst = ck_floats(c, N), *slope = ck_floats(c, N);
  for (int i = 0; i < N; i++) src[i] = (float)i / (N - 1);
  c->var.noise_curve(&(sv_noise_curve_args){src, dst, slope, N, 1e-6f, 1e-3f});
  for (int i = 0; i < N; i++) {
    const double s0 = sqrt(1e-6), s = sqrt(1e-6 + 1e-3 * (double)src[i]), s1 = sqrt(1e-6 + 1e-3);
    ck_true(c, fabs((double)dst[i] - (s - s0) / (s1 - s0)) < 1e-5, "value %d", i);
    ck_true(c, fabs((double)slope[i] / (0.5 * (s1 + s0) / s) - 1) < 1e-5, "slope %d", i);
  }
}

static sv_pack_args pack_args(ck *c, int w, int h, int fill) {
  sv_pack_args a = {.width_px = w, .stride = (w + 31) / 32 * 32, .row1 = h};
  for (int ch = 0; ch < 3; ch++) {
    float *p = ck_floats(c, (size_t)(a.stride * h));
    for (int r = 0; r < h; r++) ck_fill(c, p + r * a.stride, (size_t)w, fill);
    if (w > 2) {
      p[1] = NAN;
      p[2] = 0.5f / 255.0f;
    }
    a.src[ch] = p;
  }
  a.dst_stride_bytes = (size_t)(3 * w) + 2;
  return a;
}

static void check_pack(ck *c) {
  for (int w = 1; w < 70; w++)
    for (int fill = 0; fill < CK_N_FILLS; fill++) {
      int h = 1 + w % 3;
      ck_begin(c, "width %d %s", w, ck_fill_name(fill));
      sv_pack_args a = pack_args(c, w, h, fill), b = a;
      // ends with the last pixel
      size_t bytes = a.dst_stride_bytes * (size_t)(h - 1) + (size_t)(3 * w);
      a.dst = ck_bytes(c, bytes);
      b.dst = ck_bytes(c, bytes);
      c->ref.pack(&a);
      c->var.pack(&b);
      ck_same_bytes(c, "dst", a.dst, b.dst, bytes);
      for (int i = 0; i < w && fill == CK_UNIT; i++) {
        double v = 255.0 * (double)a.src[1][i];
        ck_true(c, isnan(v) ? a.dst[3 * i + 1] == 0 : fabs(a.dst[3 * i + 1] - v) <= 0.50002, "byte %d", i);
      }
    }
}

static void run_lin(void *arg, const sv_kernels *k) { k->srgb_to_linear(arg); }
static void run_srgb(void *arg, const sv_kernels *k) { k->linear_to_srgb(arg); }
static void run_noise(void *arg, const sv_kernels *k) { k->noise_curve(arg); }
static void run_pack(void *arg, const sv_kernels *k) { k->pack(arg); }
static void bench_curve(ck *c, void (*run)(void *arg, const sv_kernels *k)) {
  ck_begin(c, "bench");
  float *src = ck_floats(c, 4096);
  ck_fill(c, src, 4096, CK_UNIT);
  sv_curve_args a = {src, ck_floats(c, 4096), NULL, 4096};
  ck_time(c, "4096", 4096, run, &a);
}
static void bench_to_linear(ck *c) { bench_curve(c, run_lin); }
static void bench_to_srgb(ck *c) { bench_curve(c, run_srgb); }
static void bench_noise_curve(ck *c) {
  ck_begin(c, "bench");
  float *src = ck_floats(c, 4096);
  ck_fill(c, src, 4096, CK_UNIT);
  sv_noise_curve_args a = {src, ck_floats(c, 4096), NULL, 4096, 1e-6f, 1e-3f};
  ck_time(c, "4096", 4096, run_noise, &a);
}
static void bench_pack(ck *c) {
  ck_begin(c, "bench");
  sv_pack_args a = pack_args(c, 320, 240, CK_UNIT);
  a.dst = ck_bytes(c, a.dst_stride_bytes * 240);
  ck_time(c, "320x240", 320 * 240, run_pack, &a);
}
CK_REGISTER(srgb_to_linear, check_to_linear, bench_to_linear)
CK_REGISTER(linear_to_srgb, check_to_srgb, bench_to_srgb)
CK_REGISTER(noise_curve, check_noise_curve, bench_noise_curve)
CK_REGISTER(pack, check_pack, bench_pack)
