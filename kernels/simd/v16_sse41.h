// SPDX-License-Identifier: Apache-2.0
// The 16-lane vocabulary on SSE4.1: four 128-bit quarters, no fused multiply-add (v16_fma rounds
// twice). v16_ref.h states what every word means.
#ifndef SV_V16_SSE41_H
#define SV_V16_SSE41_H
#include <smmintrin.h>
#include <stdint.h>

#define V16_PARTS     4 // machine registers that a vector takes
#define V16_REGISTERS 4 // vectors that the register file holds

typedef struct {
  __m128 q[4];
} v16;
typedef struct {
  __m128i q[4];
} v16i;
typedef struct {
  __m128 q[4]; // all ones or all zeros per lane
} v16m;

// -O2 leaves four-step loops rolled, and a rolled loop keeps the vector in memory: five times
// slower.
#define V16_UNROLL _Pragma("GCC unroll 4")
#define V16_EACH(type, expr)                                                                                 \
  type r;                                                                                                    \
  V16_UNROLL                                                                                                 \
  for (int i = 0; i < 4; i++) r.q[i] = (expr);                                                               \
  return r

static inline v16 v16_set1(float x) { V16_EACH(v16, _mm_set1_ps(x)); }
static inline v16 v16_zero(void) { V16_EACH(v16, _mm_setzero_ps()); }
static inline v16 v16_iota(void) {
  V16_EACH(v16, _mm_add_ps(_mm_setr_ps(0, 1, 2, 3), _mm_set1_ps((float)(4 * i))));
}
static inline v16 v16_load(const float *p) { V16_EACH(v16, _mm_loadu_ps(p + 4 * i)); }
static inline void v16_store(float *p, v16 x) {
  V16_UNROLL
  for (int i = 0; i < 4; i++) _mm_storeu_ps(p + 4 * i, x.q[i]);
}
static inline v16 v16_load4x4(const float *p, long stride) { V16_EACH(v16, _mm_loadu_ps(p + i * stride)); }
static inline v16 v16_load_quad(const float *p) { V16_EACH(v16, _mm_loadu_ps(p)); }
static inline v16 v16_load_quads(const float *p0, const float *p1, const float *p2, const float *p3) {
  v16 r = {{_mm_loadu_ps(p0), _mm_loadu_ps(p1), _mm_loadu_ps(p2), _mm_loadu_ps(p3)}};
  return r;
}
static inline v16 v16_dup4_0(v16 x) { V16_EACH(v16, _mm_shuffle_ps(x.q[i], x.q[i], 0x00)); }
static inline v16 v16_dup4_1(v16 x) { V16_EACH(v16, _mm_shuffle_ps(x.q[i], x.q[i], 0x55)); }
static inline v16 v16_dup4_2(v16 x) { V16_EACH(v16, _mm_shuffle_ps(x.q[i], x.q[i], 0xaa)); }
static inline v16 v16_dup4_3(v16 x) { V16_EACH(v16, _mm_shuffle_ps(x.q[i], x.q[i], 0xff)); }
static inline void v16_store4x4(float *p, long stride, v16 x) {
  V16_UNROLL
  for (int i = 0; i < 4; i++) _mm_storeu_ps(p + i * stride, x.q[i]);
}
static inline v16 v16_load_u8(const uint8_t *p) {
  __m128i b = _mm_loadu_si128((const __m128i *)p);
  v16 r;
  r.q[0] = _mm_cvtepi32_ps(_mm_cvtepu8_epi32(b));
  r.q[1] = _mm_cvtepi32_ps(_mm_cvtepu8_epi32(_mm_srli_si128(b, 4)));
  r.q[2] = _mm_cvtepi32_ps(_mm_cvtepu8_epi32(_mm_srli_si128(b, 8)));
  r.q[3] = _mm_cvtepi32_ps(_mm_cvtepu8_epi32(_mm_srli_si128(b, 12)));
  return r;
}
static inline void v16_store_u8(uint8_t *p, v16 x) {
  __m128i c[4];
  V16_UNROLL
  for (int i = 0; i < 4; i++)
    c[i] = _mm_cvtps_epi32(_mm_min_ps(_mm_max_ps(x.q[i], _mm_setzero_ps()), _mm_set1_ps(255.0f)));
  _mm_storeu_si128((__m128i *)p,
                   _mm_packus_epi16(_mm_packus_epi32(c[0], c[1]), _mm_packus_epi32(c[2], c[3])));
}
static inline v16 v16_add(v16 x, v16 y) { V16_EACH(v16, _mm_add_ps(x.q[i], y.q[i])); }
static inline v16 v16_sub(v16 x, v16 y) { V16_EACH(v16, _mm_sub_ps(x.q[i], y.q[i])); }
static inline v16 v16_mul(v16 x, v16 y) { V16_EACH(v16, _mm_mul_ps(x.q[i], y.q[i])); }
static inline v16 v16_div(v16 x, v16 y) { V16_EACH(v16, _mm_div_ps(x.q[i], y.q[i])); }
static inline v16 v16_fma(v16 x, v16 y, v16 z) {
  V16_EACH(v16, _mm_add_ps(_mm_mul_ps(x.q[i], y.q[i]), z.q[i]));
}
static inline v16 v16_fnma(v16 x, v16 y, v16 z) {
  V16_EACH(v16, _mm_sub_ps(z.q[i], _mm_mul_ps(x.q[i], y.q[i])));
}
static inline v16 v16_fms(v16 x, v16 y, v16 z) {
  V16_EACH(v16, _mm_sub_ps(_mm_mul_ps(x.q[i], y.q[i]), z.q[i]));
}
static inline v16 v16_fnms(v16 x, v16 y, v16 z) {
  V16_EACH(v16, _mm_sub_ps(_mm_mul_ps(_mm_xor_ps(_mm_set1_ps(-0.0f), x.q[i]), y.q[i]), z.q[i]));
}
static inline v16 v16_min(v16 x, v16 y) { V16_EACH(v16, _mm_min_ps(x.q[i], y.q[i])); }
static inline v16 v16_max(v16 x, v16 y) { V16_EACH(v16, _mm_max_ps(x.q[i], y.q[i])); }
static inline v16 v16_sqrt(v16 x) { V16_EACH(v16, _mm_sqrt_ps(x.q[i])); }
static inline v16 v16_floor(v16 x) { V16_EACH(v16, _mm_floor_ps(x.q[i])); }
static inline v16 v16_abs(v16 x) { V16_EACH(v16, _mm_andnot_ps(_mm_set1_ps(-0.0f), x.q[i])); }
static inline v16 v16_neg(v16 x) { V16_EACH(v16, _mm_xor_ps(_mm_set1_ps(-0.0f), x.q[i])); }
static inline v16m v16_lt(v16 x, v16 y) { V16_EACH(v16m, _mm_cmplt_ps(x.q[i], y.q[i])); }
static inline v16m v16_le(v16 x, v16 y) { V16_EACH(v16m, _mm_cmple_ps(x.q[i], y.q[i])); }
static inline v16m v16_gt(v16 x, v16 y) { V16_EACH(v16m, _mm_cmpgt_ps(x.q[i], y.q[i])); }
static inline v16m v16_ge(v16 x, v16 y) { V16_EACH(v16m, _mm_cmpge_ps(x.q[i], y.q[i])); }
static inline v16m v16m_and(v16m x, v16m y) { V16_EACH(v16m, _mm_and_ps(x.q[i], y.q[i])); }
static inline v16m v16m_or(v16m x, v16m y) { V16_EACH(v16m, _mm_or_ps(x.q[i], y.q[i])); }
static inline v16m v16m_andnot(v16m x, v16m y) { V16_EACH(v16m, _mm_andnot_ps(y.q[i], x.q[i])); }
static inline uint32_t v16m_bits(v16m x) {
  return (uint32_t)(_mm_movemask_ps(x.q[0]) | _mm_movemask_ps(x.q[1]) << 4 | _mm_movemask_ps(x.q[2]) << 8 |
                    _mm_movemask_ps(x.q[3]) << 12);
}
static inline int v16m_all(v16m x) { return v16m_bits(x) == 0xffff; }
static inline v16m v16m_from_bits(uint32_t bits) {
  __m128i n = _mm_setr_epi32(1, 2, 4, 8);
  V16_EACH(v16m,
           _mm_castsi128_ps(_mm_cmpeq_epi32(_mm_and_si128(_mm_set1_epi32((int)(bits >> (4 * i))), n), n)));
}
static inline v16 v16_sel(v16m m, v16 x, v16 y) { V16_EACH(v16, _mm_blendv_ps(y.q[i], x.q[i], m.q[i])); }
static inline v16 v16_keep(v16m m, v16 x) { V16_EACH(v16, _mm_and_ps(m.q[i], x.q[i])); }
static inline v16i v16i_set1(int32_t x) { V16_EACH(v16i, _mm_set1_epi32(x)); }
static inline v16i v16_bits(v16 x) { V16_EACH(v16i, _mm_castps_si128(x.q[i])); }
static inline v16 v16_from_bits(v16i x) { V16_EACH(v16, _mm_castsi128_ps(x.q[i])); }
static inline v16i v16i_add(v16i x, v16i y) { V16_EACH(v16i, _mm_add_epi32(x.q[i], y.q[i])); }
static inline v16i v16i_and(v16i x, v16i y) { V16_EACH(v16i, _mm_and_si128(x.q[i], y.q[i])); }
static inline v16i v16i_andnot(v16i x, v16i y) { V16_EACH(v16i, _mm_andnot_si128(y.q[i], x.q[i])); }
static inline v16i v16i_or(v16i x, v16i y) { V16_EACH(v16i, _mm_or_si128(x.q[i], y.q[i])); }
static inline v16i v16i_shl8(v16i x) { V16_EACH(v16i, _mm_slli_epi32(x.q[i], 8)); }
static inline v16i v16i_shr8(v16i x) { V16_EACH(v16i, _mm_srli_epi32(x.q[i], 8)); }
static inline v16i v16i_shl16(v16i x) { V16_EACH(v16i, _mm_slli_epi32(x.q[i], 16)); }
static inline v16i v16i_shl23(v16i x) { V16_EACH(v16i, _mm_slli_epi32(x.q[i], 23)); }
static inline v16i v16i_shr23(v16i x) { V16_EACH(v16i, _mm_srli_epi32(x.q[i], 23)); }
static inline v16 v16i_to_f(v16i x) { V16_EACH(v16, _mm_cvtepi32_ps(x.q[i])); }
static inline v16i v16_trunc_i(v16 x) { V16_EACH(v16i, _mm_cvttps_epi32(x.q[i])); }
static inline void v16i_store(int32_t *p, v16i x) {
  V16_UNROLL
  for (int i = 0; i < 4; i++) _mm_storeu_si128((__m128i *)(p + 4 * i), x.q[i]);
}
static inline v16 v16_load_high(const uint16_t *p) {
  __m128i a = _mm_loadu_si128((const __m128i *)p), b = _mm_loadu_si128((const __m128i *)(p + 8)),
          z = _mm_setzero_si128();
  v16 r = {{_mm_castsi128_ps(_mm_unpacklo_epi16(z, a)), _mm_castsi128_ps(_mm_unpackhi_epi16(z, a)),
            _mm_castsi128_ps(_mm_unpacklo_epi16(z, b)), _mm_castsi128_ps(_mm_unpackhi_epi16(z, b))}};
  return r;
}
static inline void v16i_store_high(uint16_t *p, v16i x) {
  __m128i h[4];
  V16_UNROLL
  for (int i = 0; i < 4; i++) h[i] = _mm_srli_epi32(x.q[i], 16);
  _mm_storeu_si128((__m128i *)p, _mm_packus_epi32(h[0], h[1]));
  _mm_storeu_si128((__m128i *)(p + 8), _mm_packus_epi32(h[2], h[3]));
}
static inline void v16_store11(uint8_t *p, v16 x) {
  const int no = (int)0x80808080;
  const __m128i four = _mm_setr_epi32(0x07060302, 0x0f0e0b0a, 0x0d090501, no),
                three = _mm_setr_epi32(0x07060302, 0x05010b0a, no, no), half = _mm_set1_epi32(0x80);
  __m128i q[3];
  V16_UNROLL
  for (int i = 0; i < 3; i++)
    q[i] = _mm_shuffle_epi8(_mm_add_epi32(_mm_castps_si128(x.q[i]), half), i < 2 ? four : three);
  _mm_storeu_si128((__m128i *)p, q[0]); // each store leaves four bytes for the next
  _mm_storeu_si128((__m128i *)(p + 12), q[1]);
  _mm_storel_epi64((__m128i *)(p + 24), q[2]);
}
static inline v16 v16_load11(const uint8_t *p) {
  const int no = (int)0x80808080;
  const __m128i four = _mm_setr_epi32(0x01000880, 0x03020980, 0x05040a80, 0x07060b80),
                three = _mm_setr_epi32(0x01000680, 0x03020780, 0x05048080, no);
  v16 r = {{_mm_castsi128_ps(_mm_shuffle_epi8(_mm_loadu_si128((const __m128i *)p), four)),
            _mm_castsi128_ps(_mm_shuffle_epi8(_mm_loadu_si128((const __m128i *)(p + 12)), four)),
            _mm_castsi128_ps(_mm_shuffle_epi8(_mm_loadl_epi64((const __m128i *)(p + 24)), three)),
            _mm_setzero_ps()}};
  return r;
}
static inline __m128 v16_min4_(__m128 x) {
  __m128 y = _mm_min_ps(x, _mm_shuffle_ps(x, x, 0x4e));
  return _mm_min_ps(y, _mm_shuffle_ps(y, y, 0xb1));
}
static inline __m128 v16_max4_(__m128 x) {
  __m128 y = _mm_max_ps(x, _mm_shuffle_ps(x, x, 0x4e));
  return _mm_max_ps(y, _mm_shuffle_ps(y, y, 0xb1));
}
static inline v16 v16_min4(v16 x) { V16_EACH(v16, v16_min4_(x.q[i])); }
static inline v16 v16_max4(v16 x) { V16_EACH(v16, v16_max4_(x.q[i])); }
static inline __m128 v16_fold4_(v16 x) {
  return _mm_add_ps(_mm_add_ps(x.q[0], x.q[2]), _mm_add_ps(x.q[1], x.q[3]));
}
static inline float v16_sum(v16 x) {
  __m128 q = v16_fold4_(x);
  q = _mm_add_ps(q, _mm_movehl_ps(q, q));
  return _mm_cvtss_f32(_mm_add_ss(q, _mm_shuffle_ps(q, q, 1)));
}
static inline __m128 v16_sum_(v16 x) {
  __m128 q = v16_fold4_(x);
  q = _mm_add_ps(q, _mm_shuffle_ps(q, q, 0x4e));
  return _mm_add_ps(q, _mm_shuffle_ps(q, q, 0xb1));
}
static inline v16 v16_sum4(v16 a, v16 b, v16 c, v16 d) {
  v16 r = {{v16_sum_(a), v16_sum_(b), v16_sum_(c), v16_sum_(d)}};
  return r;
}
static inline void v16_tr4(v16 a, v16 b, v16 c, v16 d, v16 out[4]) {
  V16_UNROLL
  for (int i = 0; i < 4; i++) _MM_TRANSPOSE4_PS(a.q[i], b.q[i], c.q[i], d.q[i]);
  out[0] = a;
  out[1] = b;
  out[2] = c;
  out[3] = d;
}
static inline __m128 v16_sum4_(const v16 *x) {
  __m128 a = v16_fold4_(x[0]), b = v16_fold4_(x[1]), c = v16_fold4_(x[2]), d = v16_fold4_(x[3]);
  _MM_TRANSPOSE4_PS(a, b, c, d);
  return _mm_add_ps(_mm_add_ps(a, c), _mm_add_ps(b, d));
}
static inline v16 v16_sum16(const v16 x[16]) { V16_EACH(v16, v16_sum4_(x + 4 * i)); }
static __attribute__((noinline, unused)) void v16_transpose(v16 x[16]) {
  V16_UNROLL
  for (int g = 0; g < 4; g++) V16_UNROLL
  for (int k = 0; k < 4; k++)
    _MM_TRANSPOSE4_PS(x[4 * g].q[k], x[4 * g + 1].q[k], x[4 * g + 2].q[k], x[4 * g + 3].q[k]);
  V16_UNROLL
  for (int g = 0; g < 4; g++) V16_UNROLL
  for (int k = g + 1; k < 4; k++) V16_UNROLL
  for (int i = 0; i < 4; i++) {
    __m128 t = x[4 * g + i].q[k];
    x[4 * g + i].q[k] = x[4 * k + i].q[g];
    x[4 * k + i].q[g] = t;
  }
}
#include "kernels/simd/v16_math.h"
#endif
