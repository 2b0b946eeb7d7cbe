// SPDX-License-Identifier: Apache-2.0
// Losses of rendered depth for few exposures: smooth surfaces (src/loss/smooth.h) on which the
// other cameras of the exposure see the same colors (src/loss/reproject.h).
#ifndef SV_TRAIN_SURFACE_H
#define SV_TRAIN_SURFACE_H

#include "src/train/train.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_SURFACE_ALPHA_MIN 0.5f // pixels of less alpha have no depth

// Whether the pictures show what is rendered in the same place, in the same colors.
bool sv_train_has_same_colours(const sv_trainer *t);
// Whether an image of this step has them; asked after its before_render hook.
bool sv_train_is_surface_due(const sv_trainer *t, const sv_train_image *im);
// Smoothness of the depth that was rendered, edges by `colour`, planes of its size. Leaves inverse
// depth and gradient in t->smooth.
double sv_train_smooth_loss(sv_trainer *t, float *const colour[3], float weight);
// Their value. im gets their gradient. Reads the rendering and the step's target.
double sv_train_surface_loss(sv_trainer *t, sv_train_image *im);

#ifdef __cplusplus
}
#endif
#endif
