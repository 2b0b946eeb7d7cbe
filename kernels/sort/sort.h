// SPDX-License-Identifier: Apache-2.0
// Stable ascending radix sort of (key, value) pairs that lie in runs: depth order of the visible splats.
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
  sv_pair *run;             // n_runs runs, each `stride` pairs after the one before; overwritten
  const uint32_t *n_in_run; // [n_runs] at most stride
  uint32_t n_runs, stride;
  uint32_t min_key, max_key; // of all pairs
  sv_pair *tmp;              // [pairs] scratch
  uint32_t *hist;            // [SV_SORT_CAP_BUCKETS] scratch
  uint32_t *order;           // [pairs] out: values by rising key, equal keys in the order of the runs
} sv_sort_args;

// Digits are at most 11 bits of the range max - min: depth keys (float bits) usually take three passes of 8, which go
// through few enough buckets to stay in the nearest cache. Returns the
// number of pairs. exact.
typedef uint32_t (*sv_sort_fn)(const sv_sort_args *a);

uint32_t sv_sort_ref(const sv_sort_args *a);

#ifdef __cplusplus
}
#endif
#endif
