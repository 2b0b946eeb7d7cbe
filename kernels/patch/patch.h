// SPDX-License-Identifier: Apache-2.0
// Patches of 12x12 pixels for tracking and matching: taken once from one image, compared with
// places in others. Places are in pixels, the centre of the first pixel at 0.5; a patch covers its
// place +- 6.
//
// patch_take samples the patch, bilinear, at place + A (i - 5.5, j - 5.5), where wanted with its
// differences along i and j (central, one sample apart on each side), and takes the mean off each.
// False in *is_inside when a sample lies outside the image. Scalar: once a feature. Exact for
// all.
//
// patch_sums compares n places of an image with one patch (A = 1): of the bilinear values v there
//   sum v, sum v^2, sum v p, sum v p_x, sum v p_y
// As p, p_x and p_y have mean 0, these give both the normalised cross correlation
//   sum v p / sqrt((sum v^2 - (sum v)^2 / 144) sum p^2)
// and a step of the inverse compositional alignment, free of a change in brightness (Baker and
// Matthews 2004, "Lucas-Kanade 20 years on", section 3.2): H d = (sum v p_x - sum p p_x, sum v p_y
// - sum p p_y), place -= d. Exact for AVX2, AVX-512 and NEON; SSE4.1 rel = 1e-5.
//
// patch_compare sums what the same alignment needs for six parameters, place and affine map
// together, of values v that patch_take has sampled through the map: with i, j the patch's pixels
// from its centre,
//   sum v p, sum v^2, sum v p_x, sum v p_y, sum v p_x i, sum v p_y i, sum v p_x j, sum v p_y j
// Exact for AVX2, AVX-512 and NEON; SSE4.1 rel = 1e-5.
#ifndef SV_KERNELS_PATCH_H
#define SV_KERNELS_PATCH_H

#include <stdbool.h>

#ifdef __cplusplus
extern "C" {
#endif

#define SV_PATCH_SIDE   12
#define SV_PATCH_PIXELS 144
// Places nearer to a border than REACH (+ 1 right and below) have no patch there.
#define SV_PATCH_REACH 6

// Values, differences along x, along y. In blocks of 4x4 pixels, blocks and their pixels row by
// row.
typedef struct {
  float v[3][SV_PATCH_PIXELS];
} sv_patch;

typedef struct {
  const float *src; // [height][stride]
  int width_px, height_px, stride;
  float x, y;      // place
  float a[4];      // row-major: pixels of the image for one of the patch
  sv_patch *out;   // undefined when outside
  bool has_slopes; // fill the differences, too: the samples reach one farther
  bool is_inside;  // output
} sv_patch_take_args;

typedef struct {
  const float *src; // [height][stride]
  int stride;       // in floats
  const sv_patch *patch;
  // [n] places with 6 <= x < width - 6, 6 <= y < height - 6: the caller sees to it
  const float *x, *y;
  int n;
  float (*out)[5]; // [n] the sums above
} sv_patch_sums_args;

typedef struct {
  const float *v;        // [SV_PATCH_PIXELS] in the order of sv_patch
  const sv_patch *patch; // with slopes
  float out[8];
} sv_patch_compare_args;

typedef void sv_patch_take_fn(sv_patch_take_args *a);
typedef void sv_patch_sums_fn(const sv_patch_sums_args *a);
typedef void sv_patch_compare_fn(sv_patch_compare_args *a);

#ifdef __cplusplus
}
#endif
#endif
