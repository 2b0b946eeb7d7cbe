// SPDX-License-Identifier: Apache-2.0
// Rendered depth: the expected depth of an image and its backward pass (gsplat's "ED",
//   E = D / A,  D = sum w z,  A = 1 - T,  dL/dD = dL/dE / A,  dL/dT = dL/dE E / A),
// its inverse, and its mean absolute difference from a depth map in world units.
// Owns nothing: all planes are the caller's.
// Never smooths or fills in: pixels of too little alpha have no depth and no gradient.
#ifndef SV_LOSS_DEPTH_H
#define SV_LOSS_DEPTH_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

// Planes of one image, [height_px][stride].
typedef struct {
  const float *depth, *trans; // D and T as rendered
  int width_px, height_px, stride;
  float alpha_min; // pixels of less alpha have no depth
  bool is_inverse; // 1 / E instead of E
} sv_depth_input;

// out gets E or 1 / E, and mask 1, where the alpha is enough; 0 elsewhere. Where mask was 0 before
// it stays 0.
void sv_depth_expected(const sv_depth_input *in, float *out, uint8_t *mask);
// Gradients of what the rasterizer gives, [rows_padded][stride].
typedef struct {
  float *depth, *trans; // dL/dD and dL/dT
  int rows_padded;
} sv_depth_grad;

// From g_out = dL/d(out) to dL/dD and dL/dT; both planes are written whole, with zeros where mask
// is 0. out and mask are those of sv_depth_expected.
void sv_depth_expected_bwd(const sv_depth_input *in, const float *out, const uint8_t *mask,
                           const float *g_out, const sv_depth_grad *grad);

// A rendered depth map and the one it should be, [height_px][stride].
typedef struct {
  const float *depth, *prior;
  const uint8_t *mask; // pixels with 0 do not count
  int width_px, height_px, stride;
  float unit; // length in world units by which differences are divided
  float weight;
} sv_depth_pair;

// weight x mean |depth - prior| / unit over the pixels that count; adds its gradient to grad (not
// NULL). 0 when there is none. Summed in index order.
double sv_depth_loss(const sv_depth_pair *in, float *grad);

#ifdef __cplusplus
}
#endif
#endif
