// SPDX-License-Identifier: Apache-2.0
// tv over the vocabulary. The row is copied between repeated borders so that neighbours are plain
// loads.
#include <stddef.h>
#include <string.h>

#include "kernels/tv/tv.h"
#include "kernels/simd/v16.h"

#define BORDER 16

static inline v16m lanes_below(int n) { return v16m_from_bits(n >= 16 ? 0xffffu : (1u << n) - 1u); }
static inline v16 sign(v16 d) {
  v16 one = v16_set1(1.0f);
  return v16_sub(v16_keep(v16_gt(d, v16_zero()), one), v16_keep(v16_lt(d, v16_zero()), one));
}

typedef struct {
  const float *x, *up, *down; // x in the scratch row
  float *grad;
  int w;
} tv_row;

static inline void row_of(const sv_tv_args *a, const tv_row *t, int is_squared, v16 *sum_v, v16 *sum_h) {
  const float k = is_squared ? 2.0f : 1.0f;
  const v16 gv = v16_set1(k * a->w_v), gh = v16_set1(k * a->w_h);
  v16 sv = v16_zero(), sh = v16_zero();
  for (int i = 0; i < t->w; i += 16) {
    v16m keep = lanes_below(t->w - i);
    v16 x = v16_load(t->x + i), down = v16_load(t->down + i);
    v16 d1 = v16_keep(keep, v16_sub(v16_load(t->x + i + 1), x)), e1 = v16_keep(keep, v16_sub(down, x));
    sh = is_squared ? v16_fma(d1, d1, sh) : v16_add(sh, v16_abs(d1));
    sv = is_squared ? v16_fma(e1, e1, sv) : v16_add(sv, v16_abs(e1));
    if (!t->grad) continue;
    v16 d0 = v16_sub(x, v16_load(t->x + i - 1)), e0 = v16_sub(x, v16_load(t->up + i)),
        g = v16_load(t->grad + i);
    v16 qh = is_squared ? v16_sub(d0, d1) : v16_sub(sign(d0), sign(d1));
    v16 qv = is_squared ? v16_sub(e0, e1) : v16_sub(sign(e0), sign(e1));
    v16_store(t->grad + i, v16_sel(keep, v16_fma(gh, qh, v16_fma(gv, qv, g)), g));
  }
  *sum_v = sv;
  *sum_h = sh;
}

void V(sv_tv)(const sv_tv_args *a) {
  const int w = a->width_px;
  float *x = a->scratch + BORDER;
  memset(a->scratch, 0, sizeof(float) * (size_t)SV_TV_SCRATCH_FLOATS(a->stride));
  for (int r = a->row0; r < a->row1; r++) {
    const float *row = a->x + (size_t)r * (size_t)a->stride;
    v16 sv, sh;
    memcpy(x, row, sizeof(float) * (size_t)w);
    x[-1] = x[0];
    x[w] = x[w - 1];
    tv_row t = {x, r > 0 ? row - a->stride : row, r + 1 < a->height_px ? row + a->stride : row,
                a->grad ? a->grad + (size_t)r * (size_t)a->stride : NULL, w};
    if (a->form == SV_TV_SQUARED) row_of(a, &t, 1, &sv, &sh);
    else row_of(a, &t, 0, &sv, &sh);
    a->row_v[r] = v16_sum(sv);
    a->row_h[r] = v16_sum(sh);
  }
}
