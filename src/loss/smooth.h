// SPDX-License-Identifier: Apache-2.0
// Edge-aware smoothness of rendered inverse depth (Godard et al. 2017, eq. 6, with 1 / (1 + k |dI|)
// for the exponential): surfaces are smooth where the picture is.
//   L = weight / (n u) sum over neighbors i, j of |d_i - d_j| / (1 + 10 |I_i - I_j|_1)
// d = A / D is the inverse of the expected depth, with A = 1 - T and D = sum w z; n is the number
// of pixels that have one and u its mean. u counts as a constant. Steps of more than a twentieth of
// u are edges of the depth itself and do not count. Owns the planes of its gradient. Never looks at
// pixels of too little alpha.
#ifndef SV_LOSS_SMOOTH_H
#define SV_LOSS_SMOOTH_H

#include "src/base/arena.h"
#include "src/port/compute.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  size_t cap_pixels; // of a plane, with its padding
  int cap_height_px;
} sv_smooth_cfg;

typedef struct {
  sv_compute compute;
  float *inverse;           // [height_px][stride] A / D, 0 where the alpha is too low
  float *g_depth, *g_trans; // [rows_padded][stride] dL/dD and dL/dT of the last loss
  double *band;             // [cap_height_px / 16 + 1][2] sums; free between two calls
  long n_px;                // pixels of the last image that have an inverse depth
} sv_smooth;

// Planes of one image, [rows_padded][stride].
typedef struct {
  const float *depth, *trans; // D and T as rendered
  const float *colour[3];     // of the picture, 0 to 1
  int width_px, height_px, stride, rows_padded;
  float alpha_min; // pixels of less alpha do not count; above 0
  float weight;
} sv_smooth_input;

// Takes its memory from the arena.
sv_status sv_smooth_init(sv_smooth *s, const sv_smooth_cfg *cfg, sv_compute compute,
                         sv_arena *arena) SV_MUST_USE;

// Returns L and leaves its gradient in g_depth and g_trans, with 0 in the padding. The same bits
// for any number of threads.
double sv_smooth_loss(sv_smooth *s, const sv_smooth_input *in);

#ifdef __cplusplus
}
#endif
#endif
