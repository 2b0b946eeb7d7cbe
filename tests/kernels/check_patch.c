// SPDX-License-Identifier: Apache-2.0
#include <math.h>
#include <string.h>

#include "tests/kernels/check.h"

#define N_PLACES 40

static void take(ck *c, sv_patch_take_args *a, const sv_kernels *k) {
  a->out = ck_bytes(c, sizeof(sv_patch));
  a->has_slopes = true;
  k->patch_take(a);
}

static float place(ck *c, int n, int i) { // the first two at the borders
  float lo = SV_PATCH_REACH, hi = (float)n - SV_PATCH_REACH - 0.01f;
  return i == 0 ? lo : i == 1 ? hi : lo + (hi - lo) * sv_rng_f(&c->rng);
}

static void check_sums(ck *c) {
  for (int fill = 0; fill < CK_N_FILLS; fill++) {
    if (!c->is_exact && fill >= CK_HUGE) continue;
    // five sums of products of 1e18 overflow, and inf - inf has no order
    if (fill == CK_HUGE) continue;
    const int w = 45, h = 31, stride = 64;
    ck_begin(c, "%s", ck_fill_name(fill));
    float *src = ck_bytes_at_end(c, sizeof(float) * (size_t)(stride * h - (stride - w)));
    for (int r = 0; r < h; r++) ck_fill(c, src + r * stride, (size_t)w, fill);
    float *x = ck_floats(c, N_PLACES), *y = ck_floats(c, N_PLACES);
    float *a = ck_floats(c, 5 * N_PLACES), *b = ck_floats(c, 5 * N_PLACES);
    for (int i = 0; i < N_PLACES; i++) {
      x[i] = place(c, w, i);
      y[i] = place(c, h, i);
    }
    sv_patch_take_args t = {.src = src,
                            .width_px = w,
                            .height_px = h,
                            .stride = stride,
                            .x = 20.3f,
                            .y = 15.7f,
                            .a = {1, 0, 0, 1}};
    take(c, &t, &c->ref);
    sv_patch_sums_args s = {
        .src = src, .stride = stride, .patch = t.out, .x = x, .y = y, .n = N_PLACES, .out = (float(*)[5])a};
    c->ref.patch_sums(&s);
    s.out = (float(*)[5])b;
    c->var.patch_sums(&s);
    ck_same(c, "sums", a, b, 5 * N_PLACES, 1e-4);
  }
}

static float wave(double x, double y) {
  return (float)(0.5 + 0.2 * sin(0.4 * x) * cos(0.3 * y) + 0.1 * sin(0.25 * x + 0.5 * y));
}

// At its own place a patch correlates to 1; a step from beside leads back; A = 2 sees twice as
// much.
static void check_take(ck *c) {
  const int w = 64, h = 48;
  ck_begin(c, "waves");
  float *src = ck_floats(c, (size_t)(w * h));
  for (int y = 0; y < h; y++)
    for (int x = 0; x < w; x++) src[y * w + x] = wave(x + 0.5, y + 0.5);
  sv_patch_take_args t = {
      .src = src, .width_px = w, .height_px = h, .stride = w, .x = 30.25f, .y = 20.5f, .a = {1, 0, 0, 1}};
  take(c, &t, &c->var);
  ck_true(c, t.is_inside, "a patch inside the picture is outside");
  float x[2] = {30.25f, 30.75f}, y[2] = {20.5f, 20.1f}, out[2][5];
  sv_patch_sums_args s = {.src = src, .stride = w, .patch = t.out, .x = x, .y = y, .n = 2, .out = out};
  c->var.patch_sums(&s);
  double pp = 0, hxx = 0, hxy = 0, hyy = 0, px = 0, py = 0;
  for (int i = 0; i < SV_PATCH_PIXELS; i++) {
    double v = t.out->v[0][i], gx = t.out->v[1][i], gy = t.out->v[2][i];
    pp += v * v;
    hxx += gx * gx;
    hxy += gx * gy;
    hyy += gy * gy;
    px += v * gx;
    py += v * gy;
  }
  double zncc = out[0][2] / sqrt((out[0][1] - out[0][0] * out[0][0] / 144.0) * pp);
  ck_true(c, fabs(zncc - 1) < 1e-4, "correlation with itself is %g", zncc);
  double bx = out[1][3] - px, by = out[1][4] - py, det = hxx * hyy - hxy * hxy;
  double dx = (hyy * bx - hxy * by) / det, dy = (hxx * by - hxy * bx) / det;
  ck_true(c, fabs(dx - 0.5) < 0.05 && fabs(dy + 0.4) < 0.05, "a step of (0.5, -0.4) is seen as (%g, %g)", dx,
          dy);
  t.a[0] = t.a[3] = 2.0f;
  t.x = t.y = 24.0f;
  take(c, &t, &c->var);
  double wide = (double)wave(24 + 2 * 5.5, 24 + 2 * 5.5) - (double)wave(24 - 2 * 5.5, 24 - 2 * 5.5);
  double seen = (double)t.out->v[0][143] - (double)t.out->v[0][0];
  ck_true(c, t.is_inside && fabs(seen - wide) < 0.02, "A = 2 sees %g from corner to corner, expected %g",
          seen, wide);
  static const float out_of_it[][2] = {{7.4f, 24}, {24, 7.4f}, {56.6f, 24}, {24, 40.6f}, {NAN, 24}};
  t.a[0] = t.a[3] = 1.0f;
  for (int i = 0; i < 5; i++) {
    t.x = out_of_it[i][0] - (i < 1 ? 1.0f : 0);
    t.y = out_of_it[i][1] - (i == 1 ? 1.0f : 0);
    if (i == 2) t.x += 1;
    if (i == 3) t.y += 1;
    take(c, &t, &c->var);
    ck_true(c, !t.is_inside, "a patch at (%g, %g) counts as inside", (double)t.x, (double)t.y);
  }
}

