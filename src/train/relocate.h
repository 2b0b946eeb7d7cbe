// SPDX-License-Identifier: Apache-2.0
// Relocation of dead Gaussians to where the error is (3DGS-MCMC, Kheradmand et al. 2024, weighted
// by error).
#ifndef SV_TRAIN_RELOCATE_H
#define SV_TRAIN_RELOCATE_H

#include "src/train/train.h"

#ifdef __cplusplus
extern "C" {
#endif

// Whether the step that was just counted relocates.
bool sv_train_is_relocation_due(const sv_trainer *t, float progress);
// Relocates Gaussians of opacity <= SV_OPACITY_DEAD, and what relocate_share asks for; returns how
// many.
uint32_t sv_train_relocate(sv_trainer *t, float progress);
// A Gaussian becomes a copy of another, with running means of its own.
void sv_train_copy_slot(sv_trainer *t, int to, int from);
// Opacity and scale factor of n copies that together look like one Gaussian of opacity o: 1 -
// (1-o)^(1/n) and o / K (3DGS-MCMC eq. 9).
void sv_relocation_split(double o, int n, double *o_new, double *scale_factor);

#ifdef __cplusplus
}
#endif
#endif
