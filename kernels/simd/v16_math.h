// SPDX-License-Identifier: Apache-2.0
// Not alone: it is a part of each v16_*.h. exp2 and log2 over the vocabulary; included by each
// v16_*.h. The scalar twins are in s1_math.h: same operations in the same order.
#ifndef SV_V16_MATH_H
#define SV_V16_MATH_H

// Where a vector is four registers the compiler would call these: the caller's registers then go to
// the stack and back in every inner loop, and one chain of operations waits where others could run
// beside it.
#define V16_INLINE static inline __attribute__((always_inline))

// Rounded to the nearest number of 16 bits, of two the one farther from 0.
#ifndef V16_HAS_STORE_HIGH
V16_INLINE void v16_store_high(uint16_t *p, v16 a) {
  v16i_store_high(p, v16i_add(v16_bits(a), v16i_set1(0x8000)));
}
#endif

// x minus the whole number nearest to it, of two the even one; |x| < 2^22.
#ifndef V16_HAS_REST
V16_INLINE v16 v16_rest(v16 x) {
  const v16 magic = v16_set1(12582912.0f);
  return v16_sub(x, v16_sub(v16_add(x, magic), magic));
}
#endif

// Of v16_exp2_up8, degree 4 first.
#define V16_EXP2_UP8_TERMS                                                                                   \
  { 256 * 0.0135557475f, 256 * 0.0520323701f, 256 * 0.241379768f, 256 * 0.693032146f, 256.0f }
// 2^(8 + x) for x in [-126, -0.5], relative error 3.4e-6: x less its floor is exact there, degree 4
// on [0, 1), 1 and 2 at its ends. Elsewhere the result means nothing: mask it. Forward and backward
// rasterization use this one. terms: those, for callers who know better than compilers where they
// should lie.
V16_INLINE v16 v16_exp2_up8_by(v16 x, const float *terms) {
#ifdef V16_HAS_SCALE
  v16 f = v16_above_floor(x);
#else
  v16 n = v16_floor(x), f = v16_sub(x, n);
#endif
  v16 p = v16_set1(terms[0]);
  p = v16_fma(p, f, v16_set1(terms[1]));
  p = v16_fma(p, f, v16_set1(terms[2]));
  p = v16_fma(p, f, v16_set1(terms[3]));
  p = v16_fma(p, f, v16_set1(terms[4]));
#ifdef V16_HAS_SCALE
  return v16_scale(p, x);
#else
  return v16_from_bits(v16i_add(v16_bits(p), v16i_shl23(v16_trunc_i(n))));
#endif
}
V16_INLINE v16 v16_exp2_up8(v16 x) {
  static const float terms[5] = V16_EXP2_UP8_TERMS;
  return v16_exp2_up8_by(x, terms);
}

// p 2^floor(x), p and the result normal numbers.
V16_INLINE v16 v16_pow2_floor(v16 p, v16 x) {
#ifdef V16_HAS_SCALE
  return v16_scale(p, x);
#else
  return v16_from_bits(v16i_add(v16_bits(p), v16i_shl23(v16_trunc_i(v16_floor(x)))));
#endif
}
#ifndef V16_HAS_SHL_BY
V16_INLINE v16i v16i_shl_by(v16i a, v16 n) { return v16_trunc_i(v16_pow2_floor(v16i_to_f(a), n)); }
#endif

// 2^x, degree 6 on [-0.5, 0.5], relative error 2.2e-7; x is clamped to [-126, 126]. For parameters.
V16_INLINE v16 v16_exp2_fine(v16 x) {
  const v16 magic = v16_set1(12582912.0f);
  x = v16_min(v16_max(x, v16_set1(-126.0f)), v16_set1(126.0f));
  v16 t = v16_add(x, magic), f = v16_rest(x);
  v16 p = v16_set1(1.5403530e-4f);
  p = v16_fma(p, f, v16_set1(1.3333558e-3f));
  p = v16_fma(p, f, v16_set1(9.6181291e-3f));
  p = v16_fma(p, f, v16_set1(5.5504109e-2f));
  p = v16_fma(p, f, v16_set1(2.4022651e-1f));
  p = v16_fma(p, f, v16_set1(6.9314718e-1f));
  p = v16_fma(p, f, v16_set1(1.0f));
  return v16_from_bits(v16i_add(v16_bits(p), v16i_shl23(v16_bits(t))));
}

// log2 of a positive normal number, absolute error 2e-7 (relative 3e-7 away from 1): exponent plus
// the atanh series of the mantissa in [sqrt(1/2), sqrt(2)).
V16_INLINE v16 v16_log2(v16 x) {
  // so that the split is at sqrt(1/2)
  v16i b = v16i_add(v16_bits(x), v16i_set1(0x3f800000 - 0x3f3504f3));
  v16 e = v16_sub(v16i_to_f(v16i_shr23(b)), v16_set1(127.0f));
  v16 m = v16_from_bits(v16i_add(v16i_and(b, v16i_set1(0x007fffff)), v16i_set1(0x3f3504f3)));
  v16 s = v16_div(v16_sub(m, v16_set1(1.0f)), v16_add(m, v16_set1(1.0f)));
  v16 z = v16_mul(s, s);
  v16 p = v16_set1(0.41219858f); // (2/ln 2) / 7
  p = v16_fma(p, z, v16_set1(0.57707802f));
  p = v16_fma(p, z, v16_set1(0.96179669f));
  p = v16_fma(p, z, v16_set1(2.88539008f));
  return v16_fma(p, s, e);
}

#ifndef V16_HAS_4X16
#define V16_HAS_4X16 0
#endif

#ifndef V16_HAS_TRANSPOSE64
#define V16_HAS_TRANSPOSE64 0
#endif

// Lane k = sum of a[k], as v16_sum16; lanes 11 to 15 are 0. Another of nine vectors.
#ifndef V16_HAS_SUM11
#define V16_HAS_SUM11 0 // it is no faster than that
V16_INLINE v16 v16_sum11(const v16 a[11]) {
  v16 z = v16_zero();
  v16 all[16] = {a[0], a[1], a[2], a[3], a[4], a[5], a[6], a[7], a[8], a[9], a[10], z, z, z, z, z};
  return v16_sum16(all);
}
V16_INLINE v16 v16_sum9(const v16 a[9]) { // lanes 9 to 15 are 0
  v16 z = v16_zero();
  v16 all[11] = {a[0], a[1], a[2], a[3], a[4], a[5], a[6], a[7], a[8], z, z};
  return v16_sum11(all);
}
#endif

#endif
