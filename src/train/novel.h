// SPDX-License-Identifier: Apache-2.0
// Novel views: renderings that no camera took, regularized by their total variation (the paper,
// section 3.2).
#ifndef SV_TRAIN_NOVEL_H
#define SV_TRAIN_NOVEL_H

#include "src/train/train.h"

#ifdef __cplusplus
extern "C" {
#endif

// Whether this step regularizes novel views.
bool sv_train_is_novel_due(const sv_trainer *t);
// A novel view beside a random captured one, turned about the scene's centre, reduced in size.
sv_view sv_train_novel_view(sv_trainer *t);
// A view turned about the scene's centre by up to `rad`, about a random axis.
sv_view sv_train_turned_view(const sv_trainer *t, const sv_view *v, float rad, sv_rng *rng);
// Renders this step's novel views and adds the gradients of their regularizer to the step's sum.
sv_status sv_train_novel_step(sv_trainer *t, const sv_render_options *o, double *loss) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
