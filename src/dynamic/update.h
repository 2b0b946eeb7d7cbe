// SPDX-License-Identifier: Apache-2.0
// The optimizer's step of the motion model (update.c). Hooks of the trainer's update.
#ifndef SV_DYNAMIC_UPDATE_H
#define SV_DYNAMIC_UPDATE_H

#include "src/dynamic/dynamic.h"

#ifdef __cplusplus
extern "C" {
#endif

void sv_dynamic_begin_update(sv_dynamic *dyn, float progress, const sv_adam_args *adam);
void sv_dynamic_update_block(sv_dynamic *dyn, int block, int i_thread, uint32_t touched, float *grad,
                             float *scratch);
void sv_dynamic_pull_back(sv_dynamic *dyn, int block, uint32_t touched, float *grad);
// The field's or the bodies' step, after all blocks.
void sv_dynamic_finish_update(sv_dynamic *dyn, float progress);

// Gradients of a block of moving Gaussians with per-Gaussian motion, from those of the moved ones,
// and their step, as dyn->update says. touched: lanes. scratch [SV_CAP_MROWS][16].
void sv_dynamic_move_block(sv_dynamic *dyn, int block, uint32_t touched, float *grad, float *scratch);
// Adam's learning rates of the motion's rows for one step.
void sv_dynamic_rates(const sv_dynamic *dyn, float progress, float mean_lr, double bias1,
                      float lr[SV_CAP_MROWS]);

#ifdef __cplusplus
}
#endif
#endif
