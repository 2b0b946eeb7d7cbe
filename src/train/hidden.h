// SPDX-License-Identifier: Apache-2.0
// Hidden Gaussians: those that lie far behind the surface in every view. No view trains them, so
// they stay as they started, and are floaters to who looks from elsewhere. Backgrounds beyond
// SV_REACH_RADII are left alone.
#ifndef SV_TRAIN_HIDDEN_H
#define SV_TRAIN_HIDDEN_H

#include "src/train/train.h"

#ifdef __cplusplus
extern "C" {
#endif

// Whether the step that was just counted looks for them.
bool sv_train_is_hidden_due(const sv_trainer *t, float progress);
// Makes them dead, so that the relocation of this step takes them; *n: how many. Renders views, at
// most SV_SUPPORT_VIEWS of them, spread evenly.
sv_status sv_train_prune_hidden(sv_trainer *t, int *n) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
