// SPDX-License-Identifier: Apache-2.0
#include "kernels/bin/bin.h"

#include <string.h>

#include "kernels/bin/bin_common.h"
#include "kernels/simd/s1_math.h"
#include "kernels/ops.h"

// The ellipse, its columns in blocks from the first tile's first one on.
typedef struct {
  float k, l; // discriminant k dy^2 + l
  // edges: lo + b dy + r root, and hi + b dy - r root, the discriminant's root; r < 0
  float b, lo, hi, r;
} ellipse;

static ellipse ellipse_of(const sv_splat *s) {
  const float m4a = -4.0f * s->qa, r = 0.25f * s->inv_2qa, col = (float)(s->bx0 & ~7);
  return (ellipse){.k = fmaf(s->qb, s->qb, m4a * s->qc),
                   .l = m4a * (s->lo - SV_POWER_MIN),
                   .b = s->qb * r,
                   .lo = fmaf(0.25f, s->u_px + BIN_ROUND_LO, -col),
                   .hi = fmaf(0.25f, s->u_px + BIN_ROUND_HI, -col),
                   .r = BIN_ROOT_UP * r};
}

static float root(float disc) {
  int32_t bits;
  float y, x;
  memcpy(&bits, &disc, sizeof bits);
  bits = (int32_t)fmaf(-0.5f, (float)bits, BIN_ROOT_BITS);
  memcpy(&y, &bits, sizeof y);
  x = disc * y;
  return x * fmaf(-0.5f, x * y, 1.5f);
}

// Half the chord at height dy (v minus the pixel's y), in units of r, is the discriminant's root.
static float disc_at(const ellipse *e, float dy) { return fmaf(e->k * dy, dy, e->l); }

// Marks a splat's blocks of one block row, in that row's tiles.
static void mark_row(const sv_splat *s, int row, sv_intersection *intersection) {
  const ellipse e = ellipse_of(s);
  const int col = s->bx0 & ~7;
  const float min = (float)(s->bx0 - col), max = (float)(s->bx1 + 1 - col);
  // The rows' pixel centres span dy in [top - 3, top]; the ellipse is widest there at the height
  // nearest to its own extreme. Both of these heights are on the ellipse, or neither.
  float top = s->v_px - ((float)(4 * row) + 0.5f), bottom = top - 3.0f;
  float left = s1_min(s1_max(-s->dy_right, bottom), top), right = s1_min(s1_max(s->dy_right, bottom), top);
  float disc = disc_at(&e, left);
  if (!(disc > 0.0f)) return;
  float lo = fmaf(e.r, root(disc), fmaf(e.b, left, e.lo));
  float hi = fmaf(-e.r, root(disc_at(&e, right)), fmaf(e.b, right, e.hi));
  int from = (int)s1_min(s1_max(lo, min), max), to = (int)s1_min(s1_max(hi, 0.0f), max - 0.25f) + 1;
  for (int tx = 0; tx <= (s->bx1 - col) >> 3; tx++, intersection++)
    intersection->mask |= (uint64_t)bin_row_bits(bin_clamp8(from - 8 * tx), bin_clamp8(to - 8 * tx))
                          << 8 * (row & 7);
}

void sv_bin_ref(const sv_splat *splat, const uint32_t *id, uint32_t n, int n_tiles_x,
                sv_intersection *intersection) {
  for (uint32_t i = 0; i < n; i++) {
    const sv_splat *s = splat + id[i];
    if (!s->n_intersections) continue;
    sv_intersection *r = intersection + s->intersection_offset;
    for (int ty = s->by0 >> 3; ty <= s->by1 >> 3; ty++)
      for (int tx = s->bx0 >> 3; tx <= s->bx1 >> 3; tx++)
        *r++ = (sv_intersection){(uint32_t)(ty * n_tiles_x + tx), id[i],
                                 bin_is_bar(s) ? bin_bar(s, 8 * tx, 8 * ty) : 0};
    int n_x = (s->bx1 >> 3) - (s->bx0 >> 3) + 1;
    for (int row = s->by0; row <= s->by1 && !bin_is_bar(s); row++)
      mark_row(s, row, intersection + s->intersection_offset + ((row >> 3) - (s->by0 >> 3)) * n_x);
  }
}
