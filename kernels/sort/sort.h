// SPDX-License-Identifier: Apache-2.0
// Stable ascending sort of (key, value) pairs: depth order of the splats on a tile.
#ifndef SV_KERNELS_SORT_H
#define SV_KERNELS_SORT_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define SV_SORT_CAP_BUCKETS 6144

typedef struct {
  uint32_t key, value;
} sv_pair;

typedef struct {
  sv_pair *pair; // [n] overwritten
  uint32_t n;
  sv_pair *tmp;    // [n] scratch
  uint32_t *hist;  // [SV_SORT_CAP_BUCKETS] scratch
  uint32_t *order; // [n] out: values by rising key, equal keys in the order in which they came
} sv_sort_args;

// There is one such order, so each variant may sort as it is fastest. The reference: two passes
// over digits of the leading bits of the range of the keys, of at most 8 bits, 11 of long lists;
// what shares them is put in order by insertion, or, if that is much, by passes over all bits.
// exact.
typedef void sv_sort_fn(const sv_sort_args *a);

#ifdef __cplusplus
}
#endif
#endif
