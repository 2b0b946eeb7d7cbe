// SPDX-License-Identifier: Apache-2.0
#include "kernels/sort/sort.h"

#include <string.h>

static void pass(const sv_pair *src, sv_pair *dst, uint32_t n, uint32_t min, int shift, uint32_t mask,
                 uint32_t *hist) {
  memset(hist, 0, ((size_t)mask + 1) * sizeof *hist);
  for (uint32_t i = 0; i < n; i++) hist[(src[i].key - min) >> shift & mask]++;
  uint32_t sum = 0;
  for (uint32_t i = 0; i <= mask; i++) {
    uint32_t c = hist[i];
    hist[i] = sum;
    sum += c;
  }
  for (uint32_t i = 0; i < n; i++) dst[hist[(src[i].key - min) >> shift & mask]++] = src[i];
}

void sv_sort_ref(sv_pair *pair, sv_pair *tmp, uint32_t n, uint32_t *hist) {
  uint32_t min = UINT32_MAX, max = 0;
  for (uint32_t i = 0; i < n; i++) {
    min = pair[i].key < min ? pair[i].key : min;
    max = pair[i].key > max ? pair[i].key : max;
  }
  if (n < 2 || min == max) return;
  int bits = 32 - __builtin_clz(max - min), n_passes = (bits + 11) / 12,
      width = (bits + n_passes - 1) / n_passes;
  uint32_t mask = (1u << width) - 1;
  sv_pair *src = pair, *dst = tmp;
  for (int p = 0; p < n_passes; p++) {
    pass(src, dst, n, min, p * width, mask, hist);
    sv_pair *t = src;
    src = dst;
    dst = t;
  }
  if (src != pair) memcpy(pair, src, n * sizeof *pair);
}
