// SPDX-License-Identifier: Apache-2.0
#include "src/loss/depth.h"

#include <math.h>
#include <string.h>

static size_t at(const sv_depth_input *in, int x, int y) {
  return (size_t)y * (size_t)in->stride + (size_t)x;
}

void sv_depth_expected(const sv_depth_input *in, float *out, uint8_t *mask) {
  for (int y = 0; y < in->height_px; y++)
    for (int x = 0; x < in->width_px; x++) {
      const size_t i = at(in, x, y);
      const float alpha = 1.0f - in->trans[i];
      if (!(alpha >= in->alpha_min) || !(in->depth[i] > 0.0f)) mask[i] = 0;
      if (!mask[i]) out[i] = 0.0f;
      else out[i] = in->is_inverse ? alpha / in->depth[i] : in->depth[i] / alpha;
    }
}

void sv_depth_expected_bwd(const sv_depth_input *in, const float *out, const uint8_t *mask,
                           const float *g_out, const sv_depth_grad *grad) {
  float *g_depth = grad->depth, *g_trans = grad->trans;
  const size_t n = (size_t)grad->rows_padded * (size_t)in->stride;
  memset(g_depth, 0, n * sizeof *g_depth);
  memset(g_trans, 0, n * sizeof *g_trans);
  for (int y = 0; y < in->height_px; y++)
    for (int x = 0; x < in->width_px; x++) {
      const size_t i = at(in, x, y);
      if (!mask[i]) continue;
      const float alpha = 1.0f - in->trans[i];
      if (in->is_inverse) { // A / D
        g_depth[i] = -g_out[i] * out[i] / in->depth[i];
        g_trans[i] = -g_out[i] / in->depth[i];
      } else {
        g_depth[i] = g_out[i] / alpha;
        g_trans[i] = g_out[i] * out[i] / alpha;
      }
    }
}

double sv_depth_loss(const sv_depth_pair *in, float *grad) {
  const int stride = in->stride;
  long n = 0;
  double sum = 0;
  for (int y = 0; y < in->height_px; y++)
    for (int x = 0; x < in->width_px; x++) n += in->mask[(size_t)y * (size_t)stride + (size_t)x] != 0;
  if (!n) return 0;
  const float step = (float)((double)in->weight / ((double)n * (double)in->unit));
  for (int y = 0; y < in->height_px; y++)
    for (int x = 0; x < in->width_px; x++) {
      const size_t i = (size_t)y * (size_t)stride + (size_t)x;
      if (!in->mask[i]) continue;
      const float off = in->depth[i] - in->prior[i];
      sum += fabs((double)off);
      grad[i] += off > 0.0f ? step : off < 0.0f ? -step : 0.0f;
    }
  return (double)in->weight * sum / ((double)n * (double)in->unit);
}
