// SPDX-License-Identifier: Apache-2.0
#include "kernels/area/area.h"
#include "kernels/area/area_px.h"
#include "kernels/ops.h"

void sv_area_ref(const sv_area_args *a) {
  for (int y = a->row0; y < a->row1; y++) {
    const area_span s = area_span_of(y, a->src_height_px, a->dst_height_px);
    for (int i = 0; i < 3 * a->src_width_px; i++) a->scratch[i] = 0.0f;
    for (int k = s.first; k < s.end; k++) {
      const uint8_t *p = a->src + (size_t)k * a->src_stride_bytes;
      const float w = area_weight(&s, k);
      for (int i = 0; i < 3 * a->src_width_px; i++) a->scratch[i] += w * (float)p[i];
    }
    area_columns(a, 0, a->dst + (size_t)y * a->dst_stride_bytes);
  }
}
