// SPDX-License-Identifier: Apache-2.0
// `sort` on AVX2: the network's words for two registers of eight.
#include <immintrin.h>
#include <stdint.h>

#include "kernels/simd/v16.h"

typedef struct {
  __m256i a, b; // lanes 0-7, 8-15
} key16;
static inline key16 key16_make(__m256i a, __m256i b) {
  key16 r = {a, b};
  return r;
}
static inline key16 key16_load(const uint32_t *p) {
  return key16_make(_mm256_loadu_si256((const __m256i *)p), _mm256_loadu_si256((const __m256i *)(p + 8)));
}
static inline void key16_store(uint32_t *p, key16 x) {
  _mm256_storeu_si256((__m256i *)p, x.a);
  _mm256_storeu_si256((__m256i *)(p + 8), x.b);
}
static inline key16 key16_min(key16 x, key16 y) {
  return key16_make(_mm256_min_epu32(x.a, y.a), _mm256_min_epu32(x.b, y.b));
}
static inline key16 key16_max(key16 x, key16 y) {
  return key16_make(_mm256_max_epu32(x.a, y.a), _mm256_max_epu32(x.b, y.b));
}
static inline __m256i reverse8(__m256i a) {
  return _mm256_permutevar8x32_epi32(a, _mm256_setr_epi32(7, 6, 5, 4, 3, 2, 1, 0));
}
static inline key16 key16_reverse(key16 x) { return key16_make(reverse8(x.b), reverse8(x.a)); }

// upper: the lanes of a half that take the larger word.
#define ORDER(x, y, upper) _mm256_blend_epi32(_mm256_min_epu32(x, y), _mm256_max_epu32(x, y), upper)
#define STEP(name, upper, other)                                                                             \
  static inline __m256i name##_half(__m256i a) { return ORDER(a, other, upper); }                            \
  static inline key16 name(key16 x) { return key16_make(name##_half(x.a), name##_half(x.b)); }
STEP(step_1, 0xaa, _mm256_shuffle_epi32(a, 0xb1))
STEP(step_2, 0xcc, _mm256_shuffle_epi32(a, 0x4e))
STEP(step_4, 0xf0, _mm256_permute2x128_si256(a, a, 0x01))
STEP(flip_3, 0xcc, _mm256_shuffle_epi32(a, 0x1b))
STEP(flip_7, 0xf0, reverse8(a))
#define flip_1 step_1
static inline key16 step_8(key16 x) {
  return key16_make(_mm256_min_epu32(x.a, x.b), _mm256_max_epu32(x.a, x.b));
}
static inline key16 flip_15(key16 x) {
  const __m256i b = reverse8(x.b);
  return key16_make(_mm256_min_epu32(x.a, b), reverse8(_mm256_max_epu32(x.a, b)));
}

#include "kernels/sort/sort_network.inc"
