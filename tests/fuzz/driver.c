// SPDX-License-Identifier: Apache-2.0
// fuzz_X [-n MUTATIONS] [-s SEED] [FILES...]: runs the target on its built-in seeds and on the files, then
// on mutations of them. The same arguments give the same inputs on every machine. Each input lies in a
// block of exactly its size, so that the address sanitizer sees a read behind it. A crash leaves the input
// in ./crash-<name> when the environment variable FUZZ_KEEP is set.
#include <stdio.h>
#include <string.h>

#include "tests/fuzz/fuzz.h"

enum { CAP_SEEDS = 256, CAP_BYTES = 1 << 16 };
typedef struct {
  uint8_t *data;
  size_t n;
} input;
static input seeds[CAP_SEEDS];
static int n_seeds;

static uint64_t rng_state;
static uint32_t rnd(uint32_t n) { // 0..n-1
  rng_state ^= rng_state << 13, rng_state ^= rng_state >> 7, rng_state ^= rng_state << 17;
  return n ? (uint32_t)((rng_state >> 11) % n) : 0;
}

static void add_seed(const uint8_t *data, size_t n) {
  if (n_seeds == CAP_SEEDS) return;
  uint8_t *copy = malloc(n ? n : 1);
  if (!copy) exit(1);
  memcpy(copy, data, n);
  seeds[n_seeds++] = (input){copy, n};
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
  if (n + m > CAP_BYTES) return n;
  memmove(b + at + m, b + at, n - at);
  memmove(b + at, from, m);
  return n + m;
}

static size_t mutate(uint8_t *b, size_t n) {
  static uint8_t part[CAP_BYTES];
  uint32_t at = rnd((uint32_t)n + 1);
  if (at == n && n && rnd(4)) at = rnd((uint32_t)n);
  switch (rnd(10)) {
  case 0:
  case 1:
    if (at < n) b[at] ^= (uint8_t)(1u << rnd(8));
    return n;
  case 2:
    if (at < n) b[at] = (uint8_t)rnd(256);
    return n;
  case 3: { // a number at any alignment becomes an extreme one
    static const uint64_t extremes[] = {
        0,         1, 0x7F, 0xFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 0x7FF0000000000000, 0xFFFFFFFFFFFFFFFF,
        0x7F800000};
    uint64_t v = extremes[rnd(10)];
    size_t m = (size_t)1 << rnd(4);
    for (size_t i = 0; i < m && at + i < n; i++) b[at + i] = (uint8_t)(v >> (8 * i));
    return n;
  }
  case 4: return at; // cut
  case 5: {          // take a piece out
    size_t m = rnd((uint32_t)(n - at) + 1);
    if (rnd(2) && m > 8) m = rnd(8);
    memmove(b + at, b + at + m, n - at - m);
    return n - m;
  }
  case 6: { // double a piece
    size_t m = rnd((uint32_t)(n - at) + 1);
    if (rnd(2) && m > 64) m = rnd(64);
    memcpy(part, b + at, m);
    return insert(b, n, rnd((uint32_t)n + 1), part, m);
  }
  case 7: { // a piece of another seed
    const input *o = &seeds[rnd((uint32_t)n_seeds)];
    uint32_t from = rnd((uint32_t)o->n + 1);
    size_t m = rnd((uint32_t)(o->n - from) + 1);
    if (m > CAP_BYTES) return n;
    return insert(b, n, at, o->data + from, m);
  }
  default: {
    const char *w = words[rnd(sizeof words / sizeof *words)];
    return insert(b, n, at, (const uint8_t *)w, strlen(w));
  }
  }
}

static void run_one(const uint8_t *data, size_t n, const char *keep) {
  uint8_t *exact = malloc(n ? n : 1);
  if (!exact) exit(1);
  memcpy(exact, data, n);
  if (keep) { // written before the run: after a crash it is too late
    FILE *f = fopen(keep, "wb");
    if (f) {
      (void)!fwrite(data, 1, n, f);
      fclose(f);
    }
  }
  (void)LLVMFuzzerTestOneInput(exact, n);
  free(exact);
}

int main(int argc, char **argv) {
  static uint8_t b[CAP_BYTES];
  long n_mutations = 20000;
  char keep[256] = "";
  const char *slash = strrchr(argv[0], '/');
  rng_state = 0x9E3779B97F4A7C15;
  if (getenv("FUZZ_KEEP")) snprintf(keep, sizeof keep, "crash-%s", slash ? slash + 1 : argv[0]);
  for (int i = 0; i < CAP_SEEDS; i++) {
    size_t n = fuzz_seed(i, b, sizeof b);
    if (!n) break;
    add_seed(b, n);
  }
  for (int i = 1; i < argc; i++) {
    if (strcmp(argv[i], "-n") == 0 && i + 1 < argc) n_mutations = atol(argv[++i]);
    else if (strcmp(argv[i], "-s") == 0 && i + 1 < argc)
      rng_state += (uint64_t)atol(argv[++i]) * 0xD1B54A32D192ED03u | 1;
    else {
      FILE *f = fopen(argv[i], "rb");
      if (!f) {
        fprintf(stderr, "%s: cannot open\n", argv[i]);
        return 1;
      }
      add_seed(b, fread(b, 1, sizeof b, f));
      fclose(f);
    }
  }
  for (int i = 0; i < n_seeds; i++) run_one(seeds[i].data, seeds[i].n, keep[0] ? keep : NULL);
  for (long k = 0; k < n_mutations && n_seeds; k++) {
    const input *s = &seeds[rnd((uint32_t)n_seeds)];
    size_t n = s->n;
    memcpy(b, s->data, n);
    for (uint32_t i = 0, m = 1 + rnd(6); i < m; i++) n = mutate(b, n);
    run_one(b, n, keep[0] ? keep : NULL);
  }
  if (keep[0]) remove(keep);
  for (int i = 0; i < n_seeds; i++) free(seeds[i].data);
  printf("%d seeds, %ld mutations, no finding\n", n_seeds, n_mutations);
  return 0;
}
