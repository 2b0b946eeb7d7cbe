// SPDX-License-Identifier: Apache-2.0
// Gaussians of one instant: position, rotation and colour of each are sums of a few functions of
// time that all share, its opacity is a window in time (Spacetime Gaussians, Li et al. 2024,
// section 4.1, with functions of the clip's time instead of powers of the time to each centre).
//
// Motion is stored like the Gaussians, in blocks of 16: [n_blocks][n_motion_rows][16] floats.
// Rows:
//   0 centre of the window, in time 0..1 | 1 ln of its sharpness |
//   2 + 3 j + i: function j of mean i | then 4 j + i: function j of quaternion entry i |
//   then 3 j + c: function j of the SH coefficient 0 of channel c.
//   mean(t) = mean + sum_j f_j(t) c_j, the others likewise
//   logit(t) = logit - exp(row 1) (t - row 0)^2
// The window is subtracted from the logit: an opaque Gaussian stays opaque until it goes.
#ifndef SV_KERNELS_MOTION_H
#define SV_KERNELS_MOTION_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define SV_CAP_MOTION_FUNCTIONS    12
#define SV_MROW_CENTRE             0
#define SV_MROW_SHARPNESS          1
#define SV_MROW_FUNCTIONS          2
#define SV_N_MROWS(pos, rot, colr) (SV_MROW_FUNCTIONS + 3 * (pos) + 4 * (rot) + 3 * (colr))
#define SV_CAP_MROWS               SV_N_MROWS(SV_CAP_MOTION_FUNCTIONS, SV_CAP_MOTION_FUNCTIONS, SV_CAP_MOTION_FUNCTIONS)
#define SV_WINDOW_MAX              30.0f // what a window takes from a logit at most

typedef struct {
  const float *param;  // [n_blocks][n_rows][16] the Gaussians (kernels/project/project.h)
  const float *motion; // [n_blocks][n_motion_rows][16]
  // [n_blocks][n_rows][16] out: those of time t; not read by the backward
  float *moved;
  int n_rows;                 // of param
  int n_pos, n_rot, n_colour; // functions in use, each at most SV_CAP_MOTION_FUNCTIONS
  // [n_pos], [n_rot], [n_colour] values of the functions at t
  const float *f_pos, *f_rot, *f_colour;
  float t;                         // 0..1
  float reg_pos, reg_rot, reg_col; // backward: see below
} sv_motion_args;

// Blocks [block0, block1) of moved. exact.
typedef void sv_motion_fn(const sv_motion_args *a, int block0, int block1);

// Gradient of one block. grad [n_rows][16]: dL/d(moved), which is dL/d(param), too. Out:
// grad_motion [n_motion_rows][16], 0 in lanes whose bit in touched is 0. Touched lanes get the
// gradient of reg_pos |all c of the mean| + reg_rot |those of the quaternion| + reg_col |those of
// the colour| (the lengths of the vectors of all coefficients: what does not need to move comes to
// rest as a whole). exact.
typedef void sv_motion_bwd_fn(const sv_motion_args *a, int block, uint32_t touched, const float *grad,
                              float *grad_motion);

#ifdef __cplusplus
}
#endif
#endif
