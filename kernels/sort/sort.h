// SPDX-License-Identifier: Apache-2.0
// Stable ascending radix sort of (key, value) pairs: depth order of the visible splats.
#ifndef SV_KERNELS_SORT_H
#define SV_KERNELS_SORT_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define SV_SORT_CAP_BUCKETS 4096

typedef struct {
  uint32_t key, value;
} sv_pair;

// Sorts pair[n] in place, using tmp[n] and hist[SV_SORT_CAP_BUCKETS] as scratch. Digits are at most 12 bits
// of the range max - min, so depth keys (float bits) usually take two passes. exact.
typedef void (*sv_sort_fn)(sv_pair *pair, sv_pair *tmp, uint32_t n, uint32_t *hist);

void sv_sort_ref(sv_pair *pair, sv_pair *tmp, uint32_t n, uint32_t *hist);

#ifdef __cplusplus
}
#endif
#endif
