// SPDX-License-Identifier: Apache-2.0
// PCG32 (M. O'Neill, 2014, "PCG: a family of simple fast space-efficient statistically good
// algorithms"): 64-bit state, one stream per (seed, stream) pair, the same on every machine.
#ifndef SV_BASE_RNG_H
#define SV_BASE_RNG_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  uint64_t state, inc;
} sv_rng;

sv_rng sv_rng_make(uint64_t seed, uint64_t stream);
uint32_t sv_rng_u32(sv_rng *r);
// Uniform in [0, n), without modulo bias; 0 when n is 0.
uint32_t sv_rng_below(sv_rng *r, uint32_t n);
float sv_rng_f(sv_rng *r);      // uniform in [0, 1), 24 bits
float sv_rng_normal(sv_rng *r); // N(0,1), Box-Muller, two draws each
// A stateless hash of three numbers, for noise that must not depend on the order of visits.
static inline uint32_t sv_hash3(uint32_t a, uint32_t b, uint32_t c) {
  uint64_t x = a + 0x9e3779b97f4a7c15ull * ((uint64_t)b + 0x632be59bd9b4e019ull * ((uint64_t)c + 1));
  x ^= x >> 30;
  x *= 0xbf58476d1ce4e5b9ull;
  x ^= x >> 27;
  x *= 0x94d049bb133111ebull;
  return (uint32_t)(x ^ (x >> 31));
}
// About N(0,1) from one hash: the sum of its four bytes (Irwin-Hall), mean 0, variance 1, within
// 3.5.
static inline float sv_hash_normal(uint32_t h) {
  uint32_t s = (h & 255) + (h >> 8 & 255) + (h >> 16 & 255) + (h >> 24);
  return ((float)s - 510.0f) * (1.0f / 147.8f);
}

#ifdef __cplusplus
}
#endif
#endif
