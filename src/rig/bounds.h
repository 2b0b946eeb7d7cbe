// SPDX-License-Identifier: Apache-2.0
// Where the scene is, from the cameras alone.
#ifndef SV_RIG_BOUNDS_H
#define SV_RIG_BOUNDS_H

#include "src/rig/rig.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  float centre[3], radius; // world; a ball that holds what the cameras look at
} sv_bounds;

// The point nearest to all optical axes (least squares), and 0.35 x the mean distance of the
// cameras to it. Nearly parallel axes meet nowhere: the ball then lies ahead of the cameras, at ten
// times their spread (one camera: at distance 1). n >= 1.
sv_bounds sv_bounds_of_views(const sv_view *views, int n);

#ifdef __cplusplus
}
#endif
#endif
