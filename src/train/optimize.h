// SPDX-License-Identifier: Apache-2.0
// Gradients of one step -> parameters, block by block of 16 Gaussians. Owns the optimizer's
// moments, held by the trainer.
#ifndef SV_TRAIN_OPTIMIZE_H
#define SV_TRAIN_OPTIMIZE_H

#include "src/train/train.h"

#ifdef __cplusplus
extern "C" {
#endif

// Floats of sv_trainer.block a thread: a block's gradients, its error, its motion's gradients.
#define SV_TRAIN_BLOCK_FLOATS ((SV_CAP_ROWS + 1 + SV_CAP_MROWS) * 16)
#define SV_TRAIN_TASK_BLOCKS  32 // blocks of one task

float sv_train_mean_lr(const sv_train_cfg *cfg, float progress); // per unit of scene radius
// Short-run learning-rate boost: runs of less than 2,000 steps, of still scenes, have higher rates
// of scales, opacities and colours (Adam's), and end with higher ones of means: by
// sqrt(2000 / expected_steps), at most 2.5; the means' by its square.
float sv_train_short_run_boost(const sv_train_cfg *cfg);
// Factor on all rates at this progress (sv_train_cfg.settle_from).
float sv_train_settling(const sv_train_cfg *cfg, float progress);
// Minimum log-scales from the views that see each Gaussian: the log of min_scale_px z / f at the
// highest f / z. What is smaller was never measured (Mip-Splatting, Yu et al. 2024, eq. 7), and
// would look thin from nearer cameras.
void sv_train_set_floors(sv_trainer *t);
// Whether this step's errors are added to the Gaussians' running means, which relocation asks for.
// One step of each four, drawn: the means change slowly, and a backward pass without them is
// shorter. None after the last relocation.
#define SV_TRAIN_ERROR_EVERY 4u
bool sv_train_is_error_due(const sv_trainer *t, float progress);
// Rows of a Gaussian's parameters, from the first on, that Gauss-Newton moves; Adam moves the rest.
int sv_train_newton_rows(const sv_trainer *t);
// The weights that share of the regularizers has at a progress.
sv_regularisers sv_train_regularisers(const sv_trainer *t, float progress, float share);
// Gradients of the last rendering -> parameters of all touched blocks; returns the touched
// Gaussians.
uint32_t sv_train_optimise(sv_trainer *t, float progress);
// The same in two halves, for steps with several images: add the last rendering's gradients, with
// regularizers or NULL, to the sum; then use the sum.
void sv_train_collect(sv_trainer *t, const sv_regularisers *reg, bool has_err);
uint32_t sv_train_apply(sv_trainer *t, float progress);
int sv_train_n_tasks(const sv_trainer *t); // of an update

#ifdef __cplusplus
}
#endif
#endif
