// SPDX-License-Identifier: Apache-2.0
// Bounds of the scene, from the cameras alone.
#ifndef SV_RIG_BOUNDS_H
#define SV_RIG_BOUNDS_H

#include "src/rig/rig.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  float centre[3], radius; // world; a ball that holds what the cameras look at
} sv_bounds;

// Centre: the point nearest to all optical axes (least squares). Radius: 0.35 x the mean distance
// of the cameras to it. If the axes are nearly parallel, the ball lies ahead of the cameras, at ten
// times their extent (one camera: at distance 1). n >= 1.
sv_bounds sv_bounds_of_views(const sv_view *views, int n);

#ifdef __cplusplus
}
#endif
#endif
