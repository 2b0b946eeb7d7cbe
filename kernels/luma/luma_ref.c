// SPDX-License-Identifier: Apache-2.0
#include "kernels/luma/luma.h"
#include "kernels/ops.h"

void sv_luma_ref(const sv_luma_args *a) {
  for (int y = a->row0; y < a->row1; y++) {
    const uint8_t *p = a->src + (size_t)y * a->src_stride_bytes;
    float *dst = a->dst + (size_t)y * (size_t)a->dst_stride;
    for (int x = 0; x < a->width_px; x++)
      dst[x] = (float)(77 * p[3 * x] + 150 * p[3 * x + 1] + 29 * p[3 * x + 2]) * (1.0f / 65280.0f);
    for (int x = a->width_px; x < a->dst_stride; x++) dst[x] = 0.0f;
  }
}
