// SPDX-License-Identifier: Apache-2.0
// Total variation of one plane with its gradient:
//   TV = w_v sum_y phi(x[y+1] - x[y]) + w_h sum_x phi(x[x+1] - x[x])
// phi(d) = d^2 (the squared form) or |d| (anisotropic; Rudin, Osher and Fatemi 1992 without the
// root). The weights hold the normalisation, e.g. 1 / (number of differences of that direction).
// Exact for AVX2, AVX-512 and NEON; SSE4.1 rel = 1e-5 on sums, abs = 1e-6 max(1, |g|) on gradients.
#ifndef SV_KERNELS_TV_H
#define SV_KERNELS_TV_H

#ifdef __cplusplus
extern "C" {
#endif

typedef enum { SV_TV_SQUARED = 0, SV_TV_ABSOLUTE = 1 } sv_tv_form;

// 64-byte aligned, one per thread, contents free.
#define SV_TV_SCRATCH_FLOATS(stride) ((stride) + 32)

typedef struct {
  const float *x; // [height][stride]; columns >= width are never used
  int width_px, height_px, stride;
  int row0, row1; // one row more is read on each side
  sv_tv_form form;
  float w_v, w_h;
  // [height][stride]: the gradient is added; columns >= width are kept. NULL: value only
  float *grad;
  // [height] out: the row's sum of phi, without weight, of the differences to the next row (row_v)
  // and of those within it (row_h); lane k adds the columns k mod 16, then the tree.
  float *row_v, *row_h;
  float *scratch;
} sv_tv_args;

typedef void sv_tv_fn(const sv_tv_args *a);

#ifdef __cplusplus
}
#endif
#endif
