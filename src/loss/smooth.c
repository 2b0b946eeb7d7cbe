// SPDX-License-Identifier: Apache-2.0
#include "src/loss/smooth.h"

#include <math.h>
#include <stddef.h>

#define SHARPNESS 10.0f // of edges of the picture
#define EDGE      0.05f // of unit: a step of the depth

static double pair_loss(const sv_smooth_input *in, size_t i, size_t j, float per_pixel, float *grad) {
  const float off = in->depth[j] - in->depth[i];
  float contrast = 0.0f;
  if (!in->mask[i] || !in->mask[j] || fabsf(off) > EDGE * in->unit) return 0;
  for (int c = 0; c < 3; c++) contrast += fabsf(in->colour[c][i] - in->colour[c][j]);
  const float w = per_pixel / (1.0f + SHARPNESS * contrast);
  const float g = off > 0.0f ? w : off < 0.0f ? -w : 0.0f;
  grad[j] += g;
  grad[i] -= g;
  return (double)w * fabs((double)off);
}

double sv_smooth_loss(const sv_smooth_input *in, float *grad) {
  const size_t stride = (size_t)in->stride;
  long n = 0;
  double sum = 0;
  for (int y = 0; y < in->height_px; y++)
    for (int x = 0; x < in->width_px; x++) n += in->mask[(size_t)y * stride + (size_t)x] != 0;
  if (!n || !(in->unit > 0.0f)) return 0;
  const float per_pixel = (float)((double)in->weight / ((double)n * (double)in->unit));
  for (int y = 0; y < in->height_px; y++)
    for (int x = 0; x < in->width_px; x++) {
      const size_t i = (size_t)y * stride + (size_t)x;
      if (x + 1 < in->width_px) sum += pair_loss(in, i, i + 1, per_pixel, grad);
      if (y + 1 < in->height_px) sum += pair_loss(in, i, i + stride, per_pixel, grad);
    }
  return sum;
}
