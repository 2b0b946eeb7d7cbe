// SPDX-License-Identifier: Apache-2.0
// Where one view sees what another one sees at a given depth: of pinholes a homography and the
// epipole, of fisheyes point by point through their lenses.
#ifndef SV_TRAIN_TRANSFER_H
#define SV_TRAIN_TRANSFER_H

#include "src/rig/rig.h"

#ifdef __cplusplus
extern "C" {
#endif

// Pixel x of a at inverse depth w is seen by b at h x + w e (homogeneous).
typedef struct {
  float h[9], e[3];
  // Where one of the two is a fisheye: a point of a's camera frame is seen by b at r x + t.
  bool is_wide;
  const sv_view *a, *b;
  float r[9], t[3];
} sv_transfer;

// From view a to view b, which both must outlive it.
sv_transfer sv_transfer_make(const sv_view *b, const sv_view *a);
// uvz: the pixel and its depth times w; false: b does not see it.
bool sv_transfer_see(const sv_transfer *q, float x, float y, float w, float uvz[3]);
// Points of depth 1 in the camera's frame of n pixels of a row, from column x0 on; NaN outside the
// lens's range.
void sv_transfer_rays(const sv_view *a, int x0, int y, int n, float *const ray[3]);
// Where b sees sixteen of them at inverse depth w: pixel indices (0 is the first pixel's center),
// kept inside the picture, and 1 in is_in where it sees them. For transfers through lenses.
void sv_transfer_see16(const sv_transfer *q, const float *const ray[3], float w, float x[16], float y[16],
                       float is_in[16]);

#ifdef __cplusplus
}
#endif
#endif
