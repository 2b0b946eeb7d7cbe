// SPDX-License-Identifier: Apache-2.0
#include <math.h>

#include "kernels/color/color.h"
#include "kernels/simd/s1_math.h"
#include "kernels/ops.h"

static float to_linear(float v, float *slope) {
  float u = (v + 0.055f) * (1.0f / 1.055f);
  u = s1_max(u, 0.09f); // what the power gets must be positive; below it the line is taken
  float p = s1_exp2_fine(s1_log2(u) * 2.4f);
  int is_curve = v > 0.04045f;
  *slope = is_curve ? (p / u) * (2.4f / 1.055f) : 1.0f / 12.92f;
  return is_curve ? p : v * (1.0f / 12.92f);
}

static float to_srgb(float l, float *slope) {
  float u = s1_max(l, 0.003f);
  float p = s1_exp2_fine(s1_log2(u) * (1.0f / 2.4f));
  int is_curve = l > 0.0031308f;
  *slope = is_curve ? (p / u) * (1.055f / 2.4f) : 12.92f;
  return is_curve ? fmaf(p, 1.055f, -0.055f) : l * 12.92f;
}

void sv_srgb_to_linear_ref(const sv_curve_args *a) {
  for (int i = 0; i < a->n; i++) {
    float slope;
    a->dst[i] = to_linear(a->src[i], &slope);
    if (a->slope) a->slope[i] = slope;
  }
}

void sv_linear_to_srgb_ref(const sv_curve_args *a) {
  for (int i = 0; i < a->n; i++) {
    float slope;
    a->dst[i] = to_srgb(a->src[i], &slope);
    if (a->slope) a->slope[i] = slope;
  }
}

void sv_noise_curve_ref(const sv_noise_curve_args *a) {
  const float dark = sqrtf(a->read), sum = sqrtf(a->read + a->shot) + dark;
  for (int i = 0; i < a->n; i++) {
    const float x = a->src[i], sigma = sqrtf(fmaf(a->shot, s1_max(x, 0.0f), a->read));
    a->dst[i] = x * (sum / (sigma + dark));
    if (a->slope) a->slope[i] = (0.5f * sum) / sigma;
  }
}

static uint8_t to_byte(float v) {
  float c = v * 255.0f;
  c = s1_min(s1_max(c, 0.0f), 255.0f);
  return (uint8_t)((c + 12582912.0f) - 12582912.0f); // to the nearest, ties to even
}

void sv_pack_ref(const sv_pack_args *a) {
  for (int y = a->row0; y < a->row1; y++) {
    uint8_t *dst = a->dst + (size_t)y * a->dst_stride_bytes;
    size_t at = (size_t)y * (size_t)a->stride;
    for (int x = 0; x < a->width_px; x++)
      for (int c = 0; c < 3; c++) *dst++ = to_byte(a->src[c][at + (size_t)x]);
  }
}
