// SPDX-License-Identifier: Apache-2.0
// Continuous capture: replaces Gaussians that contradict the newest exposure. Where renderings
// differ from its images, the visible Gaussians are removed, and as many are placed on the surface
// of the exposure's own depth maps (sweep.h), in its colors. So objects that moved far, or
// appeared, start at their position.
//
// Owns nothing. Never changes the number of Gaussians.
#ifndef SV_DYNAMIC_RENEW_H
#define SV_DYNAMIC_RENEW_H

#include "src/dynamic/dynamic.h"
#include "src/train/sweep.h"

#ifdef __cplusplus
extern "C" {
#endif

// Call it when a new exposure has been added. Counts in dyn->n_renewed. Does nothing when no two
// views of the newest time overlap, or their depth cannot be measured.
// Scratch: sv_sweep_bytes. Errors: of rendering.
sv_status sv_dynamic_renew(sv_dynamic *dyn, float progress, sv_arena *scratch) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
