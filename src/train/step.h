// SPDX-License-Identifier: Apache-2.0
// A step's choice and images. Owns nothing: target, gradient and error planes are the trainer's;
// who else fills them says so by taking them as an argument.
#ifndef SV_TRAIN_STEP_H
#define SV_TRAIN_STEP_H

#include "src/train/train.h"

#ifdef __cplusplus
extern "C" {
#endif

// Views and regions are drawn without replacement; regions lie elsewhere in each epoch.
int sv_train_next_item(sv_trainer *t);
// Reduction of a view's image: by coarse to fine, at least min_scale, and no smaller than 64 pixels
// a side.
int sv_train_scale_at(const sv_trainer *t, const sv_view *view, float progress, int min_scale);
// Gives t->target, t->grad and t->err_plane this size, their padding cleared.
void sv_train_size_images(sv_trainer *t, int width_px, int height_px);
// An image at 1/scale over the background, into t->target or t->grad; both get its size.
// What a view is trained on at a scale, into t->target: its image, or its deep picture as its
// camera's noise curve shows it (appearance.h).
void sv_train_load_target(sv_trainer *t, int i_view, int scale, const float bg[3]);
void sv_train_load_image(sv_trainer *t, const sv_image_u8 *im, int scale, const float bg[3], sv_planes *out);
// Multiplies t->grad, and the errors of the image where they are not NULL, by a weight.
void sv_train_weigh(sv_trainer *t, float weight, float *err);

#ifdef __cplusplus
}
#endif
#endif
