// SPDX-License-Identifier: Apache-2.0
// Photometric reprojection of rendered depth (Garg et al. 2016; Godard et al. 2017): another view's
// picture, sampled where a pixel's surface lies in it, shows the color of this view's picture.
//   L = weight / (3 n) sum over the pixels of |I'(project(d)) - I|_1
// d is the pixel's inverse depth, I' the other picture, linear between pixel centers, and n the
// number of pixels. Occlusions and gloss differ by more: pixels above a mean difference of 0.1 do
// not count. A call looks at one pixel in SV_REPROJECT_PHASES.
// The same the other way round, for a view that no camera has: its own colors follow those of a
// picture that shows the same surface, and depth is a constant.
// Owns nothing. Never renders.
#ifndef SV_LOSS_REPROJECT_H
#define SV_LOSS_REPROJECT_H

#include "src/image/planes.h"
#include "src/port/compute.h"
#include "src/rig/rig.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_REPROJECT_PHASES    4
#define SV_REPROJECT_BAND_ROWS 16

// Planes are of the view's image, [rows_padded][stride].
typedef struct {
  const float *inverse;   // inverse depth, 0: none (sv_smooth.inverse)
  const float *depth;     // D as rendered, above 0 where there is an inverse depth
  const float *colour[3]; // of the view's picture (colors: as rendered), 0 to 1
  int width_px, height_px, stride;
  const sv_view *view;
  const sv_view *partner;   // the other view, at the size of its image
  const sv_image_u8 *image; // its picture; masked pixels do not count
  float bg[3];              // what both pictures are laid over, where they have alpha
  long n_px;                // the loss is a mean over so many pixels
  int phase;                // 0 to SV_REPROJECT_PHASES - 1: which pixels
  float weight;             // of the loss over all phases
} sv_reproject_input;

// Returns L of this phase, times SV_REPROJECT_PHASES, and adds its gradient to g_depth and g_trans:
// dL/dD and dL/dT. band: [height_px / SV_REPROJECT_BAND_ROWS + 1]. The same bits for any number of
// threads.
double sv_reproject_loss(const sv_reproject_input *in, const sv_pool *pool, double *band, float *g_depth,
                         float *g_trans);

// L = weight / (3 n_px) sum over the pixels of h(I'(project(d)) - C), C the rendered colors
// and h the Huber loss of the channels, linear from 0.2 on.
// Pixels count whose point lies within a twentieth of the partner's own depth there, and whose mean
// difference is at most 0.3. partner_depth: plane of the partner, [height][partner_stride], 0:
// none. Adds dL/dC to g_colour, planes of the view. depth and phase are not used. Returns L; the
// same bits for any number of threads.
double sv_reproject_colours(const sv_reproject_input *in, const float *partner_depth, int partner_stride,
                            const sv_pool *pool, double *band, float *const g_colour[3]);

#ifdef __cplusplus
}
#endif
#endif
