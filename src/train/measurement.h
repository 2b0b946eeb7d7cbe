// SPDX-License-Identifier: Apache-2.0
// Steps on multiplexed measurements: sensors on which lens images overlap, taken region by region.
#ifndef SV_TRAIN_MEASUREMENT_H
#define SV_TRAIN_MEASUREMENT_H

#include "src/train/train.h"

#ifdef __cplusplus
extern "C" {
#endif

// Region i of a measurement under this epoch's shift; all have the same size, and together they
// cover the sensor.
sv_region sv_train_region(const sv_trainer *t, const sv_train_measurement *c, int i);
// Renders a region as it would be measured, into t->forward.predicted. *n_px: pixels of lens images
// that were rendered; *last: the lens whose part the renderer still holds, -1 when none lights the
// region. Both may be NULL.
sv_status sv_train_predict(sv_trainer *t, const sv_multiplexed *c, const sv_region *region,
                           const sv_render_options *o, int *last, size_t *n_px) SV_MUST_USE;
// Renders region i, of those of all measurements, and adds the gradients of its loss to the step's
// sum.
sv_status sv_train_region_step(sv_trainer *t, int i, float progress, const sv_render_options *o,
                               sv_step_stats *out) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
