// SPDX-License-Identifier: Apache-2.0
// The 16-lane vocabulary on AVX2 + FMA: two 256-bit halves. v16_ref.h states what every word means.
#ifndef SV_V16_AVX2_H
#define SV_V16_AVX2_H
#include <immintrin.h>
#include <stdint.h>

#define V16_PARTS     2 // machine registers that a vector takes
#define V16_REGISTERS 8 // vectors that the register file holds

typedef struct {
  __m256 a, b; // lanes 0-7, 8-15
} v16;
typedef struct {
  __m256i a, b;
} v16i;
typedef struct {
  __m256 a, b; // all ones or all zeros per lane
} v16m;

static inline v16 v16_make_(__m256 a, __m256 b) {
  v16 r = {a, b};
  return r;
}
static inline v16m v16m_make_(__m256 a, __m256 b) {
  v16m r = {a, b};
  return r;
}
static inline v16i v16i_make_(__m256i a, __m256i b) {
  v16i r = {a, b};
  return r;
}
static inline v16 v16_set1(float x) { return v16_make_(_mm256_set1_ps(x), _mm256_set1_ps(x)); }
static inline v16 v16_zero(void) { return v16_make_(_mm256_setzero_ps(), _mm256_setzero_ps()); }
static inline v16 v16_iota(void) {
  return v16_make_(_mm256_setr_ps(0, 1, 2, 3, 4, 5, 6, 7), _mm256_setr_ps(8, 9, 10, 11, 12, 13, 14, 15));
}
static inline v16 v16_load(const float *p) { return v16_make_(_mm256_loadu_ps(p), _mm256_loadu_ps(p + 8)); }
static inline void v16_store(float *p, v16 x) {
  _mm256_storeu_ps(p, x.a);
  _mm256_storeu_ps(p + 8, x.b);
}
static inline v16 v16_load4x4(const float *p, long stride) {
  return v16_make_(_mm256_insertf128_ps(_mm256_castps128_ps256(_mm_loadu_ps(p)), _mm_loadu_ps(p + stride), 1),
                   _mm256_insertf128_ps(_mm256_castps128_ps256(_mm_loadu_ps(p + 2 * stride)),
                                        _mm_loadu_ps(p + 3 * stride), 1));
}
static inline v16 v16_load_quad(const float *p) {
  __m256 x = _mm256_broadcast_ps((const __m128 *)(const void *)p);
  return v16_make_(x, x);
}
static inline v16 v16_load_quads(const float *p0, const float *p1, const float *p2, const float *p3) {
  return v16_make_(_mm256_insertf128_ps(_mm256_castps128_ps256(_mm_loadu_ps(p0)), _mm_loadu_ps(p1), 1),
                   _mm256_insertf128_ps(_mm256_castps128_ps256(_mm_loadu_ps(p2)), _mm_loadu_ps(p3), 1));
}
static inline v16 v16_dup4_0(v16 x) {
  return v16_make_(_mm256_permute_ps(x.a, 0x00), _mm256_permute_ps(x.b, 0x00));
}
static inline v16 v16_dup4_1(v16 x) {
  return v16_make_(_mm256_permute_ps(x.a, 0x55), _mm256_permute_ps(x.b, 0x55));
}
static inline v16 v16_dup4_2(v16 x) {
  return v16_make_(_mm256_permute_ps(x.a, 0xaa), _mm256_permute_ps(x.b, 0xaa));
}
static inline v16 v16_dup4_3(v16 x) {
  return v16_make_(_mm256_permute_ps(x.a, 0xff), _mm256_permute_ps(x.b, 0xff));
}
static inline void v16_store4x4(float *p, long stride, v16 x) {
  _mm_storeu_ps(p, _mm256_castps256_ps128(x.a));
  _mm_storeu_ps(p + stride, _mm256_extractf128_ps(x.a, 1));
  _mm_storeu_ps(p + 2 * stride, _mm256_castps256_ps128(x.b));
  _mm_storeu_ps(p + 3 * stride, _mm256_extractf128_ps(x.b, 1));
}
static inline v16 v16_load_u8(const uint8_t *p) {
  __m128i q = _mm_loadu_si128((const __m128i *)p);
  return v16_make_(_mm256_cvtepi32_ps(_mm256_cvtepu8_epi32(q)),
                   _mm256_cvtepi32_ps(_mm256_cvtepu8_epi32(_mm_srli_si128(q, 8))));
}
static inline void v16_store_u8(uint8_t *p, v16 x) {
  __m256 z = _mm256_setzero_ps(), h = _mm256_set1_ps(255.0f);
  __m256i a = _mm256_cvtps_epi32(_mm256_min_ps(_mm256_max_ps(x.a, z), h));
  __m256i b = _mm256_cvtps_epi32(_mm256_min_ps(_mm256_max_ps(x.b, z), h));
  __m128i a16 = _mm_packus_epi32(_mm256_castsi256_si128(a), _mm256_extracti128_si256(a, 1));
  __m128i b16 = _mm_packus_epi32(_mm256_castsi256_si128(b), _mm256_extracti128_si256(b, 1));
  _mm_storeu_si128((__m128i *)p, _mm_packus_epi16(a16, b16));
}
#define V16_BIN(name, op)                                                                                    \
  static inline v16 name(v16 x, v16 y) { return v16_make_(op(x.a, y.a), op(x.b, y.b)); }
