// SPDX-License-Identifier: Apache-2.0
// Damaged inputs from good ones: bits, bytes and numbers changed, pieces cut, doubled and
// exchanged. The same seeds and calls give the same inputs on every machine.
#ifndef SV_TESTS_COMMON_MUTATE_H
#define SV_TESTS_COMMON_MUTATE_H

#include <stddef.h>
#include <stdint.h>

#define MUTATE_CAP_SEEDS 256
#define MUTATE_CAP_BYTES (1 << 16)

typedef struct {
  uint8_t *data;
  size_t n;
} mutate_seed;

typedef struct {
  mutate_seed seeds[MUTATE_CAP_SEEDS]; // on the heap, from add to close
  int n_seeds;
  uint64_t rng_state;
  uint8_t part[MUTATE_CAP_BYTES];
} mutate_pool;

void mutate_open(mutate_pool *p);
void mutate_add(mutate_pool *p, const uint8_t *data, size_t n); // a full pool takes no more
// The next damaged input into b[MUTATE_CAP_BYTES]; its size. No heap call. There must be a seed.
size_t mutate_next(mutate_pool *p, uint8_t *b);
void mutate_close(mutate_pool *p);

#endif
