// SPDX-License-Identifier: Apache-2.0
// The depth of surfaces. A Gaussian that is large and lies aslant has another depth at each pixel
// it covers than at its center. Its mean depth there, given the pixel, is a plane over the image
// (the regression of depth on place, of the projection linearized at its center: EWA).
// Owns nothing, never renders.
#ifndef SV_SPLAT_SURFACE_H
#define SV_SPLAT_SURFACE_H

#include "kernels/kernels.h"
#include "src/rig/rig.h"
#include "src/splat/gaussians.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  const sv_gaussians *g;
  const sv_view *view;
  float dilation_px2; // of both variances in the image
} sv_surface;

// rgb[0] and rgb[1] of the visible splats of Gaussians [begin, end) become the slopes of depth a
// pixel to the right and downwards (kernels/surface/surface.h).
void sv_surface_slopes(const sv_surface *s, int begin, int end, sv_splat *splat);

#ifdef __cplusplus
}
#endif
#endif