V16_BIN(v16_add, _mm256_add_ps)
V16_BIN(v16_sub, _mm256_sub_ps)
V16_BIN(v16_mul, _mm256_mul_ps)
V16_BIN(v16_div, _mm256_div_ps)
V16_BIN(v16_min, _mm256_min_ps)
V16_BIN(v16_max, _mm256_max_ps)
#undef V16_BIN
static inline v16 v16_fma(v16 x, v16 y, v16 z) {
  return v16_make_(_mm256_fmadd_ps(x.a, y.a, z.a), _mm256_fmadd_ps(x.b, y.b, z.b));
}
static inline v16 v16_fnma(v16 x, v16 y, v16 z) {
  return v16_make_(_mm256_fnmadd_ps(x.a, y.a, z.a), _mm256_fnmadd_ps(x.b, y.b, z.b));
}
static inline v16 v16_fms(v16 x, v16 y, v16 z) {
  return v16_make_(_mm256_fmsub_ps(x.a, y.a, z.a), _mm256_fmsub_ps(x.b, y.b, z.b));
}
static inline v16 v16_fnms(v16 x, v16 y, v16 z) {
  return v16_make_(_mm256_fnmsub_ps(x.a, y.a, z.a), _mm256_fnmsub_ps(x.b, y.b, z.b));
}
static inline v16 v16_sqrt(v16 x) { return v16_make_(_mm256_sqrt_ps(x.a), _mm256_sqrt_ps(x.b)); }
static inline v16 v16_floor(v16 x) { return v16_make_(_mm256_floor_ps(x.a), _mm256_floor_ps(x.b)); }
static inline v16 v16_abs(v16 x) {
  __m256 s = _mm256_set1_ps(-0.0f);
  return v16_make_(_mm256_andnot_ps(s, x.a), _mm256_andnot_ps(s, x.b));
}
static inline v16 v16_neg(v16 x) {
  __m256 s = _mm256_set1_ps(-0.0f);
  return v16_make_(_mm256_xor_ps(s, x.a), _mm256_xor_ps(s, x.b));
}
#define V16_CMP(name, pred)                                                                                  \
  static inline v16m name(v16 x, v16 y) {                                                                    \
    return v16m_make_(_mm256_cmp_ps(x.a, y.a, pred), _mm256_cmp_ps(x.b, y.b, pred));                         \
  }
