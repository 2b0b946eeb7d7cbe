// SPDX-License-Identifier: Apache-2.0
// Novel views: renderings that no camera took, as regularizers. Those of lens grids lie beside any
// captured view and are reduced; what they cost is their total variation (the paper, section 3.2).
// Those of a few exposures of other rigs lie beside the view of the step and have its size: their
// depth is smooth, too, and they show the colors of its picture where both show the same surface,
// as in Binocular3DGS (Han et al. 2024), which warps along a baseline.
#ifndef SV_TRAIN_NOVEL_H
#define SV_TRAIN_NOVEL_H

#include "src/train/train.h"

#ifdef __cplusplus
extern "C" {
#endif

// Whether novel views lie beside the view of the step.
bool sv_train_is_novel_beside(const sv_train_cfg *c);
// Whether one lies beside this image; asked after its before_render hook. None does in 16-bit
// light.
bool sv_train_has_novel(const sv_trainer *t, const sv_train_image *im);
// Whether this step regularizes novel views. im: its image, zero when it took a region.
bool sv_train_is_novel_due(const sv_trainer *t, const sv_train_image *im);
// A novel view beside a random captured one, turned about the scene's centre, reduced in size.
sv_view sv_train_novel_view(sv_trainer *t);
// A view turned about the scene's centre by up to `rad`, about a random axis.
sv_view sv_train_turned_view(const sv_trainer *t, const sv_view *v, float rad, sv_rng *rng);
// Renders this step's novel views and adds the gradients of their regularizers to the step's sum.
// The renderer still holds the step's image.
sv_status sv_train_novel_step(sv_trainer *t, const sv_train_image *im, const sv_render_options *o,
                              double *loss) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
