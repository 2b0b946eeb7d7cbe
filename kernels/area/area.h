// SPDX-License-Identifier: Apache-2.0
// A picture of bytes -> a smaller one, by area: a destination pixel is the mean of the source
// pixels that it covers, those at its border by the part covered:
//   x covers the columns [x W/w, (x + 1) W/w), y the rows [y H/h, (y + 1) H/h)
// of display values, as they are. First the rows are summed, then columns, in rising order, each
// weight rounded to float; no fused multiply-add, so all variants give the same bits, SSE4.1
// included.
#ifndef SV_KERNELS_AREA_H
#define SV_KERNELS_AREA_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

// Floats of scratch for a source of this width, one block a thread; contents free.
#define SV_AREA_SCRATCH_FLOATS(src_width) (((size_t)(src_width)*3 + 31) & ~(size_t)15)

typedef struct {
  const uint8_t *src; // [src_height][src_stride_bytes] R,G,B
  size_t src_stride_bytes;
  int src_width_px, src_height_px; // at most 16384
  uint8_t *dst;                    // [dst_height][dst_stride_bytes] R,G,B. Not src
  size_t dst_stride_bytes;
  int dst_width_px, dst_height_px; // at most those of src
  int row0, row1;                  // rows of dst
  float *scratch;
} sv_area_args;

typedef void sv_area_fn(const sv_area_args *a);

#ifdef __cplusplus
}
#endif
#endif
