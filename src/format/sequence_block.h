// SPDX-License-Identifier: Apache-2.0
// Blocks of 64 integers of a sequence (sequence.h): a byte with the number of bits and the form,
// then the residuals with so many bits each, low bits first, signs folded (0, -1, 1, -2, ...).
// Never fails on damaged data: sv_sequence_unpack returns 0.
#ifndef SV_FORMAT_SEQUENCE_BLOCK_H
#define SV_FORMAT_SEQUENCE_BLOCK_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define SV_SEQUENCE_BLOCK           64
#define SV_SEQUENCE_HEAD_BYTES      304 // of the section HEAD
#define SV_SEQUENCE_MAX_BITS        30
#define SV_SEQUENCE_BLOCK_MAX_BYTES (1 + 8 * SV_SEQUENCE_MAX_BITS)
#define SV_SEQUENCE_LINEAR          32 // form: predicted from two frames, not from one

typedef struct {
  int32_t value[SV_SEQUENCE_BLOCK]; // to write
  uint32_t folded[SV_SEQUENCE_BLOCK];
  int n_bits;
  bool is_linear;
} sv_sequence_block;

// Rounds to the nearest integer within +-2^26, so that residuals have at most 30 bits.
static inline int32_t sv_sequence_round(float x) {
  const float max = 67108864.0f;
  if (!(x > -max)) return -67108864;
  if (x > max) return 67108864;
  return (int32_t)(x < 0 ? x - 0.5f : x + 0.5f);
}

// Fills folded from value, the values of the frame before and those before them (NULL: none), in
// the form with fewer bits.
void sv_sequence_choose(sv_sequence_block *b, const int32_t *before, const int32_t *earlier);
size_t sv_sequence_pack(const sv_sequence_block *b, uint8_t out[SV_SEQUENCE_BLOCK_MAX_BYTES]);
// Bytes taken, 0 when the data are damaged or end. Fills folded, n_bits, is_linear.
size_t sv_sequence_unpack(sv_sequence_block *b, const uint8_t *data, size_t bytes);
// Value k, from those of the frame before and of the one before that.
static inline int32_t sv_sequence_value(const sv_sequence_block *b, uint32_t k, int32_t before,
                                        int32_t earlier) {
  const uint32_t f = b->folded[k], r = (f >> 1) ^ (0u - (f & 1));
  const uint32_t base = b->is_linear ? 2 * (uint32_t)before - (uint32_t)earlier : (uint32_t)before;
  return (int32_t)(base + r); // wraps on damaged data alone
}

#ifdef __cplusplus
}
#endif
#endif
