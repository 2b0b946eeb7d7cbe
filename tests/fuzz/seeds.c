// SPDX-License-Identifier: Apache-2.0
// Beside libFuzzer's main: with FUZZ_SEEDS_TO=DIR the target writes its built-in seeds there and
// ends.
#include <stdio.h>

#include "tests/fuzz/fuzz.h"

int LLVMFuzzerInitialize(int *argc, char ***argv);
int LLVMFuzzerInitialize(int *argc, char ***argv) {
  static uint8_t buf[1 << 16];
  const char *dir = getenv("FUZZ_SEEDS_TO");
  (void)argc;
  (void)argv;
  if (!dir) return 0;
  for (int i = 0;; i++) {
    char path[600];
    const size_t n = fuzz_seed(i, buf, sizeof buf);
    if (!n) exit(0);
    snprintf(path, sizeof path, "%s/seed_%d", dir, i);
    FILE *f = fopen(path, "wb");
    if (!f || fwrite(buf, 1, n, f) != n || fclose(f) != 0) exit(1);
  }
}
