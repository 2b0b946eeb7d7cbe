// SPDX-License-Identifier: Apache-2.0
#include "kernels/bin/bin.h"

#include "kernels/bin/bin_common.h"
#include "kernels/simd/s1_math.h"

// Pixel columns of row y (centre y + 0.5) inside the ellipse, as block columns before rounding down. The
// 0.02 px of slack cover rounding; 0.47 = 0.99 (round up to a pixel) - 0.5 (its centre) - 0.02.
static void row_span(const sv_splat *s, int y, float *lo, float *hi) {
  float dy = s->v_px - ((float)y + 0.5f), bdy = s->qb * dy, inv2a = 0.5f / s->qa;
  float level = fmaf(s->qc * dy, dy, s->lo - SV_LOG2_ALPHA_MIN);
  float disc = fmaf(bdy, bdy, -4.0f * s->qa * level);
  float c = fmaf(bdy, inv2a, s->u_px), h = sqrtf(s1_max(disc, 0.0f)) * inv2a; // inv2a < 0
  float min = (float)(4 * s->bx0), max = (float)(4 * s->bx1 + 4);
  *lo = disc > 0.0f ? s1_min(s1_max(c + h + 0.47f, min), max) : max;
  *hi = disc > 0.0f ? s1_min(s1_max(c - h - 0.48f, 0.0f), max - 1.0f) : 0.0f;
}

void sv_bin_ref(const sv_splat *splat, const uint32_t *id, uint32_t n, int n_tiles_x, sv_rec *rec) {
  for (uint32_t i = 0; i < n; i++) {
    const sv_splat *s = splat + id[i];
    if (!s->n_recs) continue;
    bin_clear(s, id[i], n_tiles_x, rec);
    for (int row = s->by0; row <= s->by1; row++) {
      float lo = 1e9f, hi = 0.0f;
      for (int k = 0; k < 4; k++) {
        float a, b;
        row_span(s, 4 * row + k, &a, &b);
        lo = s1_min(lo, a);
        hi = s1_max(hi, b);
      }
      int c0 = (int)(lo * 0.25f), c1 = (int)(hi * 0.25f);
      if (c0 <= c1) bin_mark(s, row, c0, c1, rec);
    }
  }
}
