// SPDX-License-Identifier: Apache-2.0
// The best corner of each cell of 16x16 pixels: the pixel whose 5x5 neighbourhood has the largest
// smaller eigenvalue of the gradients' second moments (Shi and Tomasi 1994, "Good features to
// track"):
//   g = (x[+1] - x[-1], y[+1] - y[-1])    M = sum over 5x5 of g g^T = (a b; b c)
//   score = (a + c)/2 - sqrt(((a - c)/2)^2 + b^2)
// Without fused operations, so exact for all.
#ifndef SV_KERNELS_CORNER_H
#define SV_KERNELS_CORNER_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define SV_CORNER_CELL       16
#define SV_CORNER_MIN_MARGIN 3 // what the neighbourhood reaches
// 64-byte aligned, one per thread, contents free.
#define SV_CORNER_SCRATCH_FLOATS(stride) (20 * ((stride) + 32))

typedef struct {
  float score;  // 0: the cell has no pixel above 0
  int16_t x, y; // pixel; -1, -1 without one. Of equal scores the topmost, then the leftmost
} sv_corner;

typedef struct {
  const float *src;                // [height][stride]
  int width_px, height_px, stride; // stride: a multiple of 32
  // pixels nearer to the border are left out, at least SV_CORNER_MIN_MARGIN
  int margin_px;
  int cell0, cell1; // rows of cells, of ceil(height / 16)
  sv_corner *out;   // [ceil(height / 16)][ceil(width / 16)]
  float *scratch;
} sv_corner_args;

typedef void sv_corner_fn(const sv_corner_args *a);

#ifdef __cplusplus
}
#endif
#endif
