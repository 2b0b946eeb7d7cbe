// SPDX-License-Identifier: Apache-2.0
// Square patches of pictures, looked for in others: the sum of squared differences over 7 x 7
// pixels and three colours, at all places within a radius, then a parabola through the three best
// along x and y.
#ifndef SV_DYNAMIC_PATCH_H
#define SV_DYNAMIC_PATCH_H

#include <stdbool.h>

#include "src/image/planes.h"
#include "src/rig/rig.h"
#include "src/splat/render.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_PATCH_LEAST_TEXTURE 0.0147f // of a patch that can be found again: 0.01 a value
#define SV_PATCH_LEAST_LOGIT   -2.5f   // fainter Gaussians are not what is seen

// By how much pictures of this size are reduced: to at most 200 pixels a side, where unpack can. A
// picture of a lens shorter than the usual one (usual_fx_px, 0: none is) less, so that its pixels
// are no coarser.
int sv_patch_scale(const sv_view *v, float usual_fx_px);
// Whether a place of depth z at pixel (x, y) of the last rendering, which has depths, is what is
// seen there.
bool sv_patch_is_in_front(const sv_renderer *r, int x, int y, float z);

bool sv_patch_is_inside(const sv_planes *p, int x, int y); // the whole patch around pixel (x, y)
// Between the patches around (xa, ya) and (xb, yb), both inside; stops when it exceeds most.
float sv_patch_mismatch(const sv_planes *a, int xa, int ya, const sv_planes *b, int xb, int yb, float most);
// How much the patch differs from those one pixel beside: the least over both directions. 0 at the
// rim.
float sv_patch_texture(const sv_planes *p, int x, int y);
// Best place within reach of (*x, *y) in b for the patch of a at (xa, ya), and its mismatch.
float sv_patch_search(const sv_planes *a, int xa, int ya, const sv_planes *b, int reach, int *x, int *y);
// Offset, within half a pixel, of the best place from (x, y) in b; 0 where a neighbour is outside.
void sv_patch_offset(const sv_planes *a, int xa, int ya, const sv_planes *b, int x, int y, float d[2]);

// Pixel and depth of a place; false: behind the camera. jac [2][3]: dpixel/dx, or NULL.
bool sv_patch_project(const sv_view *v, const float x[3], float px[2], float *z, float *jac);

#ifdef __cplusplus
}
#endif
#endif
