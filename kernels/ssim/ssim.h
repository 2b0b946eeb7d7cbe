// SPDX-License-Identifier: Apache-2.0
// Structural similarity of two planes with its gradient, and the photometric gradient that ends it.
//
// Wang, Bovik, Sheikh and Simoncelli, "Image quality assessment: from error visibility to
// structural similarity", IEEE TIP 2004, eq. 13, with an 11-tap Gaussian window g (sigma 1.5), zero
// padding, values in [0, 1], C1 = 0.01^2, C2 = 0.03^2; per pixel
//   m1 = g*x   m2 = g*y   e = g*(x^2 + y^2)   p = g*(x y)
//   A = m1^2 + m2^2 + C1   B = e - m1^2 - m2^2 + C2   C = 2 m1 m2 + C1   D = 2 (p - m1 m2) + C2
//   ssim = C D / (A B)
// (only the sum of the two variances is needed, so four maps are blurred, not five; nothing is
// clamped). Gradient of sum(ssim) by x: 2 (g*dm1 + x . g*ds1 + y . g*ds12) with the maps
//   dm1 = (m2 (D - C) - m1 ssim (B - A)) / (A B)   ds1 = -ssim / B   ds12 = C / (A B)
//
// Windows stand on every second row, 2 j + phase: a blur of 1.5 px leaves little that differs from
// row to row, so those between say the same, and the phase may change from step to step. `ssim`
// counts rows of windows, j, of which an image has (height - phase + 1) / 2; `ssim_bwd` counts
// rows of the image.
//
// Both work on the rows [row0, row1) and read what five rows on each side reach, so threads may own
// bands; every row's result depends on the inputs only, never on the banding. Maps may be of a band
// alone: they begin with the row of windows map_row0. Tolerance: exact (same bits) for AVX2,
// AVX-512 and NEON on finite inputs; SSE4.1 abs = 1e-4 on the sum of a row per 16 pixels and 2e-3
// of the largest value on the maps (no fused multiply-add under C2).
#ifndef SV_KERNELS_SSIM_H
#define SV_KERNELS_SSIM_H

#ifdef __cplusplus
extern "C" {
#endif

// Floats of scratch for planes of this stride; 64-byte aligned, one per thread, contents free.
#define SV_SSIM_SCRATCH_FLOATS(stride) (20 * ((stride) + 32))

typedef struct {
  const float *x, *y; // [height][stride]; columns >= width are never used
  int width_px, height_px, stride;
  int phase;      // 0 or 1
  int row0, row1; // of windows
  // Gradient maps [row1 - map_row0][stride], blurred along their rows, all three NULL (value only)
  // or all set. The columns from width to the next multiple of 16 become anything. May not overlap
  // x, y or each other.
  float *dm1, *ds1, *ds12;
  int map_row0; // <= row0
  // [(height - phase + 1) / 2] out: the sum of each row's SSIM; lane k adds the columns k mod 16,
  // then the tree.
  float *row_ssim;
  float *scratch;
} sv_ssim_args;

// grad (+)= w_l1 sign(x - y) + w_ssim d(sum ssim)/dx,   err (+)= err_scale |x - y|
typedef struct {
  const float *x, *y; // as above
  // From sv_ssim over the windows that stand on the rows from row0 - 5 to row1 + 4; all NULL: the
  // L1 part alone.
  const float *dm1, *ds1, *ds12;
  int map_row0; // the first of them, or one above
  int width_px, height_px, stride;
  int phase; // as above
  int row0, row1;
  float w_l1, w_ssim;
  float *grad;     // [height][stride]; columns [width, stride) become 0 (kept when adding);
                   // NULL: err and row_l1 alone
  int is_grad_add; // 0 overwrites, 1 adds
  float *err;      // [height][stride] or NULL; columns as grad
  float err_scale;
  int is_err_add;
  float *row_l1; // [height]: sum of |x - y| of the row, lanes as row_ssim
  float *scratch;
} sv_ssim_bwd_args;

typedef void sv_ssim_fn(const sv_ssim_args *a);
typedef void sv_ssim_bwd_fn(const sv_ssim_bwd_args *a);

#ifdef __cplusplus
}
#endif
#endif
