// SPDX-License-Identifier: Apache-2.0
// Rendering as a camera measures: with one sample a pixel, or the mean of 2 x 2 (supersample.c).
// Owns the planes of the samples; who renders again takes them back.
#ifndef SV_TRAIN_SUPERSAMPLE_H
#define SV_TRAIN_SUPERSAMPLE_H

#include "src/train/train.h"

#ifdef __cplusplus
extern "C" {
#endif

sv_renderer_cfg sv_train_renderer_cfg(const sv_train_cfg *c); // of a trainer with these settings
void sv_train_supersample_carve(sv_supersample *s, size_t px,
                                sv_arena *a); // px: of the largest image, padded
// Whether an image at 1/scale has more than one sample a pixel.
bool sv_train_is_supersampled(const sv_trainer *t, int scale, float progress);
// Renders 2 x 2 samples a pixel of a view; their means go to t->supersample.mean.
sv_status sv_train_supersample(sv_trainer *t, const sv_view *view, const sv_render_options *o) SV_MUST_USE;
// A view as it is measured, with one sample a pixel or more. *out is the trainer's, until it
// renders again.
sv_status sv_train_measure(sv_trainer *t, const sv_view *view, const sv_render_options *o,
                           bool is_supersampled, const sv_planes **out) SV_MUST_USE;
// Spreads the gradient, returned, and the error (or NULL) of the means over the samples.
const sv_planes *sv_train_spread(sv_trainer *t, const sv_planes *grad, const float *err);
// From them back to the Gaussians.
sv_status sv_train_supersample_bwd(sv_trainer *t, const sv_planes *grad, const float *err) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
