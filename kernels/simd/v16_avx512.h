// SPDX-License-Identifier: Apache-2.0
// The 16-lane vocabulary on AVX-512 (F, DQ, VL, BW). v16_ref.h states what every word means.
#ifndef SV_V16_AVX512_H
#define SV_V16_AVX512_H
#include <immintrin.h>
#include <stdint.h>

#define V16_PARTS     1  // machine registers that a vector takes
#define V16_REGISTERS 32 // vectors that the register file holds

typedef __m512 v16;
typedef __m512i v16i;
typedef __mmask16 v16m;

static inline v16 v16_set1(float x) { return _mm512_set1_ps(x); }
static inline v16 v16_zero(void) { return _mm512_setzero_ps(); }
static inline v16 v16_iota(void) {
  return _mm512_setr_ps(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
}
static inline v16 v16_load(const float *p) { return _mm512_loadu_ps(p); }
static inline void v16_store(float *p, v16 a) { _mm512_storeu_ps(p, a); }
#define V16_HAS_SHIFT_IN 1 // the 16 floats from the one at k of a, b side by side
#define v16_shift_in(a, b, k)                                                                                \
  _mm512_castsi512_ps(_mm512_alignr_epi32(_mm512_castps_si512(b), _mm512_castps_si512(a), k))
static inline v16 v16_load4x4(const float *p, long stride) {
  v16 a = _mm512_castps128_ps512(_mm_loadu_ps(p));
  a = _mm512_insertf32x4(a, _mm_loadu_ps(p + stride), 1);
  a = _mm512_insertf32x4(a, _mm_loadu_ps(p + 2 * stride), 2);
  return _mm512_insertf32x4(a, _mm_loadu_ps(p + 3 * stride), 3);
}
static inline v16 v16_load_quad(const float *p) { return _mm512_broadcast_f32x4(_mm_loadu_ps(p)); }
static inline v16 v16_load_quads(const float *p0, const float *p1, const float *p2, const float *p3) {
  v16 a = _mm512_castps128_ps512(_mm_loadu_ps(p0));
  a = _mm512_insertf32x4(a, _mm_loadu_ps(p1), 1);
  a = _mm512_insertf32x4(a, _mm_loadu_ps(p2), 2);
  return _mm512_insertf32x4(a, _mm_loadu_ps(p3), 3);
}
static inline v16 v16_dup4_0(v16 a) { return _mm512_permute_ps(a, 0x00); }
static inline v16 v16_dup4_1(v16 a) { return _mm512_permute_ps(a, 0x55); }
static inline v16 v16_dup4_2(v16 a) { return _mm512_permute_ps(a, 0xaa); }
static inline v16 v16_dup4_3(v16 a) { return _mm512_permute_ps(a, 0xff); }
static inline void v16_store4x4(float *p, long stride, v16 a) {
  _mm_storeu_ps(p, _mm512_castps512_ps128(a));
  _mm_storeu_ps(p + stride, _mm512_extractf32x4_ps(a, 1));
  _mm_storeu_ps(p + 2 * stride, _mm512_extractf32x4_ps(a, 2));
  _mm_storeu_ps(p + 3 * stride, _mm512_extractf32x4_ps(a, 3));
}
// The quads of four vectors transposed: out[i] has quad i of each.
static inline void v16_swap_quads_(v16 out[4], const v16 a[4]) {
  v16 p = _mm512_shuffle_f32x4(a[0], a[1], 0x44), q = _mm512_shuffle_f32x4(a[2], a[3], 0x44);
  v16 r = _mm512_shuffle_f32x4(a[0], a[1], 0xee), s = _mm512_shuffle_f32x4(a[2], a[3], 0xee);
  out[0] = _mm512_shuffle_f32x4(p, q, 0x88);
  out[1] = _mm512_shuffle_f32x4(p, q, 0xdd);
  out[2] = _mm512_shuffle_f32x4(r, s, 0x88);
  out[3] = _mm512_shuffle_f32x4(r, s, 0xdd);
}
#define V16_HAS_4X16 1 // four 4x4 blocks side by side: whole vectors go to and from memory
static inline void v16_load4x16(v16 out[4], const float *p, long stride) {
  v16 rows[4] = {v16_load(p), v16_load(p + stride), v16_load(p + 2 * stride), v16_load(p + 3 * stride)};
  v16_swap_quads_(out, rows);
}
static inline void v16_store4x16(float *p, long stride, const v16 a[4]) {
  v16 rows[4];
  v16_swap_quads_(rows, a);
  for (int i = 0; i < 4; i++) v16_store(p + i * stride, rows[i]);
}
static inline v16 v16_load_u8(const uint8_t *p) {
  return _mm512_cvtepi32_ps(_mm512_cvtepu8_epi32(_mm_loadu_si128((const __m128i *)p)));
}
static inline void v16_store_u8(uint8_t *p, v16 a) {
  v16 c = _mm512_min_ps(_mm512_max_ps(a, _mm512_setzero_ps()), _mm512_set1_ps(255.0f));
  _mm_storeu_si128((__m128i *)p, _mm512_cvtepi32_epi8(_mm512_cvtps_epi32(c)));
}
static inline v16 v16_add(v16 a, v16 b) { return _mm512_add_ps(a, b); }
static inline v16 v16_sub(v16 a, v16 b) { return _mm512_sub_ps(a, b); }
static inline v16 v16_mul(v16 a, v16 b) { return _mm512_mul_ps(a, b); }
static inline v16 v16_div(v16 a, v16 b) { return _mm512_div_ps(a, b); }
static inline v16 v16_fma(v16 a, v16 b, v16 c) { return _mm512_fmadd_ps(a, b, c); }
static inline v16 v16_fnma(v16 a, v16 b, v16 c) { return _mm512_fnmadd_ps(a, b, c); }
static inline v16 v16_fms(v16 a, v16 b, v16 c) { return _mm512_fmsub_ps(a, b, c); }
static inline v16 v16_fnms(v16 a, v16 b, v16 c) { return _mm512_fnmsub_ps(a, b, c); }
static inline v16 v16_min(v16 a, v16 b) { return _mm512_min_ps(a, b); }
static inline v16 v16_max(v16 a, v16 b) { return _mm512_max_ps(a, b); }
static inline v16 v16_sqrt(v16 a) { return _mm512_sqrt_ps(a); }
static inline v16 v16_floor(v16 a) { return _mm512_roundscale_ps(a, _MM_FROUND_TO_NEG_INF); }
static inline v16 v16_abs(v16 a) { return _mm512_andnot_ps(_mm512_set1_ps(-0.0f), a); }
static inline v16 v16_neg(v16 a) { return _mm512_xor_ps(_mm512_set1_ps(-0.0f), a); }
static inline v16m v16_lt(v16 a, v16 b) { return _mm512_cmp_ps_mask(a, b, _CMP_LT_OQ); }
static inline v16m v16_le(v16 a, v16 b) { return _mm512_cmp_ps_mask(a, b, _CMP_LE_OQ); }
static inline v16m v16_gt(v16 a, v16 b) { return _mm512_cmp_ps_mask(a, b, _CMP_GT_OQ); }
static inline v16m v16_ge(v16 a, v16 b) { return _mm512_cmp_ps_mask(a, b, _CMP_GE_OQ); }
static inline v16m v16m_and(v16m a, v16m b) { return (v16m)(a & b); }
static inline v16m v16m_or(v16m a, v16m b) { return (v16m)(a | b); }
static inline v16m v16m_andnot(v16m a, v16m b) { return (v16m)(a & ~b); }
static inline uint32_t v16m_bits(v16m a) { return a; }
static inline int v16m_all(v16m a) { return a == 0xffff; }
static inline v16m v16m_from_bits(uint32_t b) { return (v16m)b; }
static inline v16 v16_sel(v16m m, v16 a, v16 b) { return _mm512_mask_mov_ps(b, m, a); }
static inline v16 v16_keep(v16m m, v16 a) { return _mm512_maskz_mov_ps(m, a); }
#define V16_HAS_REST 1
static inline v16 v16_rest(v16 x) { return _mm512_reduce_ps(x, 0); }
#define V16_HAS_SCALE 1
static inline v16 v16_above_floor(v16 x) { return _mm512_reduce_ps(x, _MM_FROUND_TO_NEG_INF); }
static inline v16 v16_scale(v16 p, v16 x) { return _mm512_scalef_ps(p, x); } // p 2^floor(x)
static inline v16i v16i_set1(int32_t x) { return _mm512_set1_epi32(x); }
static inline v16i v16_bits(v16 a) { return _mm512_castps_si512(a); }
static inline v16 v16_from_bits(v16i a) { return _mm512_castsi512_ps(a); }
static inline v16i v16i_add(v16i a, v16i b) { return _mm512_add_epi32(a, b); }
static inline v16i v16i_and(v16i a, v16i b) { return _mm512_and_si512(a, b); }
static inline v16i v16i_andnot(v16i a, v16i b) { return _mm512_andnot_si512(b, a); }
static inline v16i v16i_or(v16i a, v16i b) { return _mm512_or_si512(a, b); }
static inline v16i v16i_shl8(v16i a) { return _mm512_slli_epi32(a, 8); }
static inline v16i v16i_shr8(v16i a) { return _mm512_srli_epi32(a, 8); }
static inline v16i v16i_shl16(v16i a) { return _mm512_slli_epi32(a, 16); }
static inline v16i v16i_shl23(v16i a) { return _mm512_slli_epi32(a, 23); }
#define V16_HAS_SHL_BY 1
static inline v16i v16i_shl_by(v16i a, v16 n) { return _mm512_sllv_epi32(a, _mm512_cvttps_epi32(n)); }
static inline v16i v16i_shr23(v16i a) { return _mm512_srli_epi32(a, 23); }
static inline v16 v16i_to_f(v16i a) { return _mm512_cvtepi32_ps(a); }
static inline v16i v16_trunc_i(v16 a) { return _mm512_cvttps_epi32(a); }
static inline void v16i_store(int32_t *p, v16i a) { _mm512_storeu_si512(p, a); }
static inline v16 v16_load_high(const uint16_t *p) {
  const __m512i to = _mm512_setr_epi32(0x00000000, 0x00010000, 0x00020000, 0x00030000, 0x00040000, 0x00050000,
                                       0x00060000, 0x00070000, 0x00080000, 0x00090000, 0x000a0000, 0x000b0000,
                                       0x000c0000, 0x000d0000, 0x000e0000, 0x000f0000);
  __m512i x = _mm512_zextsi256_si512(_mm256_loadu_si256((const __m256i *)p));
  return _mm512_castsi512_ps(_mm512_maskz_permutexvar_epi16(0xaaaaaaaa, to, x));
}
static inline void v16i_store_high(uint16_t *p, v16i a) {
  const __m512i from = _mm512_setr_epi32(0x00030001, 0x00070005, 0x000b0009, 0x000f000d, 0x00130011,
                                         0x00170015, 0x001b0019, 0x001f001d, 0, 0, 0, 0, 0, 0, 0, 0);
  _mm256_storeu_si256((__m256i *)p, _mm512_castsi512_si256(_mm512_permutexvar_epi16(from, a)));
}
static inline void v16_store11(uint8_t *p, v16 a) {
  const int no = (int)0x80808080;
  const __m512i bytes = _mm512_setr_epi32(0x07060302, 0x0f0e0b0a, 0x0d090501, no, 0x07060302, 0x0f0e0b0a,
                                          0x0d090501, no, 0x07060302, 0x05010b0a, no, no, no, no, no, no);
  const __m512i words = _mm512_setr_epi32(0, 1, 2, 4, 5, 6, 8, 9, 0, 0, 0, 0, 0, 0, 0, 0);
  __m512i x = _mm512_add_epi32(_mm512_castps_si512(a), _mm512_set1_epi32(0x80));
  x = _mm512_permutexvar_epi32(words, _mm512_shuffle_epi8(x, bytes));
  _mm256_storeu_si256((__m256i *)p, _mm512_castsi512_si256(x));
}
static inline v16 v16_load11(const uint8_t *p) {
  const int no = (int)0x80808080;
  const __m512i bytes =
      _mm512_setr_epi32(0x01000880, 0x03020980, 0x05040a80, 0x07060b80, 0x01000880, 0x03020980, 0x05040a80,
                        0x07060b80, 0x01000680, 0x03020780, (int)0x05048080, no, no, no, no, no);
  const __m512i words = _mm512_setr_epi32(0, 1, 2, 2, 3, 4, 5, 5, 6, 7, 7, 7, 7, 7, 7, 7);
  __m512i x = _mm512_zextsi256_si512(_mm256_loadu_si256((const __m256i *)p));
  return _mm512_castsi512_ps(_mm512_shuffle_epi8(_mm512_permutexvar_epi32(words, x), bytes));
}
// a + x where i and j are equal, else x; a | b where any of the bits is set, else 0.
#define V16_HAS_ADD_SAME 1
static inline v16 v16_add_same(v16 a, v16 x, v16i i, v16i j) {
  return _mm512_mask_add_ps(x, _mm512_cmpeq_epi32_mask(i, j), x, a);
}
static inline v16i v16i_or_if(uint64_t bits, v16i a, v16i b) {
  const __m512i on = _mm512_set1_epi64((long long)bits);
  return _mm512_maskz_or_epi64(_mm512_test_epi64_mask(on, on), a, b);
}
// Bit 8 y + x of a[i] to bit i of out[8 x + y], 64 words each: swaps of bits between words far
// apart, a transpose of words, swaps again.
#define V16_HAS_TRANSPOSE64 1
static inline void v16_swap_bits(__m512i *a, __m512i *b, int shift, uint64_t low) {
  __m512i t = _mm512_and_si512(_mm512_xor_si512(_mm512_srli_epi64(*a, (unsigned)shift), *b),
                               _mm512_set1_epi64((long long)low));
  *b = _mm512_xor_si512(*b, t);
  *a = _mm512_xor_si512(*a, _mm512_slli_epi64(t, (unsigned)shift));
}
static inline void v16_transpose64(uint64_t *out, const uint64_t *a) {
  __m512i r[8], t[8];
  for (int i = 0; i < 8; i++) r[i] = _mm512_loadu_si512(a + 8 * i);
  for (int i = 0; i < 4; i++) v16_swap_bits(r + i, r + i + 4, 32, 0x00000000ffffffffull);
  for (int i = 0; i < 8; i += i % 2 ? 3 : 1) v16_swap_bits(r + i, r + i + 2, 16, 0x0000ffff0000ffffull);
  for (int i = 0; i < 8; i += 2) v16_swap_bits(r + i, r + i + 1, 8, 0x00ff00ff00ff00ffull);
  for (int i = 0; i < 8; i += 2) {
    t[i] = _mm512_unpacklo_epi64(r[i], r[i + 1]);
    t[i + 1] = _mm512_unpackhi_epi64(r[i], r[i + 1]);
  }
  // t[i]: rows 0, 1 of column 2 k + i in the lane k; t[2 + i]: rows 2, 3, ...
  for (int i = 0; i < 2; i++) {
    __m512i p = _mm512_shuffle_i64x2(t[i], t[2 + i], 0x88), q = _mm512_shuffle_i64x2(t[i], t[2 + i], 0xdd);
    __m512i u = _mm512_shuffle_i64x2(t[4 + i], t[6 + i], 0x88),
            v = _mm512_shuffle_i64x2(t[4 + i], t[6 + i], 0xdd);
    r[i] = _mm512_shuffle_i64x2(p, u, 0x88);
    r[4 + i] = _mm512_shuffle_i64x2(p, u, 0xdd);
    r[2 + i] = _mm512_shuffle_i64x2(q, v, 0x88);
    r[6 + i] = _mm512_shuffle_i64x2(q, v, 0xdd);
  }
  for (int i = 0; i < 4; i++) v16_swap_bits(r + i, r + i + 4, 4, 0x0f0f0f0f0f0f0f0full);
  for (int i = 0; i < 8; i += i % 2 ? 3 : 1) v16_swap_bits(r + i, r + i + 2, 2, 0x3333333333333333ull);
  for (int i = 0; i < 8; i += 2) v16_swap_bits(r + i, r + i + 1, 1, 0x5555555555555555ull);
  for (int i = 0; i < 8; i++) _mm512_storeu_si512(out + 8 * i, r[i]);
}
static inline v16 v16_min4(v16 a) {
  v16 b = _mm512_min_ps(a, _mm512_permute_ps(a, 0x4e));
  return _mm512_min_ps(b, _mm512_permute_ps(b, 0xb1));
}
static inline v16 v16_max4(v16 a) {
  v16 b = _mm512_max_ps(a, _mm512_permute_ps(a, 0x4e));
  return _mm512_max_ps(b, _mm512_permute_ps(b, 0xb1));
}
static inline float v16_sum(v16 a) {
  __m256 h = _mm256_add_ps(_mm512_castps512_ps256(a), _mm512_extractf32x8_ps(a, 1));
  __m128 q = _mm_add_ps(_mm256_castps256_ps128(h), _mm256_extractf128_ps(h, 1));
  q = _mm_add_ps(q, _mm_movehl_ps(q, q));
  return _mm_cvtss_f32(_mm_add_ss(q, _mm_shuffle_ps(q, q, 1)));
}
static inline void v16_tr4(v16 a, v16 b, v16 c, v16 d, v16 out[4]) {
  v16 ab0 = _mm512_unpacklo_ps(a, b), ab1 = _mm512_unpackhi_ps(a, b);
  v16 cd0 = _mm512_unpacklo_ps(c, d), cd1 = _mm512_unpackhi_ps(c, d);
  out[0] = _mm512_shuffle_ps(ab0, cd0, 0x44);
  out[1] = _mm512_shuffle_ps(ab0, cd0, 0xee);
  out[2] = _mm512_shuffle_ps(ab1, cd1, 0x44);
  out[3] = _mm512_shuffle_ps(ab1, cd1, 0xee);
}
// Two vectors are folded at once by exchanging halves: a blend goes through either of two ports,
// where each of two shuffles would go through the same one.
static inline v16 v16_fold2_(v16 a, v16 b) { // [a: lanes i + (i+8)] [b: the same]
  return _mm512_add_ps(_mm512_mask_mov_ps(a, 0xff00, b), _mm512_shuffle_f32x4(a, b, 0x4e));
}
static inline v16 v16_fold1_(v16 a) { // the same with b = 0
  return _mm512_zextps256_ps512(_mm256_add_ps(_mm512_castps512_ps256(a), _mm512_extractf32x8_ps(a, 1)));
}
static inline v16 v16_fold4_(v16 ab, v16 cd) { // [a: four lanes left] [b] [c] [d]
  return _mm512_add_ps(_mm512_shuffle_f32x4(ab, cd, 0x88), _mm512_shuffle_f32x4(ab, cd, 0xdd));
}
// Lane 4 q + k: the sum of group q of x_k.
static inline v16 v16_fold16_(v16 x0, v16 x1, v16 x2, v16 x3) {
  v16 a = _mm512_add_ps(_mm512_mask_mov_ps(x0, 0xcccc, x1), _mm512_shuffle_ps(x0, x1, 0x4e));
  v16 b = _mm512_add_ps(_mm512_mask_mov_ps(x2, 0xcccc, x3), _mm512_shuffle_ps(x2, x3, 0x4e));
  return _mm512_add_ps(_mm512_shuffle_ps(a, b, 0x88), _mm512_shuffle_ps(a, b, 0xdd));
}
static inline v16 v16_sum4(v16 a, v16 b, v16 c, v16 d) {
  v16 x = v16_fold4_(v16_fold2_(a, b), v16_fold2_(c, d));
  x = _mm512_add_ps(x, _mm512_permute_ps(x, 0x4e));
  return _mm512_add_ps(x, _mm512_permute_ps(x, 0xb1));
}
static inline v16 v16_sum16(const v16 a[16]) {
  return v16_fold16_(v16_fold4_(v16_fold2_(a[0], a[4]), v16_fold2_(a[8], a[12])),
                     v16_fold4_(v16_fold2_(a[1], a[5]), v16_fold2_(a[9], a[13])),
                     v16_fold4_(v16_fold2_(a[2], a[6]), v16_fold2_(a[10], a[14])),
                     v16_fold4_(v16_fold2_(a[3], a[7]), v16_fold2_(a[11], a[15])));
}
#define V16_HAS_SUM11 1
static inline v16 v16_sum11(const v16 a[11]) {
  return v16_fold16_(v16_fold4_(v16_fold2_(a[0], a[4]), v16_fold1_(a[8])),
                     v16_fold4_(v16_fold2_(a[1], a[5]), v16_fold1_(a[9])),
                     v16_fold4_(v16_fold2_(a[2], a[6]), v16_fold1_(a[10])),
                     v16_fold4_(v16_fold2_(a[3], a[7]), v16_zero()));
}
static inline v16 v16_sum9(const v16 a[9]) {
  const v16 x0 = v16_fold4_(v16_fold2_(a[0], a[4]), v16_fold1_(a[8])), f37 = v16_fold2_(a[3], a[7]),
            x12 = v16_fold4_(v16_fold2_(a[1], a[5]), v16_fold2_(a[2], a[6])),
            x2 = _mm512_shuffle_f32x4(x12, x12, 0xee);
  return _mm512_maskz_mov_ps(0x1ff, v16_fold16_(x0, x12, x2, v16_fold4_(f37, f37)));
}
static inline void v16_transpose(v16 a[16]) {
  v16 t[16];
  _Pragma("GCC unroll 4") for (int g = 0; g < 4; g++)
      v16_tr4(a[4 * g], a[4 * g + 1], a[4 * g + 2], a[4 * g + 3], t + 4 * g);
  // t[4g+k] group q = element 4q+k of rows 4g..4g+3
  _Pragma("GCC unroll 4") for (int k = 0; k < 4; k++) {
    v16 x0 = _mm512_shuffle_f32x4(t[k], t[4 + k], 0x44), x1 = _mm512_shuffle_f32x4(t[k], t[4 + k], 0xee);
    v16 y0 = _mm512_shuffle_f32x4(t[8 + k], t[12 + k], 0x44),
        y1 = _mm512_shuffle_f32x4(t[8 + k], t[12 + k], 0xee);
    a[k] = _mm512_shuffle_f32x4(x0, y0, 0x88);
    a[4 + k] = _mm512_shuffle_f32x4(x0, y0, 0xdd);
    a[8 + k] = _mm512_shuffle_f32x4(x1, y1, 0x88);
    a[12 + k] = _mm512_shuffle_f32x4(x1, y1, 0xdd);
  }
}
#include "kernels/simd/v16_math.h"
#endif
