// SPDX-License-Identifier: Apache-2.0
// Where a small patch of one image lies in another, to some hundredths of a pixel: place, affine
// map, gain and offset together by the inverse compositional method (S. Baker and I. Matthews,
// "Lucas-Kanade 20 Years On", IJCV 2004), cubic interpolation, a Gaussian window. A translation
// alone slides along surfaces that the views see from different sides, and bilinear interpolation
// pulls towards whole pixels. Tools and tests only.
#ifndef SV_CALIB_SOLVE_ALIGN_H
#define SV_CALIB_SOLVE_ALIGN_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define SV_ALIGN_RADIUS_PX 8 // of the window; its Gaussian's deviation is half of that

typedef struct {
  int width_px, height_px;
  const uint8_t *grey; // [height][width]
} sv_align_image;

// The patch about `at` of one image is looked for about uv of the other, where uv and warp (pixels
// of `to` for one of `from`, row-major) start; both are improved. Places in pixels, the center of
// the first at 0. Returns the correlation there, in [-1, 1]; -1 when the patch has no structure,
// leaves an image, or the search does not settle.
double sv_align_patch(const sv_align_image *from, const double at[2], const sv_align_image *to, double uv[2],
                      double warp[4]);

#ifdef __cplusplus
}
#endif
#endif
