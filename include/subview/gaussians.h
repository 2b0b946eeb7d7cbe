// SPDX-License-Identifier: Apache-2.0
// The trained model, Gaussian by Gaussian, and the files that hold it.
// Owns: the exchange form of one Gaussian.
// Never: opens files. Bytes go to a sink of the caller.
#ifndef SUBVIEW_GAUSSIANS_H
#define SUBVIEW_GAUSSIANS_H

#include <stddef.h>

#include "status.h"

#ifdef __cplusplus
extern "C" {
#endif

// One Gaussian with the stored (not activated) values of 3D Gaussian Splatting.
// SH above the model's degree is zero.
typedef struct {
  float mean[3];       // world, metres
  float quat_wxyz[4];  // rotation, not normalized
  float log_scale[3];  // natural logarithm of the standard deviations, metres
  float opacity_logit; // opacity = 1 / (1 + exp(-logit))
  float sh[16][3];     // spherical harmonics, RGB; colour = 0.5 + 0.2820948 sh[0] + ...
} subview_gaussian;

typedef enum {
  SUBVIEW_FILE_PLY,  // 3DGS PLY, binary: all values; opens in 3DGS viewers
  SUBVIEW_FILE_SPLAT // .splat of web viewers: 32 bytes per Gaussian, without view-dependent
                     // colour
} subview_file;

// Where the bytes of a file go. `write` is called with pieces of at most 4096 bytes, never with 0,
// and returns SUBVIEW_OK or a failure, which ends the save and is returned to its caller.
typedef struct {
  void *self;
  subview_status (*write)(void *self, const void *data, size_t bytes);
} subview_sink;

#ifdef __cplusplus
}
#endif
#endif
