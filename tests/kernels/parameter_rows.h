// SPDX-License-Identifier: Apache-2.0
// The cases of the kernels that move parameters: rows of 16 Gaussians, some of which are touched.
#ifndef SV_TESTS_KERNELS_PARAMETER_ROWS_H
#define SV_TESTS_KERNELS_PARAMETER_ROWS_H

#include "tests/kernels/check.h"

// Checks one case, named already; touched: a bit a Gaussian.
typedef void (*ck_rows_fn)(ck *c, int n_rows, int fill, uint32_t touched);

static inline void ck_each_rows(ck *c, ck_rows_fn fn) {
  static const int rows[] = {1, 2, 14, 23, 38, 59};
  static const uint32_t masks[] = {0xffff, 0, 1, 0x8000, 0x5555, 0xaaaa, 0x00ff, 0xff00, 0x7fff, 0x1248};
  for (size_t r = 0; r < sizeof rows / sizeof *rows; r++)
    for (size_t k = 0; k < sizeof masks / sizeof *masks; k++)
      for (int fill = 0; fill < (c->is_exact ? CK_N_FILLS : CK_DENORM); fill++) {
        ck_begin(c, "rows %d mask %04x %s", rows[r], masks[k], ck_fill_name(fill));
        fn(c, rows[r], fill, masks[k]);
      }
}

static inline float *ck_copy(ck *c, const float *from, size_t n) {
  float *to = ck_floats(c, n);
  for (size_t i = 0; i < n; i++) to[i] = from[i];
  return to;
}

// n_floats [row][16]: those of Gaussians that are not touched are as they were.
static inline void ck_untouched(ck *c, uint32_t touched, const float *before, const float *after,
                                size_t n_floats) {
  for (size_t i = 0; i < n_floats; i++)
    ck_true(c, (touched >> i % 16 & 1) || after[i] == before[i], "lane %zu is not touched, but changed",
            i % 16);
}

#endif
