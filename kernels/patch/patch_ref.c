// SPDX-License-Identifier: Apache-2.0
#include <math.h>
#include <stddef.h>

#include "kernels/patch/patch.h"
#include "kernels/simd/s1_math.h"

#define WIDE (SV_PATCH_SIDE + 2)

// Place of patch pixel (i, j) in the order of sv_patch.
static int slot(int i, int j) { return ((j >> 2) * 3 + (i >> 2)) * 16 + (j & 3) * 4 + (i & 3); }

// Without fused operations: they are slow where the processor has none, and this runs everywhere.
static float sample(const float *p, int stride, float fx, float fy) {
  float top = p[0] + fx * (p[1] - p[0]), low = p[stride] + fx * (p[stride + 1] - p[stride]);
  return top + fy * (low - top);
}

static float bilinear(const float *p, int stride, float fx, float fy) {
  float top = fmaf(fx, p[1] - p[0], p[0]), low = fmaf(fx, p[stride + 1] - p[stride], p[stride]);
  return fmaf(fy, low - top, top);
}

static void centre(float *v) {
  float lane[16] = {0};
  for (int i = 0; i < SV_PATCH_PIXELS; i++) lane[i & 15] += v[i];
  float mean = s1_sum16(lane) * (1.0f / SV_PATCH_PIXELS);
  for (int i = 0; i < SV_PATCH_PIXELS; i++) v[i] -= mean;
}

void sv_patch_take_ref(sv_patch_take_args *a) {
  float v[WIDE][WIDE];
  const int edge = a->has_slopes ? 0 : 1;
  const float w = (float)(a->width_px - 1), h = (float)(a->height_px - 1);
  a->is_inside = false;
  for (int j = edge; j < WIDE - edge; j++)
    for (int i = edge; i < WIDE - edge; i++) {
      float u = (float)i - 0.5f * (WIDE - 1), t = (float)j - 0.5f * (WIDE - 1);
      float x = (a->a[0] * u + a->a[1] * t) + (a->x - 0.5f);
      float y = (a->a[2] * u + a->a[3] * t) + (a->y - 0.5f);
      if (!(x >= 0.0f && x < w && y >= 0.0f && y < h)) return;
      int ix = (int)x, iy = (int)y;
      v[j][i] = sample(a->src + (size_t)iy * (size_t)a->stride + ix, a->stride, x - (float)ix, y - (float)iy);
    }
  for (int j = 0; j < SV_PATCH_SIDE; j++)
    for (int i = 0; i < SV_PATCH_SIDE; i++) {
      int s = slot(i, j);
      a->out->v[0][s] = v[j + 1][i + 1];
      if (!a->has_slopes) continue;
      a->out->v[1][s] = 0.5f * (v[j + 1][i + 2] - v[j + 1][i]);
      a->out->v[2][s] = 0.5f * (v[j + 2][i + 1] - v[j][i + 1]);
    }
  for (int k = 0; k < (a->has_slopes ? 3 : 1); k++) centre(a->out->v[k]);
  a->is_inside = true;
}

void sv_patch_sums_ref(const sv_patch_sums_args *a) {
  for (int n = 0; n < a->n; n++) {
    float x = a->x[n] - SV_PATCH_REACH, y = a->y[n] - SV_PATCH_REACH, lane[5][16] = {{0}};
    int ix = (int)x, iy = (int)y;
    const float *p = a->src + (size_t)iy * (size_t)a->stride + ix;
    for (int j = 0; j < SV_PATCH_SIDE; j++)
      for (int i = 0; i < SV_PATCH_SIDE; i++) {
        float v = bilinear(p + (ptrdiff_t)j * a->stride + i, a->stride, x - (float)ix, y - (float)iy);
        int s = slot(i, j), k = s & 15;
        lane[0][k] += v;
        lane[1][k] = fmaf(v, v, lane[1][k]);
        for (int c = 0; c < 3; c++) lane[2 + c][k] = fmaf(v, a->patch->v[c][s], lane[2 + c][k]);
      }
    for (int c = 0; c < 5; c++) a->out[n][c] = s1_sum16(lane[c]);
  }
}
