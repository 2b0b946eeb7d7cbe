// SPDX-License-Identifier: Apache-2.0
// Masked pixels of training views (sv_image_u8.mask): the target takes the rendering's values
// there, so that nothing differs, and the gradient is 0. A pixel of a reduced image is masked when
// one that it is the mean of is. Owns nothing. Never changes pixels that count, nor images without
// a mask.
#ifndef SV_TRAIN_MASK_H
#define SV_TRAIN_MASK_H

#include "src/train/train.h"

#ifdef __cplusplus
extern "C" {
#endif

// `to` takes the values of `from` where the image at 1/scale is masked; both have its size. im may
// be NULL: nothing is masked.
void sv_train_mask_copy(const sv_trainer *t, const sv_image_u8 *im, int scale, const sv_planes *from,
                        sv_planes *to);
// The same, with 0 for values.
void sv_train_mask_clear(const sv_trainer *t, const sv_image_u8 *im, int scale, sv_planes *to);

// Weight of a view's loss: pixels that count carry the whole of it, so that the regularization does
// not gain on what is left. 1 without masks.
static inline float sv_train_mask_weight(const sv_trainer *t) {
  return t->n_views ? (float)((double)t->n_views / t->share) : 1.0f;
}

#ifdef __cplusplus
}
#endif
#endif
