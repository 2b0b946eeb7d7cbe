// SPDX-License-Identifier: Apache-2.0
// The interface for priors from outside (docs/priors.md), between two steps of a trainer with a
// ring for them (sv_train_cfg.prior): ask for views that no camera took, render them, hand in a
// better picture or a depth map. What was handed in takes part in the steps that follow:
// pseudo-views as further pictures, depth maps beside the picture of their view.
#ifndef SV_PRIOR_VIEWS_H
#define SV_PRIOR_VIEWS_H

#include "src/prior/prior.h"

#ifdef __cplusplus
extern "C" {
#endif

// below, a rendering knows neither depth nor colour (Difix3D+ masks by it)
#define SV_PRIOR_ALPHA_MIN 0.5f

// n views from beside those that were taken, of their size: a view that was trained on, drawn at
// random, turned about the scene's centre by up to turn_rad (for multiplexed sensors there are
// none: E_UNSUPPORTED).
sv_status sv_prior_request_views(sv_prior *prior, float turn_rad, int n, sv_view *out) SV_MUST_USE;
// Renders a view into prior->t->render (rgb; alpha = 1 - trans) and prior->expected (depth along
// the axis, 0 where alpha is below SV_PRIOR_ALPHA_MIN; plane with the picture's stride).
sv_status sv_prior_render(sv_prior *prior, const sv_view *view, float progress) SV_MUST_USE;
// The training view nearest to a view: the least angle between where they stand, seen from the
// scene's centre.
int sv_prior_nearest(const sv_prior *prior, const sv_view *view);
// sv_prior_submit_view and sv_prior_submit_depth (prior.h) on prior hand in what came back.

// --- pieces of a step, for the trainer and tests -------------------------------------------------
// Whether this step takes a pseudo-view beside its own.
bool sv_prior_is_due(const sv_prior *prior, float progress);
// The depth map of a view as rendered at 1/scale; NULL: none.
const sv_prior_depth *sv_prior_depth_of(const sv_prior *prior, int id, const sv_view *full);
// Loss of the last picture's depth (rendered with has_depth) against a map at 1/scale. Its
// gradient, times `weight`, is left in prior->g_depth and g_trans, for sv_render_bwd.
double sv_prior_depth_loss(sv_prior *prior, const sv_prior_depth *d, int scale, float weight);
// What share of its weight depth has at a progress.
float sv_prior_depth_share(const sv_prior *prior, float progress);
// Renders one of the pseudo-views and adds its gradients to the step's sum.
sv_status sv_prior_step(sv_prior *prior, float progress, const sv_render_options *o,
                        double *loss) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
