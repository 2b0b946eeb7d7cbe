// SPDX-License-Identifier: Apache-2.0
// Bayer mosaic of bytes -> RGB8. Gradient-corrected bilinear interpolation: H. Malvar, L. He, R.
// Cutler, "High-quality linear interpolation for demosaicing of Bayer-patterned color images",
// ICASSP 2004, figure 2:
//   green at red or blue          4 c + 2 (n+s+e+w) - (n2+s2+e2+w2)                             / 8
//   the colour of the row's       5 c + 4 (e+w) - diagonals - (e2+w2) + (n2+s2) / 2             / 8
//     other pixels at green
//   that of the column's at green the same, turned
//   red at blue, blue at red      6 c + 2 diagonals - 3/2 (n2+s2+e2+w2)                         / 8
// rounded to nearest (2 t + 1 over 32: never half way), clamped. Borders are mirrored without
// repeating the edge, which keeps the pattern. Integers throughout: exact for all variants.
#ifndef SV_KERNELS_DEMOSAIC_H
#define SV_KERNELS_DEMOSAIC_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

// Bytes of scratch for a width; one per thread, contents free.
#define SV_DEMOSAIC_SCRATCH_BYTES(width_px) (5 * (((((size_t)(width_px)) + 15) & ~(size_t)15) + 64))

typedef struct {
  const uint8_t *src; // [height_px][src_stride_bytes]
  size_t src_stride_bytes;
  int width_px, height_px; // 4 or more each
  int phase;               // place of the red pixel in the top left 2 x 2: x + 2 y
  uint8_t *dst;            // [height_px][dst_stride_bytes] RGB8
  size_t dst_stride_bytes;
  int row0, row1;
  uint8_t *scratch;
} sv_demosaic_args;

typedef void sv_demosaic_fn(const sv_demosaic_args *a);

#ifdef __cplusplus
}
#endif
#endif
