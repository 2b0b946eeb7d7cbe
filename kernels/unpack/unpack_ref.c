// SPDX-License-Identifier: Apache-2.0
#include <math.h>

#include "kernels/unpack/unpack.h"
#include "kernels/ops.h"

// Integer sums of one k x k block: colours (times alpha when there is one) and 255 - alpha.
static void block_sums(const sv_unpack_args *a, int x, int y, int32_t sum[4]) {
  sum[0] = sum[1] = sum[2] = sum[3] = 0;
  for (int j = 0; j < a->k; j++) {
    const uint8_t *p =
        a->src + (size_t)(y * a->k + j) * a->src_stride_bytes + (size_t)(x * a->k * a->n_channels);
    for (int i = 0; i < a->k; i++, p += a->n_channels) {
      int32_t alpha = a->n_channels == 4 ? p[3] : 1;
      for (int c = 0; c < 3; c++) sum[c] += p[c] * alpha;
      if (a->n_channels == 4) sum[3] += 255 - alpha;
    }
  }
}

void sv_unpack_ref(const sv_unpack_args *a) {
  const int w = a->width_px / a->k;
  const float inv = 1.0f / (float)(255 * a->k * a->k), inv_alpha = 1.0f / (float)(255 * 255 * a->k * a->k);
  for (int y = a->row0; y < a->row1; y++) {
    size_t at = (size_t)y * (size_t)a->dst_stride;
    for (int x = 0; x < w; x++) {
      int32_t s[4];
      block_sums(a, x, y, s);
      for (int c = 0; c < 3; c++)
        a->dst[c][at + (size_t)x] = a->n_channels == 4
                                        ? fmaf((float)s[3], a->bg[c] * inv, (float)s[c] * inv_alpha)
                                        : (float)s[c] * inv;
    }
    for (int c = 0; c < 3; c++)
      for (int x = w; x < a->dst_stride; x++) a->dst[c][at + (size_t)x] = 0.0f;
  }
}

void sv_unpack16_ref(const sv_unpack16_args *a) {
  const int w = a->width_px / a->k, k = a->k;
  const float inv = a->scale / (float)(65535 * k * k);
  for (int c = 0; c < 3; c++)
    for (int y = a->row0; y < a->row1; y++) {
      const uint16_t *src = a->src[c] + (size_t)(y * k) * (size_t)a->width_px;
      float *dst = a->dst[c] + (size_t)y * (size_t)a->dst_stride;
      for (int x = 0; x < w && k == 1; x++) dst[x] = (float)src[x] * inv;
      for (int x = 0; x < w && k > 1; x++) {
        uint32_t sum = 0;
        for (int j = 0; j < k; j++)
          for (int i = 0; i < k; i++) sum += src[(size_t)j * (size_t)a->width_px + (size_t)(x * k + i)];
        dst[x] = (float)sum * inv;
      }
      for (int x = w; x < a->dst_stride; x++) dst[x] = 0.0f;
    }
}
