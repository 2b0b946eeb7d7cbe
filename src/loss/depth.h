// SPDX-License-Identifier: Apache-2.0
// Rendered depth: the expected depth of a picture, its way back to what the rasterizer gives (docs:
// GSPLAT's "ED",
//   E = D / A,  D = sum w z,  A = 1 - T,  dL/dD = dL/dE / A,  dL/dT = dL/dE E / A),
// its inverse, and its mean absolute difference from a depth map in world units.
#ifndef SV_LOSS_DEPTH_H
#define SV_LOSS_DEPTH_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

// Planes of one picture, [height_px][stride].
typedef struct {
  const float *depth, *trans; // D and T as rendered
  int width_px, height_px, stride;
  float alpha_min; // pixels of less alpha have no depth
  bool is_inverse; // 1 / E instead of E
} sv_depth_input;

// out gets E or 1 / E, and mask 1, where the alpha is enough; 0 elsewhere. Where mask was 0 before
// it stays 0.
void sv_depth_expected(const sv_depth_input *in, float *out, uint8_t *mask);
// From dL/d(out) to dL/dD and dL/dT; all of the three planes of `rows_padded` rows are written,
// with zeros where mask is
// 0. out and mask are those of sv_depth_expected.
void sv_depth_expected_bwd(const sv_depth_input *in, const float *out, const uint8_t *mask,
                           const float *g_out, int rows_padded, float *g_depth, float *g_trans);
// weight x mean |depth - prior| / unit over the pixels whose mask is not 0; adds its gradient to
// grad (not NULL). 0 when there is none. Summed in index order.
double sv_depth_loss(const float *depth, const float *prior, const uint8_t *mask, int width_px, int height_px,
                     int stride, float unit, float weight, float *grad);

#ifdef __cplusplus
}
#endif
#endif
