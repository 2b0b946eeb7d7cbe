// SPDX-License-Identifier: Apache-2.0
#include <math.h>
#include <stddef.h>

#include "kernels/patch/patch.h"
#include "kernels/simd/s1_math.h"
#include "kernels/ops.h"

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

// Where the map puts sample (i, j) of the wide patch, from the centre of the first pixel.
static void place_of(const sv_patch_take_args *a, int i, int j, float *x, float *y) {
  float u = (float)i - 0.5f * (WIDE - 1), t = (float)j - 0.5f * (WIDE - 1);
  *x = (a->a[0] * u + a->a[1] * t) + (a->x - 0.5f);
  *y = (a->a[2] * u + a->a[3] * t) + (a->y - 0.5f);
}

// The map is affine: all samples lie inside when the four at the corners do, by more than rounding.
static bool is_inside(const sv_patch_take_args *a, int edge) {
  const float w = (float)(a->width_px - 1) - 1e-3f, h = (float)(a->height_px - 1) - 1e-3f;
  for (int k = 0; k < 4; k++) {
    float x, y;
    place_of(a, k & 1 ? WIDE - 1 - edge : edge, k & 2 ? WIDE - 1 - edge : edge, &x, &y);
    if (!(x >= 1e-3f && x < w && y >= 1e-3f && y < h)) return false;
  }
  return true;
}

static void take_mapped(const sv_patch_take_args *a, int edge, float v[WIDE][WIDE]) {
  for (int j = edge; j < WIDE - edge; j++)
    for (int i = edge; i < WIDE - edge; i++) {
      float x, y;
      place_of(a, i, j, &x, &y);
      int ix = (int)x, iy = (int)y;
      v[j][i] = sample(a->src + (size_t)iy * (size_t)a->stride + ix, a->stride, x - (float)ix, y - (float)iy);
    }
}

// Without a map all samples lie the same way between pixels.
static void take_plain(const sv_patch_take_args *a, int edge, float v[WIDE][WIDE]) {
  float x, y;
  place_of(a, edge, edge, &x, &y);
  int ix = (int)x, iy = (int)y;
  const float *p = a->src + (size_t)iy * (size_t)a->stride + ix, fx = x - (float)ix, fy = y - (float)iy;
  for (int j = edge; j < WIDE - edge; j++, p += a->stride)
    for (int i = edge; i < WIDE - edge; i++) v[j][i] = sample(p + i - edge, a->stride, fx, fy);
}

void sv_patch_take_ref(sv_patch_take_args *a) {
  float v[WIDE][WIDE];
  const int edge = a->has_slopes ? 0 : 1;
  a->is_inside = is_inside(a, edge);
  if (!a->is_inside) return;
  if (a->a[0] == 1.0f && a->a[1] == 0.0f && a->a[2] == 0.0f && a->a[3] == 1.0f) take_plain(a, edge, v);
  else take_mapped(a, edge, v);
  for (int j = 0; j < SV_PATCH_SIDE; j++)
    for (int i = 0; i < SV_PATCH_SIDE; i++) {
      int s = slot(i, j);
      a->out->v[0][s] = v[j + 1][i + 1];
      if (!a->has_slopes) continue;
      a->out->v[1][s] = 0.5f * (v[j + 1][i + 2] - v[j + 1][i]);
      a->out->v[2][s] = 0.5f * (v[j + 2][i + 1] - v[j][i + 1]);
    }
  for (int k = 0; k < (a->has_slopes ? 3 : 1); k++) centre(a->out->v[k]);
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

void sv_patch_compare_ref(sv_patch_compare_args *a) {
  float lane[8][16] = {{0}};
  for (int j = 0; j < SV_PATCH_SIDE; j++)
    for (int i = 0; i < SV_PATCH_SIDE; i++) {
      int s = slot(i, j), k = s & 15;
      float v = a->v[s], vx = v * a->patch->v[1][s], vy = v * a->patch->v[2][s];
      float x = (float)i - 5.5f, y = (float)j - 5.5f;
      lane[0][k] = fmaf(v, a->patch->v[0][s], lane[0][k]);
      lane[1][k] = fmaf(v, v, lane[1][k]);
      lane[2][k] += vx;
      lane[3][k] += vy;
      lane[4][k] = fmaf(vx, x, lane[4][k]);
      lane[5][k] = fmaf(vy, x, lane[5][k]);
      lane[6][k] = fmaf(vx, y, lane[6][k]);
      lane[7][k] = fmaf(vy, y, lane[7][k]);
    }
  for (int c = 0; c < 8; c++) a->out[c] = s1_sum16(lane[c]);
}
