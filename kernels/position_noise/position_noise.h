// SPDX-License-Identifier: Apache-2.0
// SGLD position noise of 3DGS-MCMC (Kheradmand et al. 2024, eq. 8): nearly transparent Gaussians
// are moved by noise that has their own covariance.
#ifndef SV_KERNELS_POSITION_NOISE_H
#define SV_KERNELS_POSITION_NOISE_H

#include <stdint.h>

#include "kernels/project/project.h"

#ifdef __cplusplus
extern "C" {
#endif

// p: [rows][16] of a block (SV_ROW_*), only the means change; eta: [3][16] standard normal numbers.
// Of the lanes in on:
//   mean += gate R (min(gain s, 1) s eta),  gate = 1 / (1 + exp(100 (o - dead)))
// Per axis at most one sigma times eta, because budgets of thousands have large Gaussians. Needs
// finite parameters. exact.
typedef void sv_position_noise_fn(float *p, uint32_t on, const float *eta, float gain, float dead);

// After a step, of a block's lanes in on: the running mean of their errors, e = keep e + (1 - keep)
// err, both [16]. Returns all lanes whose logit [16] is not above `limit`: those that get noise.
// exact.
typedef uint32_t sv_blend_errors_fn(uint32_t on, float keep, const float *err, float *e, const float *logit,
                                    float limit);

#define SV_POSITION_NOISE_LOG2E     1.44269504f
#define SV_POSITION_NOISE_STEEPNESS 144.269504f // 100 log2(e)

#ifdef __cplusplus
}
#endif
#endif
