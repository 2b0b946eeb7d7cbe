// SPDX-License-Identifier: Apache-2.0
// What a camera makes of an image in linear light: an affine color transform and a radial falloff,
//   out = f(r^2) (M x + b),  f = 1 + k1 r^2 + k2 r^4 + k3 r^6,
//   r^2 = ((i + 0.5 - cx)^2 + (j + 0.5 - cy)^2) inv_r2,
// and the gradient of a loss of it. After "Affine Color Transformations" of Rematas et al. 2022
// (Urban Radiance Fields, section 3.2), and the radial vignetting of Goldman and Chen 2005.
// Exact for AVX2, AVX-512 and NEON; SSE4.1 rel = 1e-5 on sums, abs = 1e-6 max(1, |out|) on pixels.
#ifndef SV_KERNELS_APPEARANCE_H
#define SV_KERNELS_APPEARANCE_H

#ifdef __cplusplus
extern "C" {
#endif

#define SV_APPEARANCE_SUMS 15 // gradients of M (9, row-major), b (3) and k (3)

typedef struct {
  float m[9], b[3], k[3]; // M row-major
  float cx, cy, inv_r2;   // px, px, 1/px^2
  const float *x[3];      // [height][stride] the image; columns >= width are never used
  int width_px, stride;
  int row0, row1;
  // appearance: [height][stride] out; columns >= width become 0. appearance_bwd: dL/d out, replaced
  // by dL/d x; columns >= width become 0
  float *out[3];
  // appearance_bwd: [height][SV_APPEARANCE_SUMS] out: the row's part of dL/dM, dL/db, dL/dk; lane l
  // adds the columns l mod 16, then the tree.
  float *row_sum;
} sv_appearance_args;

typedef void sv_appearance_fn(const sv_appearance_args *a);
typedef void sv_appearance_bwd_fn(const sv_appearance_args *a);

#ifdef __cplusplus
}
#endif
#endif
