// SPDX-License-Identifier: Apache-2.0
#include <math.h>
#include <stddef.h>

#include "kernels/resize/resize.h"
#include "kernels/simd/s1_math.h"
#include "kernels/ops.h"

// Where destination index i looks: the lower tap and the weight of the upper one.
static int tap(int i, float scale, int n_src, float *f) {
  float s = fmaf((float)i + 0.5f, scale, -0.5f);
  s = s1_min(s1_max(s, 0.0f), (float)(n_src - 1));
  int k = (int)s;
  *f = s - (float)k;
  return k;
}

void sv_resize_ref(const sv_resize_args *a) {
  const float sx = (float)a->src_width_px / (float)a->dst_width_px;
  const float sy = (float)a->src_height_px / (float)a->dst_height_px;
  for (int y = a->row0; y < a->row1; y++) {
    float fy, fx;
    int k = tap(y, sy, a->src_height_px, &fy);
    const float *top = a->src + (size_t)k * (size_t)a->src_stride;
    const float *low = k + 1 < a->src_height_px ? top + a->src_stride : top;
    float *dst = a->dst + (size_t)y * (size_t)a->dst_stride;
    for (int i = 0; i < a->src_width_px; i++) a->scratch[i] = fmaf(fy, low[i] - top[i], top[i]);
    for (int x = 0; x < a->dst_width_px; x++) {
      int i = tap(x, sx, a->src_width_px, &fx), j = i + 1 < a->src_width_px ? i + 1 : i;
      dst[x] = fmaf(fx, a->scratch[j] - a->scratch[i], a->scratch[i]);
    }
    for (int x = a->dst_width_px; x < a->dst_stride; x++) dst[x] = 0.0f;
  }
}

void sv_half_ref(const sv_resize_args *a) {
  for (int y = a->row0; y < a->row1; y++) {
    const float *p = a->src + (size_t)(2 * y) * (size_t)a->src_stride, *q = p + a->src_stride;
    float *dst = a->dst + (size_t)y * (size_t)a->dst_stride;
    for (int x = 0; x < a->dst_width_px; x++)
      dst[x] = ((p[2 * x] + p[2 * x + 1]) + (q[2 * x] + q[2 * x + 1])) * 0.25f;
    for (int x = a->dst_width_px; x < a->dst_stride; x++) dst[x] = 0.0f;
  }
}

void sv_half_bwd_ref(const sv_half_bwd_args *a) {
  for (int y = a->row0; y < a->row1; y++) {
    const float *g = a->grad + (size_t)y * (size_t)a->stride;
    float *p = a->src_grad + (size_t)(2 * y) * (size_t)a->src_stride, *q = p + a->src_stride;
    for (int x = 0; x < a->width_px; x++) p[2 * x] = p[2 * x + 1] = 0.25f * g[x];
    for (int x = 2 * a->width_px; x < a->src_stride; x++) p[x] = 0.0f;
    for (int x = 0; x < a->src_stride; x++) q[x] = p[x];
  }
}
