// SPDX-License-Identifier: Apache-2.0
#include "src/format/sequence_block.h"

#include <string.h>

static uint32_t fold(int32_t r) { return (uint32_t)r << 1 ^ (r < 0 ? ~0u : 0u); }

static int bits_of(uint32_t all) {
  int n = 0;
  while (all >> n) n++; // residuals have at most 30 bits
  return n;
}

static int fold_all(const int32_t *value, const int32_t *before, const int32_t *earlier,
                    uint32_t out[SV_SEQUENCE_BLOCK]) {
  uint32_t all = 0;
  for (int k = 0; k < SV_SEQUENCE_BLOCK; k++) {
    const int32_t expected = earlier ? 2 * before[k] - earlier[k] : before ? before[k] : 0;
    out[k] = fold(value[k] - expected);
    all |= out[k];
  }
  return bits_of(all);
}

void sv_sequence_choose(sv_sequence_block *b, const int32_t *before, const int32_t *earlier) {
  uint32_t linear[SV_SEQUENCE_BLOCK];
  b->n_bits = fold_all(b->value, before, NULL, b->folded);
  b->is_linear = false;
  const int n = earlier ? fold_all(b->value, before, earlier, linear) : b->n_bits;
  if (n >= b->n_bits) return;
  memcpy(b->folded, linear, sizeof linear);
  b->n_bits = n;
  b->is_linear = true;
}

size_t sv_sequence_pack(const sv_sequence_block *b, uint8_t out[SV_SEQUENCE_BLOCK_MAX_BYTES]) {
  uint64_t held = 0;
  int n_held = 0;
  uint8_t *p = out;
  *p++ = (uint8_t)(b->n_bits | (b->is_linear ? SV_SEQUENCE_LINEAR : 0));
  for (int k = 0; k < SV_SEQUENCE_BLOCK; k++) {
    held |= (uint64_t)b->folded[k] << n_held;
    for (n_held += b->n_bits; n_held >= 8; n_held -= 8, held >>= 8) *p++ = (uint8_t)held;
  }
  return (size_t)(p - out); // 64 values fill whole bytes
}

size_t sv_sequence_unpack(sv_sequence_block *b, const uint8_t *data, size_t bytes) {
  uint64_t held = 0;
  int n_held = 0;
  if (bytes < 1 || data[0] >= 2 * SV_SEQUENCE_LINEAR) return 0;
  b->n_bits = data[0] & (SV_SEQUENCE_LINEAR - 1);
  b->is_linear = data[0] & SV_SEQUENCE_LINEAR;
  const size_t size = 1 + 8 * (size_t)b->n_bits;
  if (b->n_bits > SV_SEQUENCE_MAX_BITS || size > bytes) return 0;
  data++;
  for (int k = 0; k < SV_SEQUENCE_BLOCK; k++) {
    for (; n_held < b->n_bits; n_held += 8) held |= (uint64_t)*data++ << n_held;
    b->folded[k] = (uint32_t)(held & ((1ull << b->n_bits) - 1));
    held >>= b->n_bits;
    n_held -= b->n_bits;
  }
  return size;
}
