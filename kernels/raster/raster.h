// SPDX-License-Identifier: Apache-2.0
// Front-to-back alpha blending of one tile, and its gradient. Kerbl et al. 2023, section 6; the
// backward pass also goes front to back, with one suffix scalar per pixel (algorithm of "Taming
// 3DGS", 2024): it needs no per-pixel lists.
//
// Per pixel and splat, front to back:
//   power = qa dx^2 + qb dx dy + qc dy^2 + lo, log2 of alpha less 8;  skipped when alpha < 1/255
//   a = min(0.99, 2^(8 + power));  colour += a T rgb;  depth += a T z;  T -= a T
// Early termination: lists are blended in groups of SV_RASTER_GROUP intersections. A block of 4x4
// pixels is saturated when the transmittance T of all its pixels is below 1e-4 before a group; its
// bit is cleared in the masks of the group. (Kerbl's program terminates each pixel at the splat
// that would take T below 1e-4. A pixel that continues because of brighter neighbours gains less
// than that.)
//
// Backward, with the image's gradient dot = rgb . dL/drgb + z dL/ddepth and w = a T:
//   S' = S - w dot
//   dL/d(ln a) = w dot - S' a / (1 - a) = S - S' / (1 - a);  0 where 2^(8 + power) > 0.99
// S, the suffix, begins at colour . dL/drgb + depth dL/ddepth + T dL/dtrans of the pixel; S' is
// what lies behind the splat. The quotient depends on the splat alone, so nothing waits for it.
// Where T is below 1e-4 there is no gradient: S is then rounding error, and hidden Gaussians would
// follow it. Splats that cannot reach the limit of 0.99 are not compared with it.
#ifndef SV_KERNELS_RASTER_H
#define SV_KERNELS_RASTER_H

#include "kernels/project/project.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_TILE_BLOCKS  64 // 4x4 blocks of a tile
#define SV_RASTER_GROUP 128
// The moments of intersections of at most so many blocks are summed block by block, of larger ones
// by rows of blocks first.
#define SV_RASTER_SMALL 16
// Splats of an opacity up to 2^this, 0.98, stay below SV_ALPHA_MAX whatever is rounded on the way.
#define SV_POWER_FREE            (-0.0291463f - SV_POWER_SHIFT)
#define SV_RASTER_SCRATCH_FLOATS (12 * SV_TILE_PX * SV_TILE_PX + 160) // per thread

// Planes are planar floats, rows `stride` apart; stride and padded height are multiples of 32.
typedef struct {
  const sv_splat *splat;
  sv_intersection *intersection; // forward clears the bits of saturated blocks in the masks
  int n_tiles_x;                 // tiles of a row of tiles
  int stride;                    // floats from row to row of every plane
  float bg[3];                   // background colour
  float *rgb[3];                 // out: colour, background included
  float *depth;                  // out: sum of a T z; or NULL
  float *trans;                  // out: final transmittance; not written where depth is NULL
} sv_raster_args;

// One tile; list[n]: its intersections, front to back. exact.
typedef void sv_raster_fn(const sv_raster_args *a, uint32_t tile, const uint32_t *list, uint32_t n,
                          float *scratch);

typedef struct {
  const sv_raster_args *fwd; // as the forward pass left it
  const float *g_rgb[3];     // planes dL/drgb
  const float *g_depth;      // plane dL/ddepth, or NULL
  const float *g_trans;      // plane dL/dtrans, or NULL (alpha = 1 - trans)
  const float *err;          // plane of residuals: weight * err is summed per splat; or NULL
  // [n_intersections][SV_IGRAD_BYTES] out: per-intersection gradients; not written where the mask
  // is 0.
  uint8_t *igrad;
} sv_raster_bwd_args;

// exact.
typedef void sv_raster_bwd_fn(const sv_raster_bwd_args *a, uint32_t tile, const uint32_t *list, uint32_t n,
                              float *scratch);

#ifdef __cplusplus
}
#endif
#endif
