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

void V(sv_curvature)(float keep, int n_rows, uint32_t touched, const float *x, int is_square,
                     uint16_t *diag) {
  const v16 k = v16_set1(keep), c = v16_set1(1.0f - keep);
  const v16m on = v16m_from_bits(touched);
  for (int row = 0; row < n_rows; row++) {
    v16 s = v16_load(x + 16 * row), d = v16_load_high(diag + 16 * row);
    if (!is_square) s = v16_mul(s, s);
    v16 next = v16_sel(v16_gt(d, v16_zero()), v16_fma(k, d, v16_mul(c, s)), s);
    v16_store_high(diag + 16 * row, v16_sel(on, next, d));
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
#endif

void V(sv_newton)(const sv_newton_args *a, uint32_t touched, const float *grad, const uint16_t *diag,
                  float *p, uint16_t *m) {
  const v16 b1 = v16_set1(a->beta1), c1 = v16_set1(1.0f - a->beta1), rate = v16_set1(a->rate);
  const v16m on = v16m_from_bits(touched);
  const float *cap = a->cap, *damping = a->damping, *scale = p + 16 * SV_ROW_SCALE;
  v16 size = v16_add(v16_add(v16_load(scale), v16_load(scale + 16)), v16_load(scale + 32));
  size = v16_mul(v16_set1(a->cap_mean), v16_exp2_fine(v16_mul(size, v16_set1(SV_NEWTON_LOG2E_3))));
  for (int left = a->n_rows; left > 0; left -= ROWS) {
    const int n = left < ROWS ? left : ROWS;
#ifndef V16_UNROLL
    float mean[4 * ROWS];
    means(n, diag, mean);
#endif
    for (int row = 0; row < n; row++, grad += 16, diag += 16, p += 16, m += 16, cap++, damping++) {
      v16 d = v16_load_high(diag), m0 = v16_load_high(m), p0 = v16_load(p);
      const v16 longest = left == a->n_rows && row < SV_ROW_QUAT ? size : v16_set1(*cap);
      v16 m1 = v16_sel(on, v16_fma(b1, m0, v16_mul(c1, v16_load(grad))), m0);
#ifdef V16_UNROLL
      v16 more = v16_set1(*damping * (v16_sum(d) * (1.0f / 16.0f)));
#else
      v16 more = v16_set1(*damping * mean[4 * row]);
#endif
      v16 step = v16_div(v16_mul(rate, m1), v16_add(d, more));
      step = v16_max(v16_min(step, longest), v16_neg(longest));
      v16_store_high(m, m1);
      v16_store(p, v16_sel(v16m_and(on, v16_gt(d, v16_zero())), v16_sub(p0, step), p0));
    }
  }
}
