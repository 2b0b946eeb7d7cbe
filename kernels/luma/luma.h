// SPDX-License-Identifier: Apache-2.0
// RGB bytes -> one float plane of grey values in [0, 1], for what looks at shapes and not at
// colours:
//   y = (77 r + 150 g + 29 b) / (255 * 256)      (the luma weights of ITU-R BT.601, in 256ths)
// of display values, as they are. The sums are integers below 2^24. Exact for all.
#ifndef SV_KERNELS_LUMA_H
#define SV_KERNELS_LUMA_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  const uint8_t *src; // [row1][src_stride_bytes], R,G,B
  size_t src_stride_bytes;
  int width_px;
  float *dst;     // [row1][dst_stride]; columns [width, dst_stride) become 0
  int dst_stride; // a multiple of 16
  int row0, row1;
} sv_luma_args;

typedef void sv_luma_fn(const sv_luma_args *a);

#ifdef __cplusplus
}
#endif
#endif
