// SPDX-License-Identifier: Apache-2.0
// resize over the vocabulary; the taps of a row are gathered one by one.
#include <stddef.h>

#include "kernels/resize/resize.h"
#include "kernels/simd/v16.h"

static inline v16m lanes_below(int n) { return v16m_from_bits(n >= 16 ? 0xffffu : (1u << n) - 1u); }

// The sixteen places from destination index i on: lower taps, weights of the upper ones.
static inline v16 taps(int i, float scale, int n_src, int32_t at[16]) {
  v16 s = v16_fma(v16_add(v16_set1((float)i + 0.5f), v16_iota()), v16_set1(scale), v16_set1(-0.5f));
  s = v16_min(v16_max(s, v16_zero()), v16_set1((float)(n_src - 1)));
  v16i k = v16_trunc_i(s);
  v16i_store(at, k);
  return v16_sub(s, v16i_to_f(k));
}

static void resize_row(const sv_resize_args *a, float *dst, float scale) {
  int x = 0;
  for (; x < a->dst_width_px; x += 16) {
    int32_t at[16];
    float lo[16], hi[16];
    v16 f = taps(x, scale, a->src_width_px, at);
    for (int k = 0; k < 16; k++) {
      lo[k] = a->scratch[at[k]];
      hi[k] = a->scratch[at[k] + 1 < a->src_width_px ? at[k] + 1 : at[k]];
    }
    v16 l = v16_load(lo);
    v16 r = v16_fma(f, v16_sub(v16_load(hi), l), l);
    v16_store(dst + x, v16_keep(lanes_below(a->dst_width_px - x), r));
  }
  for (; x < a->dst_stride; x += 16) v16_store(dst + x, v16_zero());
}

void V(sv_resize)(const sv_resize_args *a) {
  const float sx = (float)a->src_width_px / (float)a->dst_width_px;
  const float sy = (float)a->src_height_px / (float)a->dst_height_px;
  for (int y = a->row0; y < a->row1; y++) {
    int32_t at[16];
    float f[16];
    v16_store(f, taps(y, sy, a->src_height_px, at));
    const float *top = a->src + (size_t)at[0] * (size_t)a->src_stride;
    const float *low = at[0] + 1 < a->src_height_px ? top + a->src_stride : top;
    for (int i = 0; i < a->src_width_px; i += 16) {
      v16 t = v16_load(top + i);
      v16_store(a->scratch + i, v16_fma(v16_set1(f[0]), v16_sub(v16_load(low + i), t), t));
    }
    resize_row(a, a->dst + (size_t)y * (size_t)a->dst_stride, sx);
  }
}
