// SPDX-License-Identifier: Apache-2.0
// Depth of the surface in one tile. A first pass finds the mean depth of what takes the light of a
// pixel between two transmittances: in front of that is faint (floaters, the rims of large
// Gaussians), behind it hidden. A second pass finds the mean depth of all that lies near this depth
// and in front of the second transmittance: the front of a surface, whose Gaussians are a layer.
//
// Per pixel and splat, front to back, alpha a and transmittance T as of raster.h:
//   z = s.z - rgb[0] dx - rgb[1] dy;  w = max(0, min(T, from) - max(T - a T, to))
//   sum of w z;  sum of w;  T -= a T
// rgb[0] and rgb[1] are the slopes of the splat's depth a pixel to the right and downwards
// (src/splat/surface.h). First pass: p = the quotient; 0 where T stays above `to`. Second pass: the
// same with from = 1 and w = 0 unless |z - p| < near p; out: the quotient, or p where all w are 0.
#ifndef SV_KERNELS_SURFACE_H
#define SV_KERNELS_SURFACE_H

#include "kernels/raster/raster.h"

#ifdef __cplusplus
extern "C" {
#endif

// Per thread; no more than the rasterizer's.
#define SV_SURFACE_SCRATCH_FLOATS (4 * SV_TILE_PX * SV_TILE_PX)

typedef struct {
  const sv_splat *splat;
  const sv_intersection *intersection;
  int n_tiles_x, stride; // as of sv_raster_args
  float from, to;        // transmittances, 1 >= from > to > 0
  float near;            // share of the depth, at least 0; 0: no second pass
  float *depth;          // out: plane, world units
} sv_surface_args;

// One tile; list[n]: its intersections, front to back. exact.
typedef void sv_surface_fn(const sv_surface_args *a, uint32_t tile, const uint32_t *list, uint32_t n,
                           float *scratch);

#ifdef __cplusplus
}
#endif
#endif
