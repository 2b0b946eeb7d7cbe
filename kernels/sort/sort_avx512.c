// SPDX-License-Identifier: Apache-2.0
#include <immintrin.h>
#include <stdint.h>

#define V(name) name##_avx512

typedef __m512i key16;
static inline key16 key16_load(const int32_t *p) { return _mm512_loadu_si512(p); }
static inline void key16_store(int32_t *p, key16 a) { _mm512_storeu_si512(p, a); }
static inline key16 key16_min(key16 a, key16 b) { return _mm512_min_epi32(a, b); }
static inline key16 key16_max(key16 a, key16 b) { return _mm512_max_epi32(a, b); }
static inline key16 key16_reverse(key16 a) {
  return _mm512_permutexvar_epi32(_mm512_setr_epi32(15, 14, 13, 12, 11, 10, 9, 8, 7, 6, 5, 4, 3, 2, 1, 0), a);
}

// upper: the lanes that take the larger word.
#define STEP(name, upper, other)                                                                             \
  static inline key16 name(key16 a) {                                                                        \
    key16 b = other;                                                                                         \
    return _mm512_mask_max_epi32(_mm512_min_epi32(a, b), upper, a, b);                                       \
  }
STEP(step_1, 0xaaaa, _mm512_shuffle_epi32(a, (_MM_PERM_ENUM)0xb1))
STEP(step_2, 0xcccc, _mm512_shuffle_epi32(a, (_MM_PERM_ENUM)0x4e))
STEP(step_4, 0xf0f0, _mm512_shuffle_i32x4(a, a, 0xb1))
STEP(step_8, 0xff00, _mm512_shuffle_i32x4(a, a, 0x4e))
STEP(flip_3, 0xcccc, _mm512_shuffle_epi32(a, (_MM_PERM_ENUM)0x1b))
STEP(flip_7, 0xf0f0,
     _mm512_permutexvar_epi32(_mm512_setr_epi32(7, 6, 5, 4, 3, 2, 1, 0, 15, 14, 13, 12, 11, 10, 9, 8), a))
STEP(flip_15, 0xff00, key16_reverse(a))
#define flip_1 step_1

#include "kernels/sort/sort_vec.inc"
