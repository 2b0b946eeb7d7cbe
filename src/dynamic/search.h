// SPDX-License-Identifier: Apache-2.0
// Search for what moves (search.c), by the residuals of the training images.
#ifndef SV_DYNAMIC_SEARCH_H
#define SV_DYNAMIC_SEARCH_H

#include "src/dynamic/dynamic.h"

#ifdef __cplusplus
extern "C" {
#endif

// pixels: a Gaussian that covers less of an image is not judged by it
#define SV_DYNAMIC_SHARE_MIN 1.0f

// Renders a training view, at half size at most, and leaves its residual in the trainer's
// err_plane; no gradients.
sv_status sv_dynamic_residual(sv_dynamic *dyn, int i_view, float progress) SV_MUST_USE;
// Adds each Gaussian's share of that image, in pixels, to dyn->share, and of its residual to
// dyn->residual. Reuses the trainer's target, whose values are gone afterwards.
sv_status sv_dynamic_share_residual(sv_dynamic *dyn) SV_MUST_USE;
void sv_dynamic_clear_shares(sv_dynamic *dyn);
// Gaussians that move too little come to rest, the moving ones are put first.
void sv_dynamic_sort(sv_dynamic *dyn);

#ifdef __cplusplus
}
#endif
#endif
