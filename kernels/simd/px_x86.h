// SPDX-License-Identifier: Apache-2.0
// Shuffles that the 16-lane vocabulary does not have: interleaved bytes <-> 16-byte planes, and
// sums of neighbours. SSE4.1 instructions, for all x86 variants; px_neon.h says the same.
#ifndef SV_PX_X86_H
#define SV_PX_X86_H
#include <smmintrin.h>
#include <stdint.h>

static inline __m128i px_load_(const uint8_t *p) { return _mm_loadu_si128((const __m128i *)p); }
static inline void px_store_(uint8_t *p, __m128i v) { _mm_storeu_si128((__m128i *)p, v); }

// 16 RGB pixels (48 bytes) -> out[3][16].
static inline void px_split3(const uint8_t *p, uint8_t *out) {
  __m128i a = px_load_(p), b = px_load_(p + 16), c = px_load_(p + 32);
  __m128i r = _mm_or_si128(
      _mm_shuffle_epi8(a, _mm_setr_epi8(0, 3, 6, 9, 12, 15, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1)),
      _mm_or_si128(
          _mm_shuffle_epi8(b, _mm_setr_epi8(-1, -1, -1, -1, -1, -1, 2, 5, 8, 11, 14, -1, -1, -1, -1, -1)),
          _mm_shuffle_epi8(c, _mm_setr_epi8(-1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, 1, 4, 7, 10, 13))));
  __m128i g = _mm_or_si128(
      _mm_shuffle_epi8(a, _mm_setr_epi8(1, 4, 7, 10, 13, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1)),
      _mm_or_si128(
          _mm_shuffle_epi8(b, _mm_setr_epi8(-1, -1, -1, -1, -1, 0, 3, 6, 9, 12, 15, -1, -1, -1, -1, -1)),
          _mm_shuffle_epi8(c, _mm_setr_epi8(-1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, 2, 5, 8, 11, 14))));
  __m128i l = _mm_or_si128(
      _mm_shuffle_epi8(a, _mm_setr_epi8(2, 5, 8, 11, 14, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1)),
      _mm_or_si128(
          _mm_shuffle_epi8(b, _mm_setr_epi8(-1, -1, -1, -1, -1, 1, 4, 7, 10, 13, -1, -1, -1, -1, -1, -1)),
          _mm_shuffle_epi8(c, _mm_setr_epi8(-1, -1, -1, -1, -1, -1, -1, -1, -1, -1, 0, 3, 6, 9, 12, 15))));
  px_store_(out, r);
  px_store_(out + 16, g);
  px_store_(out + 32, l);
}

// 16 RGBA pixels (64 bytes) -> out[4][16].
static inline void px_split4(const uint8_t *p, uint8_t *out) {
  const __m128i by_channel = _mm_setr_epi8(0, 4, 8, 12, 1, 5, 9, 13, 2, 6, 10, 14, 3, 7, 11, 15);
  __m128i a = _mm_shuffle_epi8(px_load_(p), by_channel), b = _mm_shuffle_epi8(px_load_(p + 16), by_channel);
  __m128i c = _mm_shuffle_epi8(px_load_(p + 32), by_channel),
          d = _mm_shuffle_epi8(px_load_(p + 48), by_channel);
  __m128i ab0 = _mm_unpacklo_epi32(a, b), ab1 = _mm_unpackhi_epi32(a, b);
  __m128i cd0 = _mm_unpacklo_epi32(c, d), cd1 = _mm_unpackhi_epi32(c, d);
  px_store_(out, _mm_unpacklo_epi64(ab0, cd0));
  px_store_(out + 16, _mm_unpackhi_epi64(ab0, cd0));
  px_store_(out + 32, _mm_unpacklo_epi64(ab1, cd1));
  px_store_(out + 48, _mm_unpackhi_epi64(ab1, cd1));
}

// 32 bytes -> the 16 even ones, the 16 odd ones.
static inline void px_split2(const uint8_t *p, uint8_t *out) {
  const __m128i by_parity = _mm_setr_epi8(0, 2, 4, 6, 8, 10, 12, 14, 1, 3, 5, 7, 9, 11, 13, 15);
  __m128i a = _mm_shuffle_epi8(px_load_(p), by_parity), b = _mm_shuffle_epi8(px_load_(p + 16), by_parity);
  px_store_(out, _mm_unpacklo_epi64(a, b));
  px_store_(out + 16, _mm_unpackhi_epi64(a, b));
}

// even[16] and odd[16] alternating, in two halves of 16.
static inline void px_zip2(const uint8_t *even, const uint8_t *odd, uint8_t *low, uint8_t *high) {
  __m128i a = px_load_(even), b = px_load_(odd);
  px_store_(low, _mm_unpacklo_epi8(a, b));
  px_store_(high, _mm_unpackhi_epi8(a, b));
}

// in[3][16] -> 16 RGB pixels (48 bytes).
static inline void px_join3(const uint8_t *in, uint8_t *p) {
  __m128i r = px_load_(in), g = px_load_(in + 16), b = px_load_(in + 32);
  px_store_(p, _mm_or_si128(_mm_shuffle_epi8(
                                r, _mm_setr_epi8(0, -1, -1, 1, -1, -1, 2, -1, -1, 3, -1, -1, 4, -1, -1, 5)),
                            _mm_or_si128(_mm_shuffle_epi8(g, _mm_setr_epi8(-1, 0, -1, -1, 1, -1, -1, 2, -1,
                                                                           -1, 3, -1, -1, 4, -1, -1)),
                                         _mm_shuffle_epi8(b, _mm_setr_epi8(-1, -1, 0, -1, -1, 1, -1, -1, 2,
                                                                           -1, -1, 3, -1, -1, 4, -1)))));
  px_store_(p + 16,
            _mm_or_si128(_mm_shuffle_epi8(
                             r, _mm_setr_epi8(-1, -1, 6, -1, -1, 7, -1, -1, 8, -1, -1, 9, -1, -1, 10, -1)),
                         _mm_or_si128(_mm_shuffle_epi8(g, _mm_setr_epi8(5, -1, -1, 6, -1, -1, 7, -1, -1, 8,
                                                                        -1, -1, 9, -1, -1, 10)),
                                      _mm_shuffle_epi8(b, _mm_setr_epi8(-1, 5, -1, -1, 6, -1, -1, 7, -1, -1,
                                                                        8, -1, -1, 9, -1, -1)))));
  px_store_(p + 32,
            _mm_or_si128(_mm_shuffle_epi8(r, _mm_setr_epi8(-1, 11, -1, -1, 12, -1, -1, 13, -1, -1, 14, -1, -1,
                                                           15, -1, -1)),
                         _mm_or_si128(_mm_shuffle_epi8(g, _mm_setr_epi8(-1, -1, 11, -1, -1, 12, -1, -1, 13,
                                                                        -1, -1, 14, -1, -1, 15, -1)),
                                      _mm_shuffle_epi8(b, _mm_setr_epi8(10, -1, -1, 11, -1, -1, 12, -1, -1,
                                                                        13, -1, -1, 14, -1, -1, 15)))));
}

// out[i] = p[2i] + p[2i+1] for i < 16; out may be p.
static inline void px_pair_sum(const float *p, float *out) {
  for (int i = 0; i < 16; i += 4)
    _mm_storeu_ps(out + i, _mm_hadd_ps(_mm_loadu_ps(p + 2 * i), _mm_loadu_ps(p + 2 * i + 4)));
}
#endif
