// SPDX-License-Identifier: Apache-2.0
#include <math.h>

#include "tests/kernels/check.h"

// A source of w x h pixels that the map sees turned and enlarged a little; parts of it lie beyond
// the source and, for one transform, behind its camera.
static void check_warp(ck *c, int w, int h, int i_transform) {
  static const float transforms[3][9] = {{1, 0, 0.25f, 0, 1, -0.5f, 0, 0, 1},
                                         {0.9f, 0.2f, -3, -0.15f, 1.1f, 4, 0.001f, -0.002f, 1},
                                         {1, 0, 0, 0, 1, 0, -0.05f, 0, 0.6f}};
  const int stride = 96, n = SV_SWEEP_ROWS * stride;
  ck_begin(c, "%dx%d transform %d", w, h, i_transform);
  uint8_t *px = ck_bytes_at_end(c, (size_t)(2 * w * h));
  ck_fill_bytes(c, px, (size_t)(2 * w * h));
  sv_sweep_warp_args a = {.src = (const uint16_t *)(const void *)px,
                          .width_px = w,
                          .height_px = h,
                          .e = {-2.5f, 0.75f, 0.01f},
                          .x0 = -16 + 7 * i_transform, // need not be a multiple of 16
                          .x1 = 64 + 7 * i_transform,
                          .y0 = -3,
                          .stride = stride};
  for (int i = 0; i < 9; i++) a.h[i] = transforms[i_transform][i];
  sv_sweep_warp_args b = a;
  float *out = ck_floats(c, (size_t)(4 * n));
  for (int i = 0; i < 4 * n; i++) out[i] = -1;
  a.warped = out + 16;
  a.is_in = out + n + 16;
  b.warped = out + 2 * n + 16;
  b.is_in = out + 3 * n + 16;
  c->ref.sweep_warp(&a);
  c->var.sweep_warp(&b);
  ck_same(c, "warped", out, out + 2 * n, (size_t)n, 0); // SSE4.1, too
  ck_same(c, "is_in", out + n, out + 3 * n, (size_t)n, 0);
  if (i_transform > 0) return;
  // shifted by (0.25 - 2.5, -0.5 + 0.75) / 1.01 and scaled by 1 / 1.01
  const float u = (20.5f + 0.25f - 2.5f) / 1.01f - 0.5f, v = (5.5f - 0.5f + 0.75f) / 1.01f - 0.5f;
  if (u > (float)(w - 2) || v > (float)(h - 2)) return;
  const uint16_t *p = a.src + (int)v * w + (int)u;
  const double fx = (double)u - (int)u, fy = (double)v - (int)v;
  const double want =
      ((1 - fy) * ((1 - fx) * p[0] + fx * p[1]) + fy * ((1 - fx) * p[w] + fx * p[w + 1])) / 256;
  const double got = (double)b.warped[8 * stride + 20] + 128;
  ck_true(c, fabs(got - want) < 0.02, "the place is %g, expected %g", got, want);
}

typedef struct {
  float *in, *out;
  int stride, n;
} planes;

static sv_sweep_match_args match_args(const planes *p, float *out, int n_sources, int i_plane) {
  const int n = p->n;
  sv_sweep_match_args a = {.n_sources = n_sources,
                           .ref = p->in + 16,
                           .mean = p->in + 5 * n + 16,
                           .norm = p->in + 6 * n + 16,
                           .best = out,
                           .before = out + n,
                           .after = out + 2 * n,
                           .last = out + 3 * n,
                           .plane = out + 4 * n,
                           .i_plane = i_plane,
                           .x0 = 16,
                           .x1 = p->stride - 48,
                           .stride = p->stride};
  for (int k = 0; k < n_sources; k++) {
    a.warped[k] = p->in + (1 + k) * n + 16;
    a.is_in[k] = p->in + (7 + k) * n + 16;
  }
  return a;
}

// Three planes in turn, as the sweep calls it.
static void check_match(ck *c, int stride, int n_sources, int fill) {
  planes p = {.stride = stride, .n = SV_SWEEP_ROWS * stride};
  const int n = p.n;
  ck_begin(c, "stride %d, %d sources, %s", stride, n_sources, ck_fill_name(fill));
  p.in = ck_floats(c, (size_t)(11 * n));
  p.out = ck_floats(c, (size_t)(10 * n));
  ck_fill(c, p.in, (size_t)(5 * n), fill);
  ck_fill(c, p.in + 5 * n, (size_t)(2 * n), CK_UNIT);
  ck_fill(c, p.in + 7 * n, (size_t)(4 * n), CK_BINARY);
  for (int i = 0; i < 5 * n; i++) p.in[i] *= fill == CK_UNIT || fill == CK_SIGNED ? 100.0f : 1.0f;
  for (int i = 0; i < 10 * n; i++) p.out[i] = SV_SWEEP_NOT_SEEN;
  for (int i = 0; i < 3; i++) {
    sv_sweep_match_args a = match_args(&p, p.out, n_sources, i),
                        b = match_args(&p, p.out + 5 * n, n_sources, i);
    c->ref.sweep_match(&a);
    c->var.sweep_match(&b);
    ck_fill(c, p.in + n, (size_t)n, fill);
  }
  ck_same(c, "best, before, after, last and plane", p.out, p.out + 5 * n, (size_t)(5 * n), 0);
}

