// SPDX-License-Identifier: Apache-2.0
// What the reference and the variants share: which source pixels a destination pixel covers, and
// the sum over columns.
#ifndef SV_KERNELS_AREA_PX_H
#define SV_KERNELS_AREA_PX_H

#include <stdint.h>

#include "kernels/area/area.h"

// Source pixels [first, end) of destination pixel i, in units of 1/n_dst of a source pixel.
typedef struct {
  int32_t from, to; // [from, to) of the destination pixel
  int first, end;
  int n_dst;
  float scale; // of a weight: 1 / n_src
} area_span;

static inline area_span area_span_of(int i, int n_src, int n_dst) {
  area_span s;
  s.from = i * n_src;
  s.n_dst = n_dst;
  s.scale = 1.0f / (float)n_src;
  s.to = s.from + n_src;
  s.first = s.from / n_dst;
  s.end = (s.to + n_dst - 1) / n_dst;
  return s;
}

// The share that source pixel k has of the destination pixel; all add up to 1.
static inline float area_weight(const area_span *s, int k) {
  const int32_t from = k * s->n_dst, to = from + s->n_dst;
  return (float)((to < s->to ? to : s->to) - (from > s->from ? from : s->from)) * s->scale;
}

static inline uint8_t area_byte(float v) {
  v = v < 255.0f ? v : 255.0f;
  return (uint8_t)(int)(v + 0.5f);
}

// The destination pixels from x on.
static inline void area_columns(const sv_area_args *a, int x, uint8_t *dst) {
  const float *sums = a->scratch;
  for (; x < a->dst_width_px; x++) {
    const area_span s = area_span_of(x, a->src_width_px, a->dst_width_px);
    float r = 0;
    float g = 0;
    float b = 0;
    for (int k = s.first; k < s.end; k++) {
      const float w = area_weight(&s, k);
      r += w * sums[3 * k];
      g += w * sums[3 * k + 1];
      b += w * sums[3 * k + 2];
    }
    dst[3 * x] = area_byte(r);
    dst[3 * x + 1] = area_byte(g);
    dst[3 * x + 2] = area_byte(b);
  }
}
#endif
