// SPDX-License-Identifier: Apache-2.0
// The 16-lane vector vocabulary in plain C: the meaning of every word. The other v16_*.h say the
// same in intrinsics and give the same bits (SSE4.1 has no fused multiply-add: v16_fma rounds twice
// there).
//
// Lane order: in images a vector is a 4x4 block of pixels, lane = 4 * (y mod 4) + (x mod 4); in
// Gaussian data it is 16 consecutive Gaussians. Sums over lanes always use one tree: i with i+8,
// then +4, +2, +1. Masks are opaque (v16m). min/max return the second operand when either is NaN.
#ifndef SV_V16_REF_H
#define SV_V16_REF_H
#include <math.h>
#include <stdint.h>
#include <string.h>

#include "kernels/simd/s1_math.h"

#define V16_PARTS     2 // machine registers that a vector takes
#define V16_REGISTERS 8 // vectors that the register file holds

typedef struct {
  float l[16];
} v16;
typedef struct {
  int32_t l[16];
} v16i;
typedef uint32_t v16m; // bit k = lane k

#define V16_EACH(expr)                                                                                       \
  v16 r;                                                                                                     \
  for (int k = 0; k < 16; k++) r.l[k] = (expr);                                                              \
  return r
#define V16M_EACH(expr)                                                                                      \
  v16m r = 0;                                                                                                \
  for (int k = 0; k < 16; k++) r |= (uint32_t)((expr) ? 1 : 0) << k;                                         \
  return r
#define V16I_EACH(expr)                                                                                      \
  v16i r;                                                                                                    \
  for (int k = 0; k < 16; k++) r.l[k] = (int32_t)(expr);                                                     \
  return r

static inline v16 v16_set1(float x) { V16_EACH(x); }
static inline v16 v16_zero(void) { V16_EACH(0.0f); }
static inline v16 v16_iota(void) { V16_EACH((float)k); }
static inline v16 v16_load(const float *p) { V16_EACH(p[k]); } // any alignment
static inline void v16_store(float *p, v16 a) { memcpy(p, a.l, 64); }
static inline v16 v16_load4x4(const float *p, long stride) { V16_EACH(p[(k >> 2) * stride + (k & 3)]); }
// Four floats, any alignment, four times.
static inline v16 v16_load_quad(const float *p) { V16_EACH(p[k & 3]); }
// Group i of four lanes from p_i[0..3].
static inline v16 v16_load_quads(const float *p0, const float *p1, const float *p2, const float *p3) {
  const float *p[4] = {p0, p1, p2, p3};
  V16_EACH(p[k >> 2][k & 3]);
}
// v16_dup4_i: lane i of each group of four, in all four.
#define V16_DUP4(i)                                                                                          \
  static inline v16 v16_dup4_##i(v16 a) { V16_EACH(a.l[(k & 12) + i]); }
