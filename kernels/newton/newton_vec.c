// SPDX-License-Identifier: Apache-2.0
// `probe`, `curvature` and `newton` on 16 lanes. newton_ref.c is the specification.
#include "kernels/newton/newton.h"
#include "kernels/project/project.h"
#include "kernels/simd/v16.h"

void V(sv_probe)(const sv_probe_args *a) {
  const v16 plus = v16_set1(a->size), minus = v16_neg(plus);
  for (int row = a->row0; row < a->row1; row++) {
    float *out = a->plane + (long)row * a->stride;
    uint32_t bits = 0;
    for (int i = 0; i < a->width_px; i += 16) {
      const int left = a->width_px - i;
      bits = i & 16 ? bits >> 16 : sv_probe_bits((uint32_t)i / 32, (uint32_t)row, a->key);
      v16 s = v16_sel(v16m_from_bits(bits), minus, plus);
      v16_store(out + i, left >= 16 ? s : v16_keep(v16m_from_bits((1u << left) - 1), s));
    }
  }
}

// c after the estimate s, where there was one already and where not.
static inline void curvature_row(v16m on, v16m has, v16 keep, v16 rest, v16 s, uint16_t *c) {
  const v16 d = v16_load_high(c);
  v16_store_high(c, v16_sel(on, v16_sel(has, v16_fma(keep, d, v16_mul(rest, s)), s), d));
}

void V(sv_curvature)(float keep, int n_rows, uint32_t touched, const float *x, const float *products,
                     const sv_curvatures *c) {
  const v16 k = v16_set1(keep), rest = v16_set1(1.0f - keep), z = v16_zero();
  const v16m on = v16m_from_bits(touched), has = v16_gt(v16_load_high(c->diag), z);
  const v16 x0 = v16_load(x), x1 = v16_load(x + 16), x2 = v16_load(x + 32);
  const float *q = products;
  curvature_row(on, has, k, rest, q ? v16_load(q) : v16_mul(x0, x1), c->cross);
  curvature_row(on, has, k, rest, q ? v16_load(q + 16) : v16_mul(x0, x2), c->cross + 16);
  curvature_row(on, has, k, rest, q ? v16_load(q + 32) : v16_mul(x1, x2), c->cross + 32);
  for (int row = 0; row < n_rows; row++) {
    uint16_t *diag = c->diag + 16 * row;
    const v16 s = v16_load(x + 16 * row);
    curvature_row(on, v16_gt(v16_load_high(diag), z), k, rest, q ? s : v16_mul(s, s), diag);
  }
}

// The means of n rows of diag, at most ROWS: that of row i at 4 i. Four at a time, and before all
// steps: alone a sum of lanes waits longer for itself than the rest of a row takes. Not so where a
// vector is four registers: the diagonal would be taken apart twice.
#define ROWS 32
#ifndef V16_UNROLL
static inline void means(int n, const uint16_t *diag, float *out) {
  const v16 sixteenth = v16_set1(1.0f / 16.0f), z = v16_zero();
  int row = 0;
#define PUT(a, b, c, d) v16_store(out + 4 * row, v16_mul(v16_sum4(a, b, c, d), sixteenth))
  for (; row + 4 <= n; row += 4, diag += 64)
    PUT(v16_load_high(diag), v16_load_high(diag + 16), v16_load_high(diag + 32), v16_load_high(diag + 48));
  if (row == n) return;
  v16 a = v16_load_high(diag), b = row + 1 < n ? v16_load_high(diag + 16) : z;
  PUT(a, b, row + 2 < n ? v16_load_high(diag + 32) : z, z);
#undef PUT
}
#define MEAN(i, d) mean[4 * (i)]
#else
#define MEAN(i, d) (v16_sum(d) * (1.0f / 16.0f))
#endif

// The running mean of a row's gradients with this step's.
static inline v16 follow(v16m on, v16 b1, v16 c1, const float *grad, uint16_t *m) {
  const v16 before = v16_load_high(m), after = v16_fma(b1, before, v16_mul(c1, v16_load(grad)));
  v16_store_high(m, v16_sel(on, after, before));
  return after;
}

