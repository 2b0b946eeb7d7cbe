// SPDX-License-Identifier: Apache-2.0
// The interface for external priors (docs/priors.md), between two training steps: request
// pseudo-views, render them, submit an improved image or a depth map. Submitted pseudo-views are
// further training images of the following steps; depth maps add a depth loss to their view.
// Owns nothing: rings and planes are sv_prior's. Never changes a training view.
#ifndef SV_PRIOR_VIEWS_H
#define SV_PRIOR_VIEWS_H

#include "src/prior/prior.h"

#ifdef __cplusplus
extern "C" {
#endif

// Pixels of less alpha have neither depth nor color (Difix3D+ masks by it).
#define SV_PRIOR_ALPHA_MIN 0.5f

// n pseudo-views near captured ones, of their size: a random training view, rotated about the
// scene's center by up to turn_rad. E_UNSUPPORTED for multiplexed sensors.
sv_status sv_prior_request_views(sv_prior *prior, float turn_rad, int n, sv_view *out) SV_MUST_USE;
// Renders a view into prior->t->render (rgb; alpha = 1 - trans) and prior->expected (depth along
// the axis, 0 where alpha is below SV_PRIOR_ALPHA_MIN; plane with the image's stride).
sv_status sv_prior_render(sv_prior *prior, const sv_view *view, float progress) SV_MUST_USE;
// The nearest training view: the smallest angle between camera positions, seen from the scene's
// center.
int sv_prior_nearest(const sv_prior *prior, const sv_view *view);

// --- pieces of a step, for the trainer and tests -------------------------------------------------
// Whether this step takes a pseudo-view beside its own.
bool sv_prior_is_due(const sv_prior *prior, float progress);
// The depth map of a view as rendered at 1/scale; NULL: none.
const sv_prior_depth *sv_prior_depth_of(const sv_prior *prior, int id, const sv_view *full);
// Loss of the last rendering's depth (with has_depth) against a map at 1/scale. Its
// gradient, times `weight`, is left in prior->g_depth and g_trans, for sv_render_bwd.
double sv_prior_depth_loss(sv_prior *prior, const sv_prior_depth *d, int scale, float weight);
// Share of its weight that the depth loss has at a progress, 0 to 1.
float sv_prior_depth_share(const sv_prior *prior, float progress);
// Renders one of the pseudo-views and adds its gradients to the step's sum.
sv_status sv_prior_step(sv_prior *prior, float progress, const sv_render_options *o,
                        double *loss) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