V16_DUP4(0)
V16_DUP4(1)
V16_DUP4(2)
V16_DUP4(3)
#undef V16_DUP4
static inline void v16_store4x4(float *p, long stride, v16 a) {
  for (int k = 0; k < 16; k++) p[(k >> 2) * stride + (k & 3)] = a.l[k];
}
static inline v16 v16_load_u8(const uint8_t *p) { V16_EACH((float)p[k]); }
static inline void v16_store_u8(uint8_t *p, v16 a) { // clamped to 0..255, rounded to nearest even
  for (int k = 0; k < 16; k++) {
    float c = a.l[k] > 0.0f ? a.l[k] : 0.0f;
    c = c < 255.0f ? c : 255.0f;
    p[k] = (uint8_t)((c + 12582912.0f) - 12582912.0f);
  }
}
static inline v16 v16_add(v16 a, v16 b) { V16_EACH(a.l[k] + b.l[k]); }
static inline v16 v16_sub(v16 a, v16 b) { V16_EACH(a.l[k] - b.l[k]); }
static inline v16 v16_mul(v16 a, v16 b) { V16_EACH(a.l[k] * b.l[k]); }
static inline v16 v16_div(v16 a, v16 b) { V16_EACH(a.l[k] / b.l[k]); }
// a b + c
static inline v16 v16_fma(v16 a, v16 b, v16 c) { V16_EACH(fmaf(a.l[k], b.l[k], c.l[k])); }
// c - a b
static inline v16 v16_fnma(v16 a, v16 b, v16 c) { V16_EACH(fmaf(-a.l[k], b.l[k], c.l[k])); }
// a b - c
static inline v16 v16_fms(v16 a, v16 b, v16 c) { V16_EACH(fmaf(a.l[k], b.l[k], -c.l[k])); }
// -a b - c
static inline v16 v16_fnms(v16 a, v16 b, v16 c) { V16_EACH(fmaf(-a.l[k], b.l[k], -c.l[k])); }
static inline v16 v16_min(v16 a, v16 b) { V16_EACH(a.l[k] < b.l[k] ? a.l[k] : b.l[k]); }
static inline v16 v16_max(v16 a, v16 b) { V16_EACH(a.l[k] > b.l[k] ? a.l[k] : b.l[k]); }
static inline v16 v16_sqrt(v16 a) { V16_EACH(sqrtf(a.l[k])); }
static inline v16 v16_floor(v16 a) { V16_EACH(floorf(a.l[k])); }
static inline v16 v16_abs(v16 a) { V16_EACH(fabsf(a.l[k])); }
static inline v16 v16_neg(v16 a) { V16_EACH(-a.l[k]); }
static inline v16m v16_lt(v16 a, v16 b) { V16M_EACH(a.l[k] < b.l[k]); }
static inline v16m v16_le(v16 a, v16 b) { V16M_EACH(a.l[k] <= b.l[k]); }
static inline v16m v16_gt(v16 a, v16 b) { V16M_EACH(a.l[k] > b.l[k]); }
static inline v16m v16_ge(v16 a, v16 b) { V16M_EACH(a.l[k] >= b.l[k]); }
static inline v16m v16m_and(v16m a, v16m b) { return a & b; }
static inline v16m v16m_or(v16m a, v16m b) { return a | b; }
static inline v16m v16m_andnot(v16m a, v16m b) { return a & ~b; }
static inline uint32_t v16m_bits(v16m a) { return a; } // bit k = lane k
static inline int v16m_all(v16m a) { return a == 0xffffu; }
static inline v16m v16m_from_bits(uint32_t b) { return b & 0xffffu; }
static inline v16 v16_sel(v16m m, v16 a, v16 b) { V16_EACH((m >> k & 1) ? a.l[k] : b.l[k]); }
static inline v16 v16_keep(v16m m, v16 a) { V16_EACH((m >> k & 1) ? a.l[k] : 0.0f); }
// -|a| in the lanes of m, a in the others.
static inline v16i v16i_set1(int32_t x) { V16I_EACH(x); }
static inline v16i v16_bits(v16 a) {
  v16i r;
  memcpy(&r, &a, 64);
  return r;
}
static inline v16 v16_from_bits(v16i a) {
  v16 r;
  memcpy(&r, &a, 64);
  return r;
}
static inline v16i v16i_add(v16i a, v16i b) { V16I_EACH((uint32_t)a.l[k] + (uint32_t)b.l[k]); }
static inline v16i v16i_and(v16i a, v16i b) { V16I_EACH(a.l[k] & b.l[k]); }
static inline v16i v16i_andnot(v16i a, v16i b) { V16I_EACH(a.l[k] & ~b.l[k]); }
static inline v16i v16i_or(v16i a, v16i b) { V16I_EACH(a.l[k] | b.l[k]); }
static inline v16i v16i_shl8(v16i a) { V16I_EACH((uint32_t)a.l[k] << 8); }
static inline v16i v16i_shr8(v16i a) { V16I_EACH((uint32_t)a.l[k] >> 8); } // zeros come in
static inline v16i v16i_shl16(v16i a) { V16I_EACH((uint32_t)a.l[k] << 16); }
static inline v16i v16i_shl23(v16i a) { V16I_EACH((uint32_t)a.l[k] << 23); }
static inline v16i v16i_shr23(v16i a) { V16I_EACH((uint32_t)a.l[k] >> 23); }
// a 2^n, n cut to a whole number, of a small a and 0 <= n < 30; beyond that anything.
#define V16_HAS_SHL_BY 1
static inline v16i v16i_shl_by(v16i a, v16 n) { V16I_EACH((uint32_t)a.l[k] << ((int32_t)n.l[k] & 31)); }
static inline v16 v16i_to_f(v16i a) { V16_EACH((float)a.l[k]); }
static inline v16i v16_trunc_i(v16 a) { V16I_EACH(a.l[k]); } // towards zero; |a| < 2^31
static inline void v16i_store(int32_t *p, v16i a) { memcpy(p, a.l, 64); }
// Numbers of 16 bits are the upper halves of floats (bfloat16): sign, exponent, 7 bits of fraction.
static inline v16 v16_load_high(const uint16_t *p) { // any alignment
  v16i r;
  for (int k = 0; k < 16; k++) r.l[k] = (int32_t)((uint32_t)p[k] << 16);
  return v16_from_bits(r);
}
static inline void v16i_store_high(uint16_t *p, v16i a) { // the lower halves are lost
  for (int k = 0; k < 16; k++) p[k] = (uint16_t)((uint32_t)a.l[k] >> 16);
}
static inline void v16_store11(uint8_t *p, v16 a) { s1_store11(p, a.l); }
static inline v16 v16_load11(const uint8_t *p) {
  v16 r = v16_zero();
  s1_load11(p, r.l);
  return r;
}
static inline float v16_lo_(float a, float b) { return a < b ? a : b; }
static inline float v16_hi_(float a, float b) { return a > b ? a : b; }
static inline v16 v16_min4(v16 a) { // the smallest of each group of four lanes, in all four
  V16_EACH(v16_lo_(v16_lo_(a.l[k & 12], a.l[(k & 12) + 2]), v16_lo_(a.l[(k & 12) + 1], a.l[(k & 12) + 3])));
}
static inline v16 v16_max4(v16 a) {
  V16_EACH(v16_hi_(v16_hi_(a.l[k & 12], a.l[(k & 12) + 2]), v16_hi_(a.l[(k & 12) + 1], a.l[(k & 12) + 3])));
}
static inline float v16_sum(v16 a) {
  for (int h = 8; h; h /= 2)
    for (int k = 0; k < h; k++) a.l[k] += a.l[k + h];
  return a.l[0];
}
// Group i of four lanes: the sum of the i-th vector in all four.
static inline v16 v16_sum4(v16 a, v16 b, v16 c, v16 d) {
  const float s[4] = {v16_sum(a), v16_sum(b), v16_sum(c), v16_sum(d)};
  V16_EACH(s[k >> 2]);
}
static inline v16 v16_sum16(const v16 a[16]) { V16_EACH(v16_sum(a[k])); } // lane k = sum of a[k]
// 4x4 transposes in each group of four lanes: lane 4 g + i of out[k] is lane 4 g + k of the i-th
// vector.
static inline void v16_tr4(v16 a, v16 b, v16 c, v16 d, v16 out[4]) {
  const v16 in[4] = {a, b, c, d};
  for (int k = 0; k < 4; k++)
    for (int i = 0; i < 16; i++) out[k].l[i] = in[i & 3].l[(i & 12) + k];
}
static inline void v16_transpose(v16 a[16]) {
  for (int i = 0; i < 16; i++)
    for (int j = i + 1; j < 16; j++) {
      float t = a[i].l[j];
      a[i].l[j] = a[j].l[i];
      a[j].l[i] = t;
    }
}
#include "kernels/simd/v16_math.h"
#endif
