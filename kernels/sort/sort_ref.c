// SPDX-License-Identifier: Apache-2.0
#include "kernels/sort/sort.h"

#include <string.h>

// FEW pairs are sorted by insertion; of fewer than MANY, adding up the buckets of long digits would take longest.
enum { CAP_PASSES = 4, FEW = 24, MANY = 2048 };

typedef struct {
  uint32_t min, mask;
  int width, n_passes;
} digits;

static digits digits_of(uint32_t n, uint32_t min, uint32_t max) {
  const int most = n < MANY ? 8 : 11;
  int bits = max > min ? 32 - __builtin_clz(max - min) : 1, n_passes = (bits + most - 1) / most;
  int width = (bits + n_passes - 1) / n_passes;
  return (digits){min, (1u << width) - 1, width, n_passes};
}

// Histograms of all digits, read once. n_passes is a constant where this is called.
static inline void count(const sv_sort_args *a, const digits *d, int n_passes) {
  const uint32_t min = d->min, mask = d->mask;
  const int width = d->width;
  uint32_t *hist[CAP_PASSES];
  for (int p = 0; p < n_passes; p++) hist[p] = a->hist + (size_t)p * ((size_t)mask + 1);
  for (uint32_t i = 0; i < a->n; i++) {
    const uint32_t key = a->pair[i].key - min;
    for (int p = 0; p < n_passes; p++) hist[p][key >> p * width & mask]++;
  }
}

// Where each bucket begins.
static void add_up(uint32_t *hist, uint32_t n_buckets) {
  uint32_t sum = 0;
  for (uint32_t i = 0; i < n_buckets; i++) {
    uint32_t c = hist[i];
    hist[i] = sum;
    sum += c;
  }
}

static void find_places(const sv_sort_args *a, const digits *d) {
  const uint32_t n_buckets = d->mask + 1;
  memset(a->hist, 0, (size_t)n_buckets * (size_t)d->n_passes * sizeof *a->hist);
  if (d->n_passes == 1) count(a, d, 1);
  else if (d->n_passes == 2) count(a, d, 2);
  else if (d->n_passes == 3) count(a, d, 3);
  else count(a, d, 4);
  for (int p = 0; p < d->n_passes; p++) add_up(a->hist + (size_t)p * n_buckets, n_buckets);
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

static void insert(const sv_sort_args *a) {
  sv_pair *pair = a->pair;
  for (uint32_t i = 1; i < a->n; i++) {
    const sv_pair p = pair[i];
    uint32_t k = i;
    for (; k > 0 && pair[k - 1].key > p.key; k--) pair[k] = pair[k - 1];
    pair[k] = p;
  }
  for (uint32_t i = 0; i < a->n; i++) a->order[i] = pair[i].value;
}

void sv_sort_ref(const sv_sort_args *a) {
  if (a->n <= FEW) {
    insert(a);
    return;
  }
  const digits d = digits_of(a->n, a->min_key, a->max_key);
  find_places(a, &d);
  sv_pair *from = a->pair;
  for (int p = 0; p < d.n_passes; p++) {
    sv_pair *to = p == d.n_passes - 1 ? NULL : from == a->pair ? a->tmp : a->pair;
    pass(from, a->n, &d, p, a->hist + ((size_t)d.mask + 1) * (size_t)p, to, a->order);
    from = to;
  }
}
