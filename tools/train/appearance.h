// SPDX-License-Identifier: Apache-2.0
// Appearance of a dataset's cameras and exposures (src/train/appearance.h): which frame is of
// which. Frames without an exposure number are exposures of their own.
#ifndef SV_TOOLS_TRAIN_APPEARANCE_H
#define SV_TOOLS_TRAIN_APPEARANCE_H

#include "src/train/train.h"
#include "tools/dataset/dataset.h"

#ifdef __cplusplus
extern "C" {
#endif

// Counts cameras and exposures into cfg, as mode says: cameras, exposures (and cameras), or off
// (also NULL). E_ARG and E_UNSUPPORTED with a sentence where the frames do not allow it.
sv_status lab_appearance_plan(const lab_views *v, const char *mode, sv_train_cfg *cfg,
                              sv_err *err) SV_MUST_USE;
// Frame i_frame is view i_view of the trainer.
void lab_appearance_set(const lab_views *v, int i_frame, sv_trainer *t, int i_view);

#ifdef __cplusplus
}
#endif
#endif
