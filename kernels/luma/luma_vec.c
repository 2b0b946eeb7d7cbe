// SPDX-License-Identifier: Apache-2.0
// luma over the vocabulary.
#include <string.h>

#include "kernels/luma/luma.h"
#include "kernels/simd/v16.h"
#include "kernels/simd/px.h"

static inline v16 weigh(const uint8_t *p) {
  uint8_t px[48];
  px_split3(p, px);
  v16 s = v16_mul(v16_load_u8(px), v16_set1(77.0f));
  s = v16_add(s, v16_mul(v16_load_u8(px + 16), v16_set1(150.0f)));
  s = v16_add(s, v16_mul(v16_load_u8(px + 32), v16_set1(29.0f)));
  return v16_mul(s, v16_set1(1.0f / 65280.0f));
}

void V(sv_luma)(const sv_luma_args *a) {
  for (int y = a->row0; y < a->row1; y++) {
    const uint8_t *p = a->src + (size_t)y * a->src_stride_bytes;
    float *dst = a->dst + (size_t)y * (size_t)a->dst_stride;
    int x = 0;
    for (; x + 16 <= a->width_px; x += 16) v16_store(dst + x, weigh(p + 3 * x));
    if (x < a->width_px) { // never read past the row; what is left of the vector becomes 0
      uint8_t tail[48] = {0};
      memcpy(tail, p + 3 * x, (size_t)(3 * (a->width_px - x)));
      v16_store(dst + x, weigh(tail));
      x += 16;
    }
    for (; x < a->dst_stride; x += 16) v16_store(dst + x, v16_zero());
  }
}
