// SPDX-License-Identifier: Apache-2.0
// One Gaussian in exchange formats: the stored (not activated) parameters of 3DGS.
#ifndef SV_FORMAT_GAUSSIAN_H
#define SV_FORMAT_GAUSSIAN_H

#include <stddef.h>

#include "src/base/status.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_GAUSSIAN_FLOATS 59
// Number of leading floats of sv_gaussian that a model of this SH degree uses.
#define SV_GAUSSIAN_N_FLOATS(sh_degree) (11 + 3 * ((sh_degree) + 1) * ((sh_degree) + 1))
#define SV_SH_C0                        0.28209479177387814 // colour = 0.5 + C0 * DC coefficient

typedef struct {
  float mean[3];      // world units
  float quat_wxyz[4]; // not normalised
  float log_scale[3]; // natural logarithm of the standard deviations
  float opacity_logit;
  float sh[16][3]; // coefficient-major, RGB inside; zero above the model's degree
} sv_gaussian;

// Receives a writer's bytes. Never called with 0 bytes.
typedef struct {
  void *self;
  sv_status (*write)(void *self, const void *data, size_t bytes, sv_err *err);
} sv_sink;

#ifdef __cplusplus
}
#endif
#endif
