// SPDX-License-Identifier: Apache-2.0
#include "tests/common/mutate.h"

#include <stdlib.h>
#include <string.h>

static uint32_t rnd(mutate_pool *p, uint32_t n) { // 0..n-1
  p->rng_state ^= p->rng_state << 13;
  p->rng_state ^= p->rng_state >> 7;
  p->rng_state ^= p->rng_state << 17;
  return n ? (uint32_t)((p->rng_state >> 11) % n) : 0;
}

void mutate_open(mutate_pool *p) {
  p->n_seeds = 0;
  p->rng_state = 0x9E3779B97F4A7C15;
}

void mutate_add(mutate_pool *p, const uint8_t *data, size_t n) {
  if (p->n_seeds == MUTATE_CAP_SEEDS) return;
  uint8_t *copy = malloc(n ? n : 1);
  if (!copy) exit(1);
  memcpy(copy, data, n);
  p->seeds[p->n_seeds++] = (mutate_seed){copy, n};
}

void mutate_close(mutate_pool *p) {
  for (int i = 0; i < p->n_seeds; i++) free(p->seeds[i].data);
  p->n_seeds = 0;
}

static const char *const words[] = {"0",
                                    "-1",
                                    "1e999",
                                    "1e-999",
                                    "NaN",
                                    "null",
                                    "99999999999",
                                    "0.5",
                                    "\"",
                                    "\\u0000",
                                    "\\ud800",
                                    "{",
                                    "}",
                                    "[",
                                    "]",
                                    ",",
                                    ":",
                                    "'",
                                    "\n",
                                    " ",
                                    "#",
                                    "inf",
                                    "4294967295",
                                    "-2147483648",
                                    "[[[[[[[[",
                                    "list ",
                                    "element ",
                                    "end_header\n",
                                    "property float x\n",
                                    "/",
                                    "..",
                                    "'''",
                                    "b'",
                                    "(",
                                    ")",
                                    "OPENCV"};

static size_t insert(uint8_t *b, size_t n, size_t at, const uint8_t *from, size_t m) {
  if (n + m > MUTATE_CAP_BYTES) return n;
  memmove(b + at + m, b + at, n - at);
  memmove(b + at, from, m);
  return n + m;
}

static size_t mutate(mutate_pool *p, uint8_t *b, size_t n) {
  uint8_t *part = p->part;
  uint32_t at = rnd(p, (uint32_t)n + 1);
  if (at == n && n && rnd(p, 4)) at = rnd(p, (uint32_t)n);
  switch (rnd(p, 10)) {
  case 0:
  case 1:
    if (at < n) b[at] ^= (uint8_t)(1u << rnd(p, 8));
    return n;
  case 2:
    if (at < n) b[at] = (uint8_t)rnd(p, 256);
    return n;
  case 3: { // a number at any alignment becomes an extreme one
    static const uint64_t extremes[] = {
        0,         1, 0x7F, 0xFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 0x7FF0000000000000, 0xFFFFFFFFFFFFFFFF,
        0x7F800000};
    uint64_t v = extremes[rnd(p, 10)];
    size_t m = (size_t)1 << rnd(p, 4);
    for (size_t i = 0; i < m && at + i < n; i++) b[at + i] = (uint8_t)(v >> (8 * i));
    return n;
  }
  case 4: return at; // cut
  case 5: {          // take a piece out
    size_t m = rnd(p, (uint32_t)(n - at) + 1);
    if (rnd(p, 2) && m > 8) m = rnd(p, 8);
    memmove(b + at, b + at + m, n - at - m);
    return n - m;
  }
  case 6: { // double a piece
    size_t m = rnd(p, (uint32_t)(n - at) + 1);
    if (rnd(p, 2) && m > 64) m = rnd(p, 64);
    memcpy(part, b + at, m);
    return insert(b, n, rnd(p, (uint32_t)n + 1), part, m);
  }
  case 7: { // a piece of another seed
    const mutate_seed *o = &p->seeds[rnd(p, (uint32_t)p->n_seeds)];
    uint32_t from = rnd(p, (uint32_t)o->n + 1);
    size_t m = rnd(p, (uint32_t)(o->n - from) + 1);
    if (m > MUTATE_CAP_BYTES) return n;
    return insert(b, n, at, o->data + from, m);
  }
  default: {
    const char *w = words[rnd(p, sizeof words / sizeof *words)];
    return insert(b, n, at, (const uint8_t *)w, strlen(w));
  }
  }
}

size_t mutate_next(mutate_pool *p, uint8_t *b) {
  const mutate_seed *s = &p->seeds[rnd(p, (uint32_t)p->n_seeds)];
  size_t n = s->n;
  memcpy(b, s->data, n);
  for (uint32_t i = 0, m = 1 + rnd(p, 6); i < m; i++) n = mutate(p, b, n);
  return n;
}
