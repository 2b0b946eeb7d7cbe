// SPDX-License-Identifier: Apache-2.0
// The depth of surfaces. A Gaussian that is large and lies aslant has another depth at each pixel
// it covers than at its center. Its mean depth there, given the pixel, is a plane over the image
// (the regression of depth on place, of the projection linearized at its center: EWA). The
// renderer blends the planes' three numbers in the place of color.
// Owns nothing, never renders.
#ifndef SV_SPLAT_SURFACE_H
#define SV_SPLAT_SURFACE_H

#include "kernels/kernels.h"
#include "src/rig/rig.h"
#include "src/splat/gaussians.h"

#ifdef __cplusplus
extern "C" {
#endif

// Opacity from which on Gaussians make a surface: fainter ones are floaters, or blur before it.
#define SV_SURFACE_OPACITY 0.133f

// An opacity logit for depth: nearly 1 above the opacity `at`, nearly 0 below it. As trained, light
// passes the Gaussians of a surface, and the expected depth lies behind it.
float sv_surface_logit(float logit, float at);

typedef struct {
  const sv_gaussians *g;
  const sv_view *view;
  float dilation_px2; // of both variances in the image
} sv_surface;

// rgb of the visible splats of Gaussians [begin, end) becomes depth at the image's middle, and its
// slopes a pixel to the right and downwards.
void sv_surface_planes(const sv_surface *s, int begin, int end, sv_splat *splat);

#ifdef __cplusplus
}
#endif
#endif
