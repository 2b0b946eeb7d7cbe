// SPDX-License-Identifier: Apache-2.0
// Multiplexed measurements of a dataset: one image of a whole sensor per exposure, and the frames
// of the transforms file that are its lenses. Of their own images, if there are any, the alpha
// alone is looked at.
#ifndef SV_TOOLS_DATASET_MEASUREMENT_H
#define SV_TOOLS_DATASET_MEASUREMENT_H

#include "src/rig/forward.h"
#include "tools/dataset/dataset.h"

// Finds the measurement of each exposure among v's frames that have a footprint. is_white: of
// sub-views over white, added as display values ("composites"); else of light over black
// ("composites_linear"). Where the file has one kind only, that one. v->measurements stays empty
// when the file has none.
sv_status lab_measurements_find(lab_views *v, const sv_transforms *t, const char *folder, bool is_white,
                                sv_err *err) SV_MUST_USE;

// Values of one measurement: 3 width height.
static inline size_t lab_measurement_values(const lab_measurement *m) {
  return 3 * (size_t)m->width_px * (size_t)m->height_px;
}
// Its lenses into out[m->n_lenses]. E_RANGE for footprints that do not fit.
sv_status lab_measurement_lenses(const lab_views *v, int i_measurement, sv_lens *out, sv_multiplexed *model,
                                 sv_err *err) SV_MUST_USE;
// 8 or 16 bits become display values of 65535; dst[height][width][3].
sv_status lab_measurement_load(const lab_measurement *m, uint16_t *dst, sv_err *err) SV_MUST_USE;
// With has_alpha: what its lenses see through, the sum of w (1 - alpha) / M_max, of 65535;
// dst[height][width].
sv_status lab_measurement_clear(const lab_views *v, int i_measurement, uint16_t *dst,
                                sv_err *err) SV_MUST_USE;

#endif
