// SPDX-License-Identifier: Apache-2.0
// The pose of a held-out view, refined against a model that stays as it is: direct image alignment
// by Gauss-Newton over the rendering's depth, coarse to fine. Never changes the model.
#ifndef SV_TOOLS_TRAIN_ALIGN_VIEW_H
#define SV_TOOLS_TRAIN_ALIGN_VIEW_H

#include "tools/train/evaluate.h"

#ifdef __cplusplus
extern "C" {
#endif

// What a view is aligned by. truth: [3][height][width] over the background; counted:
// [height][width], 0 where a pixel is ignored, NULL: none is.
typedef struct {
  lab_viewer *viewer;
  sv_gaussians *g; // at the view's time
  sv_render_options render;
  const float *truth;
  const uint8_t *counted;
} lab_align_job;

// Moves the view to where its squared error is lowest nearby; it is left alone where that is not
// found. E_NOMEM, and what sv_render returns.
sv_status lab_align_view(sv_view *v, const lab_align_job *job, sv_err *err) SV_MUST_USE;

// How far a view was moved.
double lab_view_turn_deg(const sv_view *a, const sv_view *b);
double lab_view_shift(const sv_view *a, const sv_view *b);

#ifdef __cplusplus
}
#endif
#endif
