// SPDX-License-Identifier: Apache-2.0
// Live: what the newest exposure shows elsewhere, or for the first time, is not travelled to. Where
// the model's pictures are off, the Gaussians that are seen there go, and as many come back on the
// surface that the newest exposure's own depth maps tell of (sweep.h), in its colours. However far
// things moved meanwhile, they start in place.
#ifndef SV_DYNAMIC_RENEW_H
#define SV_DYNAMIC_RENEW_H

#include "src/dynamic/dynamic.h"
#include "src/train/sweep.h"

#ifdef __cplusplus
extern "C" {
#endif

// For a moving scene whose newest pictures have just come in. Counts in dyn->n_renewed. Does
// nothing where no two views of the newest time overlap, or nothing can be measured in them.
// Scratch: sv_sweep_bytes. Errors: of rendering.
sv_status sv_dynamic_renew(sv_dynamic *dyn, float progress, sv_arena *scratch) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
