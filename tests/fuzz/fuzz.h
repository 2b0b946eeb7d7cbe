// SPDX-License-Identifier: Apache-2.0
// What a fuzz target gives: the standard entry point, and built-in seeds so that it needs no files.
// Under libFuzzer only LLVMFuzzerTestOneInput counts (build without driver.c); driver.c is a small
// main() that replays files and runs a fixed number of repeatable mutations, for compilers without
// libFuzzer.
#ifndef SV_TESTS_FUZZ_FUZZ_H
#define SV_TESTS_FUZZ_FUZZ_H

#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

#ifdef __cplusplus
extern "C" {
#endif

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t bytes);
// Writes seed i into buf[cap] and returns its size; 0 after the last.
size_t fuzz_seed(int i, uint8_t *buf, size_t cap);

// A promise of the parser that must hold for every input.
#define FUZZ_CHECK(cond)                                                                                     \
  do {                                                                                                       \
    if (!(cond)) abort();                                                                                    \
  } while (0)

#ifdef __cplusplus
}
#endif
#endif
