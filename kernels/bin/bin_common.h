// SPDX-License-Identifier: Apache-2.0
// What the reference and the vector form of `bin` share: the records of one splat.
#ifndef SV_KERNELS_BIN_COMMON_H
#define SV_KERNELS_BIN_COMMON_H

#include "kernels/project/project.h"

// Empty records of a splat, tiles row by row.
static inline void bin_clear(const sv_splat *s, uint32_t id, int n_tiles_x, sv_rec *rec) {
  sv_rec *r = rec + s->first_rec;
  for (int ty = s->by0 >> 3; ty <= s->by1 >> 3; ty++)
    for (int tx = s->bx0 >> 3; tx <= s->bx1 >> 3; tx++)
      *r++ = (sv_rec){(uint32_t)(ty * n_tiles_x + tx), id, 0};
}

// From a real column to the first or last pixel inside: 0.99 to round up, less 0.5 for the pixel's centre;
// 0.02 px of slack cover rounding errors.
#define BIN_ROUND_LO (0.99f - 0.5f - 0.02f)
#define BIN_ROUND_HI (-0.5f + 0.02f)

typedef struct {
  float min, max; // pixel columns of the splat's blocks: [min, max)
  float dy_right; // height (v minus y) of the ellipse's rightmost point; the leftmost is at its negative
} bin_bounds;

static inline bin_bounds bin_bounds_of(const sv_splat *s) {
  bin_bounds b = {(float)(4 * s->bx0), (float)(4 * s->bx1 + 4), s->qb * s->ex_px / (2.0f * s->qc)};
  return b;
}

// Marks blocks c0..c1 of block row `row`.
static inline void bin_mark(const sv_splat *s, int row, int c0, int c1, sv_rec *rec) {
  int tx0 = s->bx0 >> 3, n_x = (s->bx1 >> 3) - tx0 + 1, shift = 8 * (row & 7);
  sv_rec *r = rec + s->first_rec + ((row >> 3) - (s->by0 >> 3)) * n_x - tx0;
  for (int tx = c0 >> 3; tx < c1 >> 3; tx++, c0 = 8 * tx)
    r[tx].mask |= (uint64_t)(0x100u - (1u << (c0 & 7))) << shift;
  r[c1 >> 3].mask |= (uint64_t)((2u << (c1 & 7)) - (1u << (c0 & 7))) << shift;
}

#endif
