// SPDX-License-Identifier: Apache-2.0
#include "kernels/bin/bin.h"

#include "kernels/bin/bin_common.h"
#include "kernels/simd/s1_math.h"

// Columns of the ellipse at height dy (v minus the pixel's y): centre *c and half-width *h, false outside it.
static int chord(const sv_splat *s, float dy, float *c, float *h) {
  float bdy = s->qb * dy, inv2a = s->inv_2qa; // < 0
  float level = fmaf(s->qc * dy, dy, s->lo - SV_POWER_MIN);
  float disc = fmaf(bdy, bdy, -4.0f * s->qa * level);
  *c = fmaf(bdy, inv2a, s->u_px);
  *h = sqrtf(s1_max(disc, 0.0f)) * -inv2a;
  return disc > 0.0f;
}

// Marks a splat's blocks of one block row, in that row's tiles.
static void mark_row(const sv_splat *s, int row, sv_rec *rec) {
  bin_bounds b = bin_bounds_of(s);
  // The rows' pixel centres span dy in [top - 3, top]; the ellipse is widest there at the height nearest to its
  // own extreme.
  float top = s->v_px - ((float)(4 * row) + 0.5f), bottom = top - 3.0f, c, h;
  int is_in = chord(s, s1_min(s1_max(-s->dy_right, bottom), top), &c, &h);
  float lo = s1_min(s1_max(c - h + BIN_ROUND_LO, b.min), b.max);
  is_in &= chord(s, s1_min(s1_max(s->dy_right, bottom), top), &c, &h);
  float hi = s1_min(s1_max(c + h + BIN_ROUND_HI, 0.0f), b.max - 1.0f);
  int from = (int)(lo * 0.25f), to = (int)(hi * 0.25f) + 1;
  if (!is_in) return;
  for (int tx = s->bx0 >> 3; tx <= s->bx1 >> 3; tx++, rec++)
    rec->mask |= (uint64_t)bin_row_bits(bin_clamp8(from - 8 * tx), bin_clamp8(to - 8 * tx)) << 8 * (row & 7);
}

void sv_bin_ref(const sv_splat *splat, const uint32_t *id, uint32_t n, int n_tiles_x, sv_rec *rec) {
  for (uint32_t i = 0; i < n; i++) {
    const sv_splat *s = splat + id[i];
    if (!s->n_recs) continue;
    sv_rec *r = rec + s->first_rec;
    for (int ty = s->by0 >> 3; ty <= s->by1 >> 3; ty++)
      for (int tx = s->bx0 >> 3; tx <= s->bx1 >> 3; tx++)
        *r++ =
            (sv_rec){(uint32_t)(ty * n_tiles_x + tx), id[i], bin_is_bar(s) ? bin_bar(s, 8 * tx, 8 * ty) : 0};
    int n_x = (s->bx1 >> 3) - (s->bx0 >> 3) + 1;
    for (int row = s->by0; row <= s->by1 && !bin_is_bar(s); row++)
      mark_row(s, row, rec + s->first_rec + ((row >> 3) - (s->by0 >> 3)) * n_x);
  }
}
