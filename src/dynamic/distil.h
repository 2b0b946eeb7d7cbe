// SPDX-License-Identifier: Apache-2.0
// Distils per-Gaussian motion to a field. Image gradients do not lead a field to large motion, so
// the field is first fitted by regression to motion that was trained per Gaussian, at the images'
// times and between them. Images constrain only their own times: a share of the later steps
// therefore trains on a rendering of the per-Gaussian model at a time between two images.
// The stored Gaussians, from which a field's offsets count, are those of the clip's middle time.
// Rigid bodies carry their members as before, along the poses that the clip found: the field has no
// room for fast motion of neighbors that go different ways.
#ifndef SV_DYNAMIC_DISTIL_H
#define SV_DYNAMIC_DISTIL_H

#include "src/dynamic/dynamic.h"

#ifdef __cplusplus
extern "C" {
#endif

// Residual weights of each row, those of the means in 1/unit^2.
typedef struct {
  float row[SV_ROW_LOGIT];
} sv_fit_weights;

// Of one block of 16 Gaussians that is at `is` [rows][16] and should be at `want`, e = is - want, o
// the opacity of is:
//   L = sum_i o_i (sqrt(1 + w |e_mean|^2) - 1 + sum_(other rows) w e^2 / 2),
// so that those for which a field has no room do not outvote the others. Rows from SV_ROW_LOGIT on
// do not take part.
double sv_fit_loss(const sv_fit_weights *p, const float *is, const float *want);
// dL/d(is) [n_rows][16]; opacity is not asked to give way.
void sv_fit_loss_bwd(const sv_fit_weights *p, const float *is, const float *want, int n_rows, float *grad);

// Progress of the present stage's schedules, of a run that has two.
float sv_distil_stage_progress(const sv_dynamic *dyn, float progress);
// The stored Gaussians become the clip's of the middle time, and the field, still at rest, is what
// moves them from now on; dyn->fit_steps_left steps of the fit are to come.
void sv_distil_begin(sv_dynamic *dyn);
// Some of them, a tenth of a second or less. progress is the run's: of one with a time limit the
// fit takes half of what is left at most.
void sv_distil_fit(sv_dynamic *dyn, float progress);
// Whether a distilled field moves the Gaussians, or is still being fitted.
bool sv_distil_is_on(const sv_dynamic *dyn);
// Between a training time and the next one, or the one before the last; `time` itself where there
// is no other.
float sv_distil_time_between(const sv_dynamic *dyn, float time, float share);
// The time of the next step on a picture of `time`: another one when it is to be the clip's.
float sv_distil_time(sv_dynamic *dyn, float time);
// The clip's picture of a view at its time as the target.
sv_status sv_distil_load_target(sv_dynamic *dyn, const sv_view *view, const sv_render_options *o) SV_MUST_USE;
// The field's step after a picture, at a progress of its stage.
void sv_distil_step_field(sv_dynamic *dyn, float progress);

#ifdef __cplusplus
}
#endif
#endif
