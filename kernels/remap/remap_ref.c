// SPDX-License-Identifier: Apache-2.0
#include "kernels/remap/remap.h"

#include "kernels/remap/remap_px.h"
#include "kernels/ops.h"

void sv_remap_ref(const sv_remap_args *a) {
  for (int y = a->row0; y < a->row1; y++) {
    const sv_remap_tap *t = a->table + (size_t)y * (size_t)a->dst_width_px;
    uint8_t *dst = a->dst + (size_t)y * a->dst_stride_bytes;
    for (int i = 0; i < a->dst_width_px; i++) remap_px(a, t + i, dst + 3 * i);
    remap_mask_row(a, y);
  }
}
