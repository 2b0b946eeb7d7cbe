// SPDX-License-Identifier: Apache-2.0
// One pixel of remap in plain C: the reference, and what the variants do at borders and tails.
#ifndef SV_KERNELS_REMAP_PX_H
#define SV_KERNELS_REMAP_PX_H

#include "kernels/remap/remap.h"

static inline void remap_px(const sv_remap_args *a, const sv_remap_tap *t, uint8_t *dst) {
  if (t->x == SV_REMAP_NONE) {
    for (int c = 0; c < 3; c++) dst[c] = a->fill[c];
    return;
  }
  const uint8_t *p = a->src + (size_t)t->y * a->src_stride_bytes + (size_t)t->x * 3;
  const uint8_t *q = t->y + 1 < a->src_height_px ? p + a->src_stride_bytes : p;
  const int right = t->x + 1 < a->src_width_px ? 3 : 0;
  const uint32_t fx = t->fx, fy = t->fy, gx = 256 - fx, gy = 256 - fy;
  for (int c = 0; c < 3; c++) {
    uint32_t top = p[c] * gx + p[c + right] * fx, low = q[c] * gx + q[c + right] * fx;
    dst[c] = (uint8_t)((top * gy + low * fy + 32768) >> 16);
  }
}

static inline void remap_mask_row(const sv_remap_args *a, int y) {
  const sv_remap_tap *t = a->table + (size_t)y * (size_t)a->dst_width_px;
  if (!a->mask) return;
  for (int i = 0; i < a->dst_width_px; i++)
    a->mask[(size_t)y * (size_t)a->dst_width_px + (size_t)i] = t[i].x != SV_REMAP_NONE ? 255 : 0;
}

#endif
