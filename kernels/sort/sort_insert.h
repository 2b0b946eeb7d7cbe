// SPDX-License-Identifier: Apache-2.0
#ifndef SV_KERNELS_SORT_INSERT_H
#define SV_KERNELS_SORT_INSERT_H

#include "kernels/sort/sort.h"

// By insertion, and the values to `order`; gives up after `left` moves, and what it leaves is as stable as what it got.
static inline int sort_insert(sv_pair *pair, uint32_t n, uint64_t left, uint32_t *order) {
  for (uint32_t i = 0; i < n; i++) {
    const sv_pair p = pair[i];
    uint32_t k = i;
    for (; k > 0 && pair[k - 1].key > p.key; k--) {
      pair[k] = pair[k - 1];
      order[k] = order[k - 1];
    }
    if (k < i) pair[k] = p;
    order[k] = p.value;
    if (i - k > left) return 0;
    left -= i - k;
  }
  return 1;
}

#endif
