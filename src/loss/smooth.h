// SPDX-License-Identifier: Apache-2.0
// Edge-aware smoothness of rendered inverse depth (Godard et al. 2017, eq. 6, with 1 / (1 + k |dI|)
// for the exponential): surfaces are smooth where the picture is.
//   L = weight / (n unit) sum over neighbours i, j of |d_i - d_j| / (1 + 10 |I_i - I_j|_1)
// Steps of more than a twentieth of `unit` are edges of the depth itself and do not count. Owns
// nothing. Never looks beyond the mask.
#ifndef SV_LOSS_SMOOTH_H
#define SV_LOSS_SMOOTH_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  const float *depth;     // [height_px][stride] inverse depth
  const uint8_t *mask;    // pixels with 0 do not count
  const float *colour[3]; // of the picture, 0 to 1, the same shape
  int width_px, height_px, stride;
  float unit; // inverse depth by which differences are divided
  float weight;
} sv_smooth_input;

// The loss; adds its gradient to grad (not NULL). 0 where no pixel counts. Summed in index order.
double sv_smooth_loss(const sv_smooth_input *in, float *grad);

#ifdef __cplusplus
}
#endif
#endif
