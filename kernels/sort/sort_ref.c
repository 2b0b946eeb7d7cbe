// SPDX-License-Identifier: Apache-2.0
#include "kernels/sort/sort.h"
#include "kernels/ops.h"

#include <string.h>

// FEW pairs are sorted by insertion. Buckets of longer digits take longer to add up than lists of
// less than LONG, or MANY, pairs take to be moved. MOVES places a pair and more, and two more
// passes are less work.
enum { CAP_PASSES = 4, FEW = 24, LONG = 1024, MANY = 2048, MOVES = 2 };

typedef struct {
  uint32_t min, mask;
  int shift, width, n_passes; // digits from the bit `shift` on
} digits;

// Bits of the range of the keys, at least 1; n > 0.
static int range_bits(const sv_pair *pair, uint32_t n, uint32_t *min_key) {
  uint32_t min = UINT32_MAX, max = 0;
  for (uint32_t i = 0; i < n; i++) {
    min = pair[i].key < min ? pair[i].key : min;
    max = pair[i].key > max ? pair[i].key : max;
  }
  *min_key = min;
  return max > min ? 32 - __builtin_clz(max - min) : 1;
}

// Of all bits of the range, or of as many of the leading ones as two digits hold.
static digits digits_of(const sv_sort_args *a, const sv_pair *pair, int is_leading) {
  uint32_t min;
  const int bits = range_bits(pair, a->n, &min);
  const int most = a->n >= MANY ? 11 : a->n >= LONG || !is_leading ? 8 : 7;
  const int shift = is_leading && bits > 2 * most ? bits - 2 * most : 0;
  const int n_passes = (bits - shift + most - 1) / most, width = (bits - shift + n_passes - 1) / n_passes;
  return (digits){min, (1u << width) - 1, shift, width, n_passes};
}

// Histograms of all digits, read once. n_passes is a constant where this is called.
static inline void count(const sv_pair *pair, uint32_t n, const digits *d, uint32_t *all, int n_passes) {
  const uint32_t min = d->min, mask = d->mask;
  const int width = d->width, shift = d->shift;
  uint32_t *hist[CAP_PASSES];
  for (int p = 0; p < n_passes; p++) hist[p] = all + (size_t)p * ((size_t)mask + 1);
  for (uint32_t i = 0; i < n; i++) {
    const uint32_t key = (pair[i].key - min) >> shift;
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

static void find_places(const sv_pair *pair, uint32_t n, const digits *d, uint32_t *hist) {
  const uint32_t n_buckets = d->mask + 1;
  memset(hist, 0, (size_t)n_buckets * (size_t)d->n_passes * sizeof *hist);
  if (d->n_passes == 1) count(pair, n, d, hist, 1);
  else if (d->n_passes == 2) count(pair, n, d, hist, 2);
  else if (d->n_passes == 3) count(pair, n, d, hist, 3);
  else count(pair, n, d, hist, 4);
  for (int p = 0; p < d->n_passes; p++) add_up(hist + (size_t)p * n_buckets, n_buckets);
}

// Sorts by the digits; returns which of the two arrays holds the result.
static sv_pair *by_digits(const sv_sort_args *a, sv_pair *from, const digits *d) {
  const uint32_t min = d->min, mask = d->mask;
  find_places(from, a->n, d, a->hist);
  for (int p = 0; p < d->n_passes; p++) {
    sv_pair *to = from == a->pair ? a->tmp : a->pair;
    uint32_t *at = a->hist + ((size_t)mask + 1) * (size_t)p;
    const int shift = d->shift + p * d->width;
    for (uint32_t i = 0; i < a->n; i++) to[at[(from[i].key - min) >> shift & mask]++] = from[i];
    from = to;
  }
  return from;
}

// Sorts the pairs, and puts their values into `order`; gives up after `left` moves, and what it
// leaves is as stable as what it got.
static int by_insertion(sv_pair *pair, uint32_t n, uint64_t left, uint32_t *order) {
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

// Two passes leave few out of place, unless depths crowd in a small part of the range.
void sv_sort_ref(const sv_sort_args *a) {
  sv_pair *sorted = a->pair;
  uint64_t moves = (uint64_t)a->n * a->n;
  if (a->n > FEW) {
    const digits leading = digits_of(a, sorted, 1);
    sorted = by_digits(a, sorted, &leading);
    moves = (uint64_t)a->n * MOVES;
  }
  if (by_insertion(sorted, a->n, moves, a->order)) return;
  const digits all = digits_of(a, sorted, 0);
  sorted = by_digits(a, sorted, &all);
  for (uint32_t i = 0; i < a->n; i++) a->order[i] = sorted[i].value;
}
