// SPDX-License-Identifier: Apache-2.0
// What each word of the vector vocabulary gives for three vectors, by ISA; check_v16.c compares
// them.
#ifndef SV_TESTS_KERNELS_V16_PROBE_H
#define SV_TESTS_KERNELS_V16_PROBE_H
#include <stdint.h>

#define V16_PROBE_WORDS 84
typedef struct {
  const char *name;
  int has_fma; // SSE4.1 rounds twice: compared with a tolerance there
  int32_t bits[16];
} v16_probe_word;

// Fills words and returns their number. in: [3][16]; block: [16][16] for sum16 and transpose; u8:
// [16].
typedef int v16_probe_fn(const float *in, const float *block, const uint8_t *u8, v16_probe_word *out);
v16_probe_fn v16_probe_ref, v16_probe_sse41, v16_probe_avx2, v16_probe_avx512, v16_probe_neon;
#endif