// The same picture correlates with itself by 1, and the plane after is the one below it.
static void check_itself(ck *c) {
  planes p = {.stride = 80, .n = SV_SWEEP_ROWS * 80};
  const int n = p.n;
  ck_begin(c, "a picture and itself");
  p.in = ck_floats(c, (size_t)(11 * n));
  p.out = ck_floats(c, (size_t)(5 * n));
  ck_fill(c, p.in, (size_t)n, CK_UNIT);
  for (int i = 0; i < n; i++) {
    p.in[i] *= 100.0f;
    p.in[n + i] = p.in[i];
    p.in[7 * n + i] = 1;
  }
  for (int i = 0; i < 5 * n; i++) p.out[i] = SV_SWEEP_NOT_SEEN;
  sv_sweep_match_args a = match_args(&p, p.out, 1, 5);
  for (int y = 0; y < SV_SWEEP_BAND; y++)
    for (int x = a.x0; x < a.x1; x++) {
      double s1 = 0, s2 = 0;
      for (int i = 0; i < 25; i++) {
        const double v = (double)a.ref[(y + i / 5) * 80 + x + i % 5 - 2];
        s1 += v;
        s2 += v * v;
      }
      p.in[5 * n + 16 + y * 80 + x] = (float)(s1 / 25);
      p.in[6 * n + 16 + y * 80 + x] = (float)(1 / (s2 - s1 * s1 / 25));
    }
  c->var.sweep_match(&a);
  const float *best = a.best + 3 * 80 + 20;
  ck_true(c, fabs((double)*best - (1 - (double)SV_SWEEP_ALONE)) < 1e-3, "correlation with itself: %g",
          (double)*best);
  ck_true(c, a.plane[3 * 80 + 20] == 5, "its plane: %g", (double)a.plane[3 * 80 + 20]);
}

static void check_sweep_warp(ck *c) {
  for (int w = 2; w < 80; w += 1 + w / 3)
    for (int i = 0; i < 3; i++) check_warp(c, w, 2 + w % 31, i);
}

static void check_sweep_match(ck *c) {
  for (int stride = 80; stride <= 144; stride += 16)
    for (int n_sources = 1; n_sources <= SV_SWEEP_CAP_SOURCES; n_sources++)
      for (int fill = 0; fill < CK_N_FILLS; fill++)
        if (fill != CK_HUGE && fill != CK_MIXED) check_match(c, stride, n_sources, fill);
  check_itself(c);
}

static void run_warp(void *arg, const sv_kernels *k) { k->sweep_warp(arg); }
static void run_match(void *arg, const sv_kernels *k) { k->sweep_match(arg); }

static void bench_sweep_warp(ck *c) {
  ck_begin(c, "bench");
  uint8_t *px = ck_bytes(c, 2 * 160 * 120);
  ck_fill_bytes(c, px, 2 * 160 * 120);
  sv_sweep_warp_args a = {.src = (const uint16_t *)(const void *)px,
                          .width_px = 160,
                          .height_px = 120,
                          .h = {1, 0.01f, 0, -0.01f, 1, 0, 0, 0, 1},
                          .e = {4, 0, 0},
                          .x1 = 160,
                          .y0 = 40,
                          .stride = 160,
                          .warped = ck_floats(c, SV_SWEEP_ROWS * 160),
                          .is_in = ck_floats(c, SV_SWEEP_BAND * 160)};
  ck_time(c, "20 rows of 160", SV_SWEEP_ROWS * 160, run_warp, &a);
}

static void bench_sweep_match(ck *c) {
  planes p = {.stride = 160 + 64, .n = SV_SWEEP_ROWS * (160 + 64)};
  ck_begin(c, "bench");
  p.in = ck_floats(c, (size_t)(11 * p.n));
  p.out = ck_floats(c, (size_t)(5 * p.n));
  ck_fill(c, p.in, (size_t)(11 * p.n), CK_UNIT);
  sv_sweep_match_args a = match_args(&p, p.out, 4, 3);
  ck_time(c, "16 rows of 160, 4 sources", SV_SWEEP_BAND * 160 * 4, run_match, &a);
}

CK_REGISTER(sweep_warp, check_sweep_warp, bench_sweep_warp)
CK_REGISTER(sweep_match, check_sweep_match, bench_sweep_match)