V16_CMP(v16_lt, _CMP_LT_OQ)
V16_CMP(v16_le, _CMP_LE_OQ)
V16_CMP(v16_gt, _CMP_GT_OQ)
V16_CMP(v16_ge, _CMP_GE_OQ)
#undef V16_CMP
static inline v16m v16m_and(v16m x, v16m y) {
  return v16m_make_(_mm256_and_ps(x.a, y.a), _mm256_and_ps(x.b, y.b));
}
static inline v16m v16m_or(v16m x, v16m y) {
  return v16m_make_(_mm256_or_ps(x.a, y.a), _mm256_or_ps(x.b, y.b));
}
static inline v16m v16m_andnot(v16m x, v16m y) {
  return v16m_make_(_mm256_andnot_ps(y.a, x.a), _mm256_andnot_ps(y.b, x.b));
}
static inline uint32_t v16m_bits(v16m x) {
  return (uint32_t)_mm256_movemask_ps(x.a) | (uint32_t)_mm256_movemask_ps(x.b) << 8;
}
static inline int v16m_all(v16m x) { return v16m_bits(x) == 0xffff; }
static inline v16m v16m_from_bits(uint32_t bits) {
  __m256i n = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
  __m256i a = _mm256_and_si256(_mm256_set1_epi32((int)bits), n);
  __m256i b = _mm256_and_si256(_mm256_set1_epi32((int)(bits >> 8)), n);
  return v16m_make_(_mm256_castsi256_ps(_mm256_cmpeq_epi32(a, n)),
                    _mm256_castsi256_ps(_mm256_cmpeq_epi32(b, n)));
}
static inline v16 v16_sel(v16m m, v16 x, v16 y) {
  return v16_make_(_mm256_blendv_ps(y.a, x.a, m.a), _mm256_blendv_ps(y.b, x.b, m.b));
}
static inline v16 v16_keep(v16m m, v16 x) {
  return v16_make_(_mm256_and_ps(m.a, x.a), _mm256_and_ps(m.b, x.b));
}
static inline v16i v16i_set1(int32_t x) { return v16i_make_(_mm256_set1_epi32(x), _mm256_set1_epi32(x)); }
static inline v16i v16_bits(v16 x) { return v16i_make_(_mm256_castps_si256(x.a), _mm256_castps_si256(x.b)); }
static inline v16 v16_from_bits(v16i x) {
  return v16_make_(_mm256_castsi256_ps(x.a), _mm256_castsi256_ps(x.b));
}
static inline v16i v16i_add(v16i x, v16i y) {
  return v16i_make_(_mm256_add_epi32(x.a, y.a), _mm256_add_epi32(x.b, y.b));
}
static inline v16i v16i_and(v16i x, v16i y) {
  return v16i_make_(_mm256_and_si256(x.a, y.a), _mm256_and_si256(x.b, y.b));
}
static inline v16i v16i_andnot(v16i x, v16i y) {
  return v16i_make_(_mm256_andnot_si256(y.a, x.a), _mm256_andnot_si256(y.b, x.b));
}
static inline v16i v16i_or(v16i x, v16i y) {
  return v16i_make_(_mm256_or_si256(x.a, y.a), _mm256_or_si256(x.b, y.b));
}
static inline v16i v16i_shl8(v16i x) {
  return v16i_make_(_mm256_slli_epi32(x.a, 8), _mm256_slli_epi32(x.b, 8));
}
static inline v16i v16i_shr8(v16i x) {
  return v16i_make_(_mm256_srli_epi32(x.a, 8), _mm256_srli_epi32(x.b, 8));
}
static inline v16i v16i_shl16(v16i x) {
  return v16i_make_(_mm256_slli_epi32(x.a, 16), _mm256_slli_epi32(x.b, 16));
}
#define V16_HAS_SHL_BY 1
static inline v16i v16i_shl_by(v16i x, v16 n) {
  return v16i_make_(_mm256_sllv_epi32(x.a, _mm256_cvttps_epi32(n.a)),
                    _mm256_sllv_epi32(x.b, _mm256_cvttps_epi32(n.b)));
}
static inline v16i v16i_shl23(v16i x) {
  return v16i_make_(_mm256_slli_epi32(x.a, 23), _mm256_slli_epi32(x.b, 23));
}
static inline v16i v16i_shr23(v16i x) {
  return v16i_make_(_mm256_srli_epi32(x.a, 23), _mm256_srli_epi32(x.b, 23));
}
static inline v16 v16i_to_f(v16i x) { return v16_make_(_mm256_cvtepi32_ps(x.a), _mm256_cvtepi32_ps(x.b)); }
static inline v16i v16_trunc_i(v16 x) {
  return v16i_make_(_mm256_cvttps_epi32(x.a), _mm256_cvttps_epi32(x.b));
}
static inline void v16i_store(int32_t *p, v16i x) {
  _mm256_storeu_si256((__m256i *)p, x.a);
  _mm256_storeu_si256((__m256i *)(p + 8), x.b);
}
static inline v16 v16_load_high(const uint16_t *p) {
  __m256i a = _mm256_cvtepu16_epi32(_mm_loadu_si128((const __m128i *)p));
  __m256i b = _mm256_cvtepu16_epi32(_mm_loadu_si128((const __m128i *)(p + 8)));
  return v16_make_(_mm256_castsi256_ps(_mm256_slli_epi32(a, 16)),
                   _mm256_castsi256_ps(_mm256_slli_epi32(b, 16)));
}
static inline void v16i_store_high(uint16_t *p, v16i x) {
  __m256i q = _mm256_packus_epi32(_mm256_srli_epi32(x.a, 16), _mm256_srli_epi32(x.b, 16));
  _mm256_storeu_si256((__m256i *)p, _mm256_permute4x64_epi64(q, 0xd8));
}
static inline void v16_store11(uint8_t *p, v16 x) {
  const int no = (int)0x80808080;
  const __m256i of_a =
      _mm256_setr_epi32(0x07060302, 0x0f0e0b0a, 0x0d090501, no, 0x07060302, 0x0f0e0b0a, 0x0d090501, no);
  const __m128i of_b = _mm_setr_epi32(0x07060302, 0x05010b0a, no, no);
  __m256i a = _mm256_add_epi32(_mm256_castps_si256(x.a), _mm256_set1_epi32(0x80));
  __m128i b = _mm_add_epi32(_mm256_castsi256_si128(_mm256_castps_si256(x.b)), _mm_set1_epi32(0x80));
  a = _mm256_permutevar8x32_epi32(_mm256_shuffle_epi8(a, of_a), _mm256_setr_epi32(0, 1, 2, 4, 5, 6, 0, 0));
  _mm256_storeu_si256((__m256i *)p, a);
  _mm_storel_epi64((__m128i *)(p + 24), _mm_shuffle_epi8(b, of_b));
}
static inline v16 v16_load11(const uint8_t *p) {
  const int no = (int)0x80808080;
  const __m256i of_a = _mm256_setr_epi32(0x01000880, 0x03020980, 0x05040a80, 0x07060b80, 0x01000880,
                                         0x03020980, 0x05040a80, 0x07060b80);
  const __m128i of_b = _mm_setr_epi32(0x01000680, 0x03020780, 0x05048080, no);
  __m256i a = _mm256_permutevar8x32_epi32(_mm256_loadu_si256((const __m256i *)p),
                                          _mm256_setr_epi32(0, 1, 2, 2, 3, 4, 5, 5));
  __m128i b = _mm_shuffle_epi8(_mm_loadl_epi64((const __m128i *)(p + 24)), of_b);
  return v16_make_(_mm256_castsi256_ps(_mm256_shuffle_epi8(a, of_a)),
                   _mm256_castsi256_ps(_mm256_zextsi128_si256(b)));
}
static inline __m256 v16_min4_(__m256 x) {
  __m256 y = _mm256_min_ps(x, _mm256_permute_ps(x, 0x4e));
  return _mm256_min_ps(y, _mm256_permute_ps(y, 0xb1));
}
static inline __m256 v16_max4_(__m256 x) {
  __m256 y = _mm256_max_ps(x, _mm256_permute_ps(x, 0x4e));
  return _mm256_max_ps(y, _mm256_permute_ps(y, 0xb1));
}
static inline v16 v16_min4(v16 x) { return v16_make_(v16_min4_(x.a), v16_min4_(x.b)); }
static inline v16 v16_max4(v16 x) { return v16_make_(v16_max4_(x.a), v16_max4_(x.b)); }
static inline __m128 v16_fold4_(v16 x) {
  __m256 h = _mm256_add_ps(x.a, x.b);
  return _mm_add_ps(_mm256_castps256_ps128(h), _mm256_extractf128_ps(h, 1));
}
static inline float v16_sum(v16 x) {
  __m128 q = v16_fold4_(x);
  q = _mm_add_ps(q, _mm_movehl_ps(q, q));
  return _mm_cvtss_f32(_mm_add_ss(q, _mm_shuffle_ps(q, q, 1)));
}
// the sum of x in four lanes, that of y in the others
static inline __m256 v16_sum2_(v16 x, v16 y) {
  __m256 a = _mm256_add_ps(x.a, x.b), b = _mm256_add_ps(y.a, y.b);
  a = _mm256_add_ps(_mm256_permute2f128_ps(a, b, 0x20), _mm256_permute2f128_ps(a, b, 0x31));
  a = _mm256_add_ps(a, _mm256_permute_ps(a, 0x4e));
  return _mm256_add_ps(a, _mm256_permute_ps(a, 0xb1));
}
static inline v16 v16_sum4(v16 a, v16 b, v16 c, v16 d) { return v16_make_(v16_sum2_(a, b), v16_sum2_(c, d)); }
static inline __m128 v16_sum4_(const v16 *x) {
  __m128 a = v16_fold4_(x[0]), b = v16_fold4_(x[1]), c = v16_fold4_(x[2]), d = v16_fold4_(x[3]);
  _MM_TRANSPOSE4_PS(a, b, c, d);
  return _mm_add_ps(_mm_add_ps(a, c), _mm_add_ps(b, d));
}
static inline v16 v16_sum16(const v16 x[16]) {
  return v16_make_(_mm256_insertf128_ps(_mm256_castps128_ps256(v16_sum4_(x)), v16_sum4_(x + 4), 1),
                   _mm256_insertf128_ps(_mm256_castps128_ps256(v16_sum4_(x + 8)), v16_sum4_(x + 12), 1));
}
#define V16_HAS_SUM11 1
static inline v16 v16_sum11(const v16 x[11]) {
  v16 last[4] = {x[8], x[9], x[10], v16_zero()};
  return v16_make_(_mm256_insertf128_ps(_mm256_castps128_ps256(v16_sum4_(x)), v16_sum4_(x + 4), 1),
                   _mm256_zextps128_ps256(v16_sum4_(last)));
}
static inline v16 v16_sum9(const v16 x[9]) {
  __m128 q = v16_fold4_(x[8]);
  q = _mm_add_ps(q, _mm_movehl_ps(q, q));
  q = _mm_move_ss(_mm_setzero_ps(), _mm_add_ss(q, _mm_shuffle_ps(q, q, 1)));
  return v16_make_(_mm256_insertf128_ps(_mm256_castps128_ps256(v16_sum4_(x)), v16_sum4_(x + 4), 1),
                   _mm256_zextps128_ps256(q));
}
static inline void v16_tr4_(__m256 a, __m256 b, __m256 c, __m256 d, __m256 out[4]) {
  __m256 ab0 = _mm256_unpacklo_ps(a, b), ab1 = _mm256_unpackhi_ps(a, b);
  __m256 cd0 = _mm256_unpacklo_ps(c, d), cd1 = _mm256_unpackhi_ps(c, d);
  out[0] = _mm256_shuffle_ps(ab0, cd0, 0x44);
  out[1] = _mm256_shuffle_ps(ab0, cd0, 0xee);
  out[2] = _mm256_shuffle_ps(ab1, cd1, 0x44);
  out[3] = _mm256_shuffle_ps(ab1, cd1, 0xee);
}
static inline void v16_tr4(v16 a, v16 b, v16 c, v16 d, v16 out[4]) {
  __m256 lo[4], hi[4];
  v16_tr4_(a.a, b.a, c.a, d.a, lo);
  v16_tr4_(a.b, b.b, c.b, d.b, hi);
  for (int k = 0; k < 4; k++) out[k] = v16_make_(lo[k], hi[k]);
}
// 8x8 transpose of the rows r[0..7].
static inline void v16_tr8_(__m256 r[8]) {
  __m256 t[8], s[8];
  for (int i = 0; i < 4; i++) {
    t[2 * i] = _mm256_unpacklo_ps(r[2 * i], r[2 * i + 1]);
    t[2 * i + 1] = _mm256_unpackhi_ps(r[2 * i], r[2 * i + 1]);
  }
  for (int h = 0; h < 2; h++) {
    s[4 * h] = _mm256_shuffle_ps(t[4 * h], t[4 * h + 2], 0x44);
    s[4 * h + 1] = _mm256_shuffle_ps(t[4 * h], t[4 * h + 2], 0xee);
    s[4 * h + 2] = _mm256_shuffle_ps(t[4 * h + 1], t[4 * h + 3], 0x44);
    s[4 * h + 3] = _mm256_shuffle_ps(t[4 * h + 1], t[4 * h + 3], 0xee);
  }
  for (int i = 0; i < 4; i++) {
    r[i] = _mm256_permute2f128_ps(s[i], s[i + 4], 0x20);
    r[i + 4] = _mm256_permute2f128_ps(s[i], s[i + 4], 0x31);
  }
}
static __attribute__((noinline, unused)) void v16_transpose(v16 x[16]) {
  __m256 p[8], q[8], r[8], s[8];
  for (int i = 0; i < 8; i++) {
    p[i] = x[i].a;
    q[i] = x[i].b;
    r[i] = x[i + 8].a;
    s[i] = x[i + 8].b;
  }
  v16_tr8_(p);
  v16_tr8_(q);
  v16_tr8_(r);
  v16_tr8_(s);
  for (int i = 0; i < 8; i++) {
    x[i] = v16_make_(p[i], r[i]);
    x[i + 8] = v16_make_(q[i], s[i]);
  }
}
#include "kernels/simd/v16_math.h"
#endif
