// SPDX-License-Identifier: Apache-2.0
#include <stdlib.h>
#include <string.h>

#include "tests/kernels/check.h"

enum { EQUAL, TWO, BITS_12, BITS_13, BITS_24, BITS_25, BITS_32, DEPTHS, FALLING, RISING, CROWDED, N_KEYS };

static uint32_t depth_bits(float z) {
  uint32_t b;
  memcpy(&b, &z, 4);
  return b;
}

static uint32_t make_key(ck *c, int kind, uint32_t i) {
  uint32_t r = sv_rng_u32(&c->rng);
  switch (kind) {
  case EQUAL: return 0x40000000;
  case TWO: return r & 1 ? 0xffffffff : 0;
  case BITS_12: return 77 + (r & 0xfff);
  case BITS_13: return 77 + (r & 0x1fff);
  case BITS_24: return r & 0xffffff;
  case BITS_25: return 0x80000000 + (r & 0x1ffffff);
  case BITS_32: return r;
  case FALLING: return 1000000 - 3 * (i / 2);
  case RISING: return 5 * (i / 3);
  case CROWDED: return i ? 0x3f000000 + (r & 0x3ff) : UINT32_MAX; // leading bits tell nothing
  default: return depth_bits(0.5f + 4.0f * sv_rng_f(&c->rng));
  }
}

static int by_key_then_value(const void *a, const void *b) {
  const sv_pair *p = a, *q = b;
  if (p->key != q->key) return p->key < q->key ? -1 : 1;
  return p->value < q->value ? -1 : p->value > q->value;
}

static void sort(ck *c, const sv_pair *in, uint32_t n, uint32_t *order) {
  sv_sort_args a = {.pair = ck_bytes(c, n * sizeof(sv_pair)),
                    .n = n,
                    .tmp = ck_bytes(c, n * sizeof(sv_pair)),
                    .hist = ck_bytes(c, SV_SORT_CAP_BUCKETS * sizeof(uint32_t)),
                    .order = order};
  for (uint32_t i = 0; i < n; i++) a.pair[i] = in[i];
  c->var.sort(&a);
}

static void check_sort(ck *c) {
  // Variants sort 256 words at a time; of what is left little and much.
  static const uint32_t sizes[] = {0,   1,   2,   3,   7,   16,  17,  24,  25,   26,   100,  112,
                                   113, 255, 256, 257, 368, 369, 512, 777, 1000, 4096, 4097, 20000};
  for (size_t s = 0; s < sizeof sizes / sizeof *sizes; s++)
    for (int kind = 0; kind < N_KEYS; kind++) {
      uint32_t n = sizes[s];
      ck_begin(c, "n %u keys %d", n, kind);
      sv_pair *in = ck_bytes(c, n * sizeof *in), *want = ck_bytes(c, n * sizeof *in);
      for (uint32_t i = 0; i < n; i++) want[i] = in[i] = (sv_pair){make_key(c, kind, i), i};
      // values rise in the input: stable = this order
      if (n) qsort(want, n, sizeof *want, by_key_then_value);
      uint32_t *order = ck_bytes(c, n * sizeof *order);
      sort(c, in, n, order);
      for (uint32_t i = 0; i < n; i++) ck_true(c, order[i] == want[i].value, "rank %u: %u", i, order[i]);
    }
}

enum { N_BENCH = 100000 };
typedef struct {
  sv_pair *from;
  sv_sort_args a;
} sort_job;

static void run_sort(void *arg, const sv_kernels *k) {
  sort_job *j = arg;
  memcpy(j->a.pair, j->from, N_BENCH * sizeof *j->from);
  k->sort(&j->a);
}

static void bench_sort(ck *c) {
  ck_begin(c, "bench");
  size_t bytes = N_BENCH * sizeof(sv_pair);
  sort_job j = {.from = ck_bytes(c, bytes),
                .a = {.pair = ck_bytes(c, bytes),
                      .n = N_BENCH,
                      .tmp = ck_bytes(c, bytes),
                      .hist = ck_bytes(c, SV_SORT_CAP_BUCKETS * 4),
                      .order = ck_bytes(c, N_BENCH * 4)}};
  for (uint32_t i = 0; i < N_BENCH; i++) j.from[i] = (sv_pair){make_key(c, DEPTHS, i), i};
  ck_time(c, "100000 depths; per key", N_BENCH, run_sort, &j);
}

CK_REGISTER(sort, check_sort, bench_sort)
