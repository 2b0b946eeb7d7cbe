// SPDX-License-Identifier: Apache-2.0
// Local motion: neighbors on one surface move alike, so the displacement of a Gaussian that the
// images do not determine is interpolated from its neighbors. A rigid motion is affine in position:
// an affine function is fitted to the neighbors' displacements (weighted least squares with a ridge
// towards pure translation), with Geman & McClure's weights against outliers.
// Owns its arrays, carved once. Never allocates and never looks at images.
#ifndef SV_DYNAMIC_LOCAL_MOTION_H
#define SV_DYNAMIC_LOCAL_MOTION_H

#include "kernels/kernels.h"
#include "src/base/arena.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  float x[3], u[3]; // position at one time and displacement to another, world units
  bool is_known;    // u and a
  float a[6];       // information of u: squared pixels, as the cameras see them, per squared unit;
                    // 3 x 3 by rows
} sv_displaced;

typedef struct {
  sv_displaced *of; // [cap], by Gaussian
  uint32_t *order;  // [n] Gaussians along a Morton curve (Morton 1966)
  int32_t *at;      // [cap] position of a Gaussian in order
  sv_pair *pair, *tmp;
  uint32_t *hist;
  int n;
} sv_local_motion;

// NULL on a dry arena and when the block is too small.
sv_local_motion *sv_local_motion_carve(int cap, sv_arena *a);
// Sorts the n Gaussians of b->order along the curve. Their positions are clamped to within 2 half
// of the center.
void sv_local_motion_find(sv_local_motion *b, const sv_kernels *k, int n, const float centre[3], float half);
// Interpolates the displacement of Gaussian i, one of those found, from neighbors whose
// displacement is known. False: there are too few.
bool sv_local_motion_interpolate(const sv_local_motion *b, int i, float u[3]);

// a x = b, a symmetric by rows (xx xy xz yy yz zz). False where a is not positive definite.
bool sv_solve3(const float a[6], const float b[3], float x[3]);

#ifdef __cplusplus
}
#endif
#endif
