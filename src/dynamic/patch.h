// SPDX-License-Identifier: Apache-2.0
// Matching of square patches between images: the sum of squared differences over 7 x 7
// pixels and three colours, at all positions within a radius, then a parabola through the three
// best along x and y.
#ifndef SV_DYNAMIC_PATCH_H
#define SV_DYNAMIC_PATCH_H

#include <stdbool.h>

#include "src/image/planes.h"
#include "src/rig/rig.h"
#include "src/splat/render.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_PATCH_MIN_TEXTURE 0.0147f // of a patch that can be found again: 0.01 a value
#define SV_PATCH_MIN_LOGIT   -2.5f   // fainter Gaussians are not what is seen

// By how much pictures of this size are reduced: to at most 200 pixels a side, where unpack can. A
// picture of a lens shorter than the usual one (usual_fx_px, 0: none is) less, so that its pixels
// are no coarser.
int sv_patch_scale(const sv_view *v, float usual_fx_px);
// Whether a place of depth z at pixel (x, y) of the last rendering, which has depths, is what is
// seen there.
bool sv_patch_is_in_front(const sv_renderer *r, int x, int y, float z);

bool sv_patch_is_inside(const sv_planes *p, int x, int y); // the whole patch around pixel (x, y)
// A patch of an image, around pixel (x, y).
typedef struct {
  const sv_planes *image;
  int x, y;
} sv_image_patch;
// Sum of squared differences of two patches inside their images; stops when it exceeds max.
float sv_patch_mismatch(sv_image_patch a, sv_image_patch b, float max);
// How much the patch differs from those one pixel beside: the least over both directions. 0 at the
// rim.
float sv_patch_texture(const sv_planes *p, int x, int y);
// Moves b to the best match for a within reach, and returns its mismatch.
float sv_patch_search(sv_image_patch a, sv_image_patch *b, int reach);
// Offset, within half a pixel, of the best match for a from b; 0 where a neighbor is outside.
void sv_patch_offset(sv_image_patch a, sv_image_patch b, float d[2]);

// Pixel and depth of a place; false: behind the camera. jac [2][3]: dpixel/dx, or NULL.
bool sv_patch_project(const sv_view *v, const float x[3], float px[2], float *z, float *jac);

#ifdef __cplusplus
}
#endif
#endif
