// SPDX-License-Identifier: Apache-2.0
// Pixels that show what the training views pin down, by the support of a model's Gaussians
// (src/splat/support.h).
#ifndef SV_TOOLS_TRAIN_SUPPORT_MASK_H
#define SV_TOOLS_TRAIN_SUPPORT_MASK_H

#include "src/splat/support.h"
#include "tools/train/evaluate.h"

// Support of a still model by the views of `train` (its split is "train"), in a malloc'ed *block
// that the caller frees, also after a failure. weight: NULL, or [SV_SUPPORT_VIEWS][n] where the sum
// of alpha times transmittance over the pixels of each view goes.
sv_status lab_support_measure(sv_support *out, void **block, const lab_eval_job *job, const lab_source *train,
                              float *weight, sv_err *err) SV_MUST_USE;

typedef struct lab_support_mask lab_support_mask;

// For views of v.
sv_status lab_support_mask_open(lab_support_mask **out, const lab_eval_job *job, const lab_views *v,
                                const lab_source *train, sv_err *err) SV_MUST_USE;
void lab_support_mask_close(lab_support_mask *m); // also NULL

// mask [height][width] = 1: the Gaussians' weights times their scores add up to a half or more.
sv_status lab_support_mask_make(lab_support_mask *m, const sv_view *view, uint8_t *mask,
                                sv_err *err) SV_MUST_USE;

#endif
