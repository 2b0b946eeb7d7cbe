// SPDX-License-Identifier: Apache-2.0
// Gaussians far beyond the scene, as backgrounds outdoors need them. A step that suits the scene is
// nothing at a hundred times its distance, so these take theirs in units of their own distance.
// Owns nothing; never touches Gaussians within reach, whose bits stay as they are.
#ifndef SV_TRAIN_REACH_H
#define SV_TRAIN_REACH_H

#include "src/train/train.h"

#ifdef __cplusplus
extern "C" {
#endif

// Lanes of a block [rows][16] that are beyond reach. factor[16]: their distance in reaches, 1 for
// the others.
uint32_t sv_reach_beyond(const sv_trainer *t, const float *p, float factor[16]);
// Gradients [rows][16] of their means in units of that distance.
void sv_reach_scale(uint32_t beyond, const float factor[16], float *grad);

#ifdef __cplusplus
}
#endif
#endif
