// SPDX-License-Identifier: Apache-2.0
// What the reference and the vector form of `bin` share: the intersections of one splat.
#ifndef SV_KERNELS_BIN_COMMON_H
#define SV_KERNELS_BIN_COMMON_H

#include "kernels/project/project.h"

// From a real column to the first or last pixel inside: 0.99 to round up, less 0.5 for the pixel's
// centre; 0.02 px of slack cover rounding errors.
#define BIN_ROUND_LO (0.99f - 0.5f - 0.02f)
#define BIN_ROUND_HI (-0.5f + 0.02f)

// Square roots from bits, x to the power of -1/2 by one step of Newton's from an estimate that is
// right to 3.5 %, times x: too small by at most 1.8e-3 of them, and BIN_ROOT_UP makes them too
// large by as much. A vector's true square root takes as long as the rest of a row. Of numbers that
// are not positive the result means nothing.
#define BIN_ROOT_BITS 1597463007.0f // 0x5f3759df
#define BIN_ROOT_UP   1.0018f
#define BIN_ALL       1e30f // a discriminant that reaches all of the bounds

// Block columns from..to - 1 of one row of a tile, 0..8.
static inline uint32_t bin_row_bits(int from, int to) { return from < to ? (1u << to) - (1u << from) : 0; }

static inline int bin_clamp8(int x) { return x < 0 ? 0 : x > 8 ? 8 : x; }

// A splat one block wide or high fills its bounds: its mask in the tile at block (col, row).
static inline int bin_is_bar(const sv_splat *s) { return s->bx0 == s->bx1 || s->by0 == s->by1; }
static inline uint64_t bin_bar(const sv_splat *s, int col, int row) {
  uint64_t bits = bin_row_bits(bin_clamp8(s->bx0 - col), bin_clamp8(s->bx1 + 1 - col));
  int r0 = bin_clamp8(s->by0 - row),
      r1 = bin_clamp8(s->by1 + 1 - row); // r0 < r1: the tile is under the splat
  return bits * 0x0101010101010101u >> 8 * (8 - (r1 - r0)) << 8 * r0;
}

#endif
