// SPDX-License-Identifier: Apache-2.0
#include "kernels/sort/sort.h"

#include <string.h>

enum { CAP_PASSES = 3 };

typedef struct {
  uint32_t min, mask;
  int width, n_passes;
} digits;

static digits digits_of(uint32_t min, uint32_t max) {
  int bits = max > min ? 32 - __builtin_clz(max - min) : 1, n_passes = (bits + 10) / 11;
  int width = (bits + n_passes - 1) / n_passes;
  return (digits){min, (1u << width) - 1, width, n_passes};
}

// Histograms of all digits, read once. n_passes is a constant where this is called. Memory that the passes will write
// here and there is fetched meanwhile, as nobody could foresee where.
static inline void count(const sv_sort_args *a, const digits *d, int n_passes) {
  const uint32_t min = d->min, mask = d->mask;
  const int width = d->width;
  uint32_t *hist[CAP_PASSES];
  uint32_t n = 0;
  for (int p = 0; p < n_passes; p++) hist[p] = a->hist + (size_t)p * ((size_t)mask + 1);
  for (uint32_t r = 0; r < a->n_runs; r++) {
    const sv_pair *run = a->run + (size_t)r * a->stride, *end = run + a->n_in_run[r];
    for (; run < end; run++, n++) {
      uint32_t key = run->key - min;
      if (n % 8 == 0) {
        if (n_passes > 1) __builtin_prefetch(a->tmp + n, 1);
        __builtin_prefetch(a->order + n, 1);
      }
      for (int p = 0; p < n_passes; p++) hist[p][key >> p * width & mask]++;
    }
  }
}

// Where each bucket begins; returns the number of pairs.
static uint32_t add_up(uint32_t *hist, uint32_t n_buckets) {
  uint32_t sum = 0;
  for (uint32_t i = 0; i < n_buckets; i++) {
    uint32_t c = hist[i];
    hist[i] = sum;
    sum += c;
  }
  return sum;
}

static uint32_t find_places(const sv_sort_args *a, const digits *d) {
  const uint32_t n_buckets = d->mask + 1;
  uint32_t n = 0;
  memset(a->hist, 0, (size_t)n_buckets * (size_t)d->n_passes * sizeof *a->hist);
  if (d->n_passes == 1) count(a, d, 1);
  else if (d->n_passes == 2) count(a, d, 2);
  else count(a, d, 3);
  for (int p = 0; p < d->n_passes; p++) n = add_up(a->hist + (size_t)p * n_buckets, n_buckets);
  return n;
}

// One pass over n pairs; `to`, or the values alone to `order`.
static void pass(const sv_pair *from, uint32_t n, const digits *d, int p, uint32_t *hist, sv_pair *to,
                 uint32_t *order) {
  const int shift = p * d->width;
  const uint32_t min = d->min, mask = d->mask;
  if (to)
    for (uint32_t i = 0; i < n; i++) to[hist[(from[i].key - min) >> shift & mask]++] = from[i];
  else
    for (uint32_t i = 0; i < n; i++) order[hist[(from[i].key - min) >> shift & mask]++] = from[i].value;
}

uint32_t sv_sort_ref(const sv_sort_args *a) {
  const digits d = digits_of(a->min_key, a->max_key);
  const uint32_t n = find_places(a, &d);
  sv_pair *to = d.n_passes > 1 ? a->tmp : NULL;
  for (uint32_t r = 0; r < a->n_runs; r++)
    pass(a->run + (size_t)r * a->stride, a->n_in_run[r], &d, 0, a->hist, to, a->order);
  for (int p = 1; p < d.n_passes; p++) { // the runs are not needed any more
    sv_pair *from = to;
    to = p == d.n_passes - 1 ? NULL : from == a->tmp ? a->run : a->tmp;
    pass(from, n, &d, p, a->hist + ((size_t)d.mask + 1) * (size_t)p, to, a->order);
  }
  return n;
}
