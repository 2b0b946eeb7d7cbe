// SPDX-License-Identifier: Apache-2.0
// Which views get a depth map, and with which others each is compared; a part of sweep.h.
// Owns nothing; never looks at pictures.
#ifndef SV_TRAIN_SWEEP_VIEWS_H
#define SV_TRAIN_SWEEP_VIEWS_H

#include "src/train/sweep.h"

#ifdef __cplusplus
extern "C" {
#endif

// Sets the views and the number of s's maps: all that there are, or groups of neighbours from all
// sides.
void sv_sweep_choose_views(sv_sweep *s, const sv_trainer *t, const sv_bounds *bounds);
// Sets the sources of map i, the best first. z: depth of the scene in its view.
void sv_sweep_choose_sources(sv_sweep *s, int i, double z);

#ifdef __cplusplus
}
#endif
#endif
