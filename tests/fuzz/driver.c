// SPDX-License-Identifier: Apache-2.0
// fuzz_X [-n MUTATIONS] [-s SEED] [FILES...]: runs the target on its built-in seeds and on the
// files, then on mutations of them. The same arguments give the same inputs on every machine. Each
// input lies in a block of exactly its size, so that the address sanitizer sees a read behind it. A
// crash leaves the input in ./crash-<name> when the environment variable FUZZ_KEEP is set.
#include <stdio.h>
#include <string.h>

#include "tests/common/mutate.h"
#include "tests/fuzz/fuzz.h"

#define CAP_BYTES MUTATE_CAP_BYTES
static mutate_pool pool;

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
  mutate_open(&pool);
  if (getenv("FUZZ_KEEP")) snprintf(keep, sizeof keep, "crash-%s", slash ? slash + 1 : argv[0]);
  for (int i = 0; i < MUTATE_CAP_SEEDS; i++) {
    size_t n = fuzz_seed(i, b, sizeof b);
    if (!n) break;
    mutate_add(&pool, b, n);
  }
  for (int i = 1; i < argc; i++) {
    if (strcmp(argv[i], "-n") == 0 && i + 1 < argc) n_mutations = atol(argv[++i]);
    else if (strcmp(argv[i], "-s") == 0 && i + 1 < argc)
      pool.rng_state += (uint64_t)atol(argv[++i]) * 0xD1B54A32D192ED03u | 1;
    else {
      FILE *f = fopen(argv[i], "rb");
      if (!f) {
        fprintf(stderr, "%s: cannot open\n", argv[i]);
        return 1;
      }
      const size_t n = fread(b, 1, sizeof b, f);
      fclose(f);
      run_one(b, n, keep[0] ? keep : NULL); // all, also those that the pool has no room for
      mutate_add(&pool, b, n);
    }
  }
  for (int i = 0; i < pool.n_seeds; i++) run_one(pool.seeds[i].data, pool.seeds[i].n, keep[0] ? keep : NULL);
  for (long k = 0; k < n_mutations && pool.n_seeds; k++) {
    size_t n = mutate_next(&pool, b);
    run_one(b, n, keep[0] ? keep : NULL);
  }
  if (keep[0]) remove(keep);
  printf("%d seeds, %ld mutations, no finding\n", pool.n_seeds, n_mutations);
  mutate_close(&pool);
  return 0;
}