static void check_compare(ck *c) {
  for (int fill = 0; fill < CK_N_FILLS; fill++) {
    if (fill >= CK_HUGE) continue; // sums of products of 1e18 overflow, and inf - inf has no order
    ck_begin(c, "%s", ck_fill_name(fill));
    sv_patch *p = ck_bytes(c, sizeof *p);
    float *v = ck_floats_odd(c, SV_PATCH_PIXELS);
    ck_fill(c, v, SV_PATCH_PIXELS, fill);
    for (int k = 0; k < 3; k++) ck_fill(c, p->v[k], SV_PATCH_PIXELS, CK_SIGNED);
    sv_patch_compare_args a = {.v = v, .patch = p}, b = a;
    c->ref.patch_compare(&a);
    c->var.patch_compare(&b);
    ck_same(c, "sums", a.out, b.out, 8, 1e-4);
    double sum = 0; // of v p_x j: the last row of pixels has j = 5.5
    for (int s = 0; s < SV_PATCH_PIXELS; s++)
      sum += (double)v[s] * (double)p->v[1][s] * ((s >> 4) / 3 * 4 + (s >> 2 & 3) - 5.5);
    ck_true(c, fabs(sum - (double)b.out[6]) < 1e-3, "sum v p_x j is %g, expected %g", (double)b.out[6], sum);
  }
}

typedef struct {
  sv_patch_sums_args s;
  sv_patch_take_args t;
} bench_arg;
static void run_sums(void *arg, const sv_kernels *k) { k->patch_sums(&((bench_arg *)arg)->s); }
static void run_compare(void *arg, const sv_kernels *k) { k->patch_compare(arg); }
static void run_take(void *arg, const sv_kernels *k) { k->patch_take(&((bench_arg *)arg)->t); }

static bench_arg bench_args(ck *c) {
  static float x[256], y[256], out[256][5];
  float *src = ck_floats(c, 640 * 480);
  ck_fill(c, src, 640 * 480, CK_UNIT);
  for (int i = 0; i < 256; i++) {
    x[i] = place(c, 640, i);
    y[i] = place(c, 480, i);
  }
  bench_arg a = {.t = {.src = src,
                       .width_px = 640,
                       .height_px = 480,
                       .stride = 640,
                       .x = 300.2f,
                       .y = 200.7f,
                       .a = {1, 0, 0, 1}}};
  take(c, &a.t, &c->ref);
  a.s =
      (sv_patch_sums_args){.src = src, .stride = 640, .patch = a.t.out, .x = x, .y = y, .n = 256, .out = out};
  return a;
}
static void bench_sums(ck *c) {
  ck_begin(c, "bench");
  bench_arg a = bench_args(c);
  ck_time(c, "256 places", 256, run_sums, &a);
}
static void bench_take(ck *c) {
  ck_begin(c, "bench");
  bench_arg a = bench_args(c);
  ck_time(c, "one", 1, run_take, &a);
}
static void bench_compare(ck *c) {
  ck_begin(c, "bench");
  bench_arg b = bench_args(c);
  sv_patch_compare_args a = {.v = b.t.out->v[0], .patch = b.t.out};
  ck_time(c, "one", 1, run_compare, &a);
}
CK_REGISTER(patch_compare, check_compare, bench_compare)
CK_REGISTER(patch_take, check_take, bench_take)
CK_REGISTER(patch_sums, check_sums, bench_sums)
