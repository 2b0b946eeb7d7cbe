// SPDX-License-Identifier: Apache-2.0
// `sort` on AVX-512: the network's words for one register of sixteen, and a faster block of 256.
#include <stdint.h>

#include "kernels/simd/v16.h"

typedef __m512i key16;
static inline key16 key16_load(const uint32_t *p) { return _mm512_loadu_si512(p); }
static inline void key16_store(uint32_t *p, key16 a) { _mm512_storeu_si512(p, a); }
static inline key16 key16_set1(uint32_t x) { return _mm512_set1_epi32((int32_t)x); }
static inline key16 key16_min(key16 a, key16 b) { return _mm512_min_epu32(a, b); }
static inline key16 key16_max(key16 a, key16 b) { return _mm512_max_epu32(a, b); }
static inline key16 key16_reverse(key16 a) {
  return _mm512_permutexvar_epi32(_mm512_setr_epi32(15, 14, 13, 12, 11, 10, 9, 8, 7, 6, 5, 4, 3, 2, 1, 0), a);
}

// upper: the lanes that take the larger word.
#define STEP(name, upper, other)                                                                             \
  static inline key16 name(key16 a) {                                                                        \
    key16 b = other;                                                                                         \
    return _mm512_mask_max_epu32(_mm512_min_epu32(a, b), upper, a, b);                                       \
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

// --- 256 words ----------------------------------------

// A block of sixteen vectors, all in registers: the word of place p is in lane p / 16 of the vector
// p % 16, so that most steps order whole vectors, and few lanes within one.
#define HAS_BLOCK 1
enum { BLOCK = 16 };
#define EACH(i) _Pragma("GCC unroll 16") for (int i = 0; i < BLOCK; i++)

// Vectors i and j, i < j: the smaller words to i.
V16_INLINE void order_vectors(key16 v[BLOCK], int i, int j) {
  const key16 a = v[i];
  v[i] = key16_min(a, v[j]);
  v[j] = key16_max(a, v[j]);
}

// Runs of two sorted halves of m vectors, within each lane.
V16_INLINE void join_columns(key16 v[BLOCK], int m) {
  EACH(i) if (!(i & m)) order_vectors(v, i, i ^ (2 * m - 1));
}

V16_INLINE void order_columns(key16 v[BLOCK], int distance) {
  EACH(i) if (!(i & distance)) order_vectors(v, i, i ^ distance);
}

// MIRROR(x): the lanes of x in runs of two halves the other way round. upper: the lanes of the
// second halves.
#define JOIN_LANES(name, upper, MIRROR)                                                                      \
  V16_INLINE void name(key16 v[BLOCK]) {                                                                     \
    _Pragma("GCC unroll 8") for (int i = 0; i < BLOCK / 2; i++) {                                            \
      const key16 a = v[i], b = v[BLOCK - 1 - i], of_a = MIRROR(a), of_b = MIRROR(b);                        \
      v[i] = _mm512_mask_max_epu32(_mm512_min_epu32(a, of_b), upper, a, of_b);                               \
      v[BLOCK - 1 - i] = _mm512_mask_max_epu32(_mm512_min_epu32(b, of_a), upper, b, of_a);                   \
    }                                                                                                        \
  }
#define MIRROR_2(x) _mm512_shuffle_epi32(x, (_MM_PERM_ENUM)0xb1)
#define MIRROR_4(x) _mm512_shuffle_epi32(x, (_MM_PERM_ENUM)0x1b)
#define MIRROR_8(x)                                                                                          \
  _mm512_permutexvar_epi32(_mm512_setr_epi32(7, 6, 5, 4, 3, 2, 1, 0, 15, 14, 13, 12, 11, 10, 9, 8), x)
JOIN_LANES(join_1_lane, 0xaaaa, MIRROR_2)
JOIN_LANES(join_2_lanes, 0xcccc, MIRROR_4)
JOIN_LANES(join_4_lanes, 0xf0f0, MIRROR_8)
JOIN_LANES(join_8_lanes, 0xff00, key16_reverse)

// Runs of 2 m places, m at most 8, whose halves no word has to leave any more.
V16_INLINE void end_columns(key16 v[BLOCK], int m) {
  if (m >= 8) order_columns(v, 8);
  if (m >= 4) order_columns(v, 4);
  if (m >= 2) order_columns(v, 2);
  order_columns(v, 1);
}

static __attribute__((noinline)) void sort_block(uint32_t *w) {
  key16 v[BLOCK];
  v16 out[BLOCK];
  EACH(i) v[i] = key16_load(w + 16 * i);
  join_columns(v, 1);
  join_columns(v, 2);
  end_columns(v, 1);
  join_columns(v, 4);
  end_columns(v, 2);
  join_columns(v, 8);
  end_columns(v, 4);
  join_1_lane(v);
  end_columns(v, 8);
  join_2_lanes(v);
  EACH(i) v[i] = step_1(v[i]);
  end_columns(v, 8);
  join_4_lanes(v);
  EACH(i) v[i] = step_1(step_2(v[i]));
  end_columns(v, 8);
  join_8_lanes(v);
  EACH(i) v[i] = step_1(step_2(step_4(v[i])));
  end_columns(v, 8);
  EACH(i) out[i] = _mm512_castsi512_ps(v[i]);
  v16_transpose(out);
  EACH(i) v16_store((float *)w + 16 * i, out[i]);
}

#include "kernels/sort/sort_network.inc"
