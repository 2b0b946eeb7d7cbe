// SPDX-License-Identifier: Apache-2.0
#include "kernels/remap/remap.h"

void sv_remap_ref(const sv_remap_args *a) {
  for (int y = a->row0; y < a->row1; y++) {
    const sv_remap_tap *t = a->table + (size_t)y * (size_t)a->dst_width_px;
    uint8_t *dst = a->dst + (size_t)y * a->dst_stride_bytes;
    uint8_t *mask = a->mask ? a->mask + (size_t)y * (size_t)a->dst_width_px : NULL;
    for (int i = 0; i < a->dst_width_px; i++, t++, dst += 3) {
      const int is_in = t->x != SV_REMAP_NONE;
      if (mask) mask[i] = is_in ? 255 : 0;
      if (!is_in) {
        for (int c = 0; c < 3; c++) dst[c] = a->fill[c];
        continue;
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
  }
}