// solve3 of the reference: g becomes (H + ridge I)^-1 g.
static inline void solve3(const v16 h[3], const uint16_t *cross, v16 ridge, v16 g[3]) {
  const v16 one = v16_set1(1.0f), least = v16_set1(SV_NEWTON_PIVOT_MIN);
  v16 s[3], y[3];
  for (int i = 0; i < 3; i++) {
    s[i] = v16_div(one, v16_sqrt(v16_max(v16_add(h[i], ridge), v16_set1(SV_NEWTON_CURVATURE_MIN))));
    y[i] = v16_mul(g[i], s[i]);
  }
  const v16 xy = v16_mul(v16_load_high(cross), v16_mul(s[0], s[1]));
  const v16 xz = v16_mul(v16_load_high(cross + 16), v16_mul(s[0], s[2]));
  const v16 yz = v16_mul(v16_load_high(cross + 32), v16_mul(s[1], s[2]));
  const v16 d1 = v16_max(v16_fnma(xy, xy, one), least), l21 = v16_div(v16_fnma(xz, xy, yz), d1);
  const v16 d2 = v16_max(v16_fnma(v16_mul(l21, d1), l21, v16_fnma(xz, xz, one)), least);
  y[1] = v16_fnma(xy, y[0], y[1]);
  y[2] = v16_fnma(l21, y[1], v16_fnma(xz, y[0], y[2]));
  y[2] = v16_div(y[2], d2);
  y[1] = v16_fnma(l21, y[2], v16_div(y[1], d1));
  y[0] = v16_fnma(xy, y[1], v16_fnma(xz, y[2], y[0]));
  for (int i = 0; i < 3; i++) g[i] = v16_mul(y[i], s[i]);
}

// size: the longest steps. sum: of the means of the three rows of diag.
static inline void move_means(const sv_newton_args *a, v16m on, const v16 g[3], float sum,
                              const sv_curvatures *c, v16 size, float *p) {
  v16 h[3], s[3];
  for (int i = 0; i < 3; i++) {
    h[i] = v16_load_high(c->diag + 16 * i);
    s[i] = v16_mul(v16_set1(a->rate), g[i]);
  }
  solve3(h, c->cross, v16_set1(a->damping[0] * (sum * (1.0f / 3.0f))), s);
  const v16 length = v16_sqrt(v16_fma(s[0], s[0], v16_fma(s[1], s[1], v16_mul(s[2], s[2]))));
  const v16 shorter = v16_min(v16_div(size, v16_max(length, v16_set1(1e-30f))), v16_set1(1.0f));
  on = v16m_and(on, v16_gt(v16_min(h[0], v16_min(h[1], h[2])), v16_zero()));
  for (int i = 0; i < 3; i++) {
    const v16 p0 = v16_load(p + 16 * i);
    v16_store(p + 16 * i, v16_sel(on, v16_fnma(shorter, s[i], p0), p0));
  }
}

void V(sv_newton)(const sv_newton_args *a, uint32_t touched, const float *grad, const sv_curvatures *c,
                  float *p, uint16_t *m) {
  const v16 b1 = v16_set1(a->beta1), c1 = v16_set1(1.0f - a->beta1), rate = v16_set1(a->rate);
  const v16m on = v16m_from_bits(touched);
  const float *scale = p + 16 * SV_ROW_SCALE;
  v16 size = v16_add(v16_add(v16_load(scale), v16_load(scale + 16)), v16_load(scale + 32));
  size = v16_mul(v16_set1(a->cap_mean), v16_exp2_fine(v16_mul(size, v16_set1(SV_NEWTON_LOG2E_3))));
  for (int row0 = 0; row0 < a->n_rows; row0 += ROWS) {
    const int end = row0 + ROWS < a->n_rows ? row0 + ROWS : a->n_rows;
    int row = row0;
#ifndef V16_UNROLL
    float mean[4 * ROWS];
    means(end - row0, c->diag + 16 * row0, mean);
#endif
    if (row == 0) {
      v16 g[3];
      for (; row < SV_ROW_QUAT; row++) g[row] = follow(on, b1, c1, grad + 16 * row, m + 16 * row);
      move_means(a, on, g,
                 (MEAN(0, v16_load_high(c->diag)) + MEAN(1, v16_load_high(c->diag + 16))) +
                     MEAN(2, v16_load_high(c->diag + 32)),
                 c, size, p);
    }
    for (; row < end; row++) {
      const int at = 16 * row;
      const v16 d = v16_load_high(c->diag + at), p0 = v16_load(p + at), longest = v16_set1(a->cap[row]);
      const v16 m1 = follow(on, b1, c1, grad + at, m + at);
      const v16 more = v16_set1(a->damping[row] * MEAN(row - row0, d));
      v16 step = v16_div(v16_mul(rate, m1), v16_add(d, more));
      step = v16_max(v16_min(step, longest), v16_neg(longest));
      v16_store(p + at, v16_sel(v16m_and(on, v16_gt(d, v16_zero())), v16_sub(p0, step), p0));
    }
  }
}
