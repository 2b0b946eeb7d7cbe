// SPDX-License-Identifier: Apache-2.0
#include "kernels/newton/newton.h"
#include "kernels/project/project.h"

#include <math.h>
#include <string.h>

#include "kernels/simd/s1_math.h"
#include "kernels/ops.h"

void sv_probe_ref(const sv_probe_args *a) {
  for (int row = a->row0; row < a->row1; row++) {
    const long at = (long)row * a->stride;
    for (int i = 0; i < (a->width_px + 15) / 16 * 16; i++) {
      uint32_t bits = sv_probe_bits((uint32_t)i / 32, (uint32_t)row, a->key);
      a->plane[at + i] = i >= a->width_px ? 0.0f : bits >> (i & 31) & 1 ? -a->size : a->size;
    }
  }
}

static void curvature_row(float keep, uint32_t touched, const float *s, const float *before, uint16_t *c) {
  for (int k = 0; k < 16; k++)
    if (touched >> k & 1)
      c[k] = s1_high(before[k] > 0.0f ? fmaf(keep, s1_from_high(c[k]), (1.0f - keep) * s[k]) : s[k]);
}

void sv_curvature_ref(float keep, int n_rows, uint32_t touched, const float *x, const float *products,
                      const sv_curvatures *c) {
  static const int first[3] = {0, 0, 1}, second[3] = {1, 2, 2};
  float s[16], before[16];
  for (int k = 0; k < 16; k++) before[k] = s1_from_high(c->diag[k]);
  for (int i = 0; i < 3; i++) {
    for (int k = 0; k < 16; k++)
      s[k] = products ? products[16 * i + k] : x[16 * first[i] + k] * x[16 * second[i] + k];
    curvature_row(keep, touched, s, before, c->cross + 16 * i);
  }
  for (int row = 0; row < n_rows; row++) {
    for (int k = 0; k < 16; k++) {
      s[k] = products ? x[16 * row + k] : x[16 * row + k] * x[16 * row + k];
      before[k] = s1_from_high(c->diag[16 * row + k]);
    }
    curvature_row(keep, touched, s, before, c->diag + 16 * row);
  }
}

// The mean of a row of diag over the block.
static float block_mean(const uint16_t *diag) {
  float lanes[16];
  for (int k = 0; k < 16; k++) lanes[k] = s1_from_high(diag[k]);
  return s1_sum16(lanes) * (1.0f / 16.0f);
}

// (H + ridge I)^-1 g by the factors of L D L^T, after scaling to a diagonal of 1. h: xx, yy, zz,
// xy, xz, yz; s: g, then the result.
static void solve3(const float h[6], float ridge, float s[3]) {
  float scale[3], y[3];
  for (int i = 0; i < 3; i++) {
    scale[i] = 1.0f / sqrtf(s1_max(h[i] + ridge, SV_NEWTON_CURVATURE_MIN));
    y[i] = s[i] * scale[i];
  }
  const float xy = h[3] * (scale[0] * scale[1]), xz = h[4] * (scale[0] * scale[2]),
              yz = h[5] * (scale[1] * scale[2]);
  const float d1 = s1_max(fmaf(-xy, xy, 1.0f), SV_NEWTON_PIVOT_MIN), l21 = fmaf(-xz, xy, yz) / d1;
  const float d2 = s1_max(fmaf(-(l21 * d1), l21, fmaf(-xz, xz, 1.0f)), SV_NEWTON_PIVOT_MIN);
  y[1] = fmaf(-xy, y[0], y[1]);
  y[2] = fmaf(-l21, y[1], fmaf(-xz, y[0], y[2]));
  y[2] = y[2] / d2;
  y[1] = fmaf(-l21, y[2], y[1] / d1);
  y[0] = fmaf(-xy, y[1], fmaf(-xz, y[2], y[0]));
  for (int i = 0; i < 3; i++) s[i] = y[i] * scale[i];
}

// The running mean of a row's gradients with this step's: mean [16], and m.
static void follow(const sv_newton_args *a, uint32_t touched, const float *grad, float mean[16],
                   uint16_t *m) {
  for (int k = 0; k < 16; k++) {
    mean[k] = fmaf(a->beta1, s1_from_high(m[k]), (1.0f - a->beta1) * grad[k]);
    if (touched >> k & 1) m[k] = s1_high(mean[k]);
  }
}

// size [16]: the longest steps.
static void move_means(const sv_newton_args *a, uint32_t touched, const float *grad, const sv_curvatures *c,
                       const float *size, float *p, uint16_t *m) {
  const float sum = (block_mean(c->diag) + block_mean(c->diag + 16)) + block_mean(c->diag + 32);
  const float ridge = a->damping[0] * (sum * (1.0f / 3.0f));
  float mean[3][16];
  for (int i = 0; i < 3; i++) follow(a, touched, grad + 16 * i, mean[i], m + 16 * i);
  for (int k = 0; k < 16; k++) {
    float h[6], s[3];
    for (int i = 0; i < 3; i++) {
      h[i] = s1_from_high(c->diag[16 * i + k]);
      h[3 + i] = s1_from_high(c->cross[16 * i + k]);
      s[i] = a->rate * mean[i][k];
    }
    if (!(touched >> k & 1) || !(s1_min(h[0], s1_min(h[1], h[2])) > 0.0f)) continue;
    solve3(h, ridge, s);
    const float length = sqrtf(fmaf(s[0], s[0], fmaf(s[1], s[1], s[2] * s[2])));
    const float shorter = s1_min(size[k] / s1_max(length, 1e-30f), 1.0f);
    for (int i = 0; i < 3; i++) p[16 * i + k] = fmaf(-shorter, s[i], p[16 * i + k]);
  }
}

void sv_newton_ref(const sv_newton_args *a, uint32_t touched, const float *grad, const sv_curvatures *c,
                   float *p, uint16_t *m) {
  float size[16], mean[16];
  const float *s = p + 16 * SV_ROW_SCALE;
  for (int k = 0; k < 16; k++)
    size[k] = a->cap_mean * s1_exp2_fine((s[k] + s[16 + k] + s[32 + k]) * SV_NEWTON_LOG2E_3);
  move_means(a, touched, grad, c, size, p, m);
  for (int row = SV_ROW_QUAT; row < a->n_rows; row++) {
    const float ridge = a->damping[row] * block_mean(c->diag + 16 * row), cap = a->cap[row];
    follow(a, touched, grad + 16 * row, mean, m + 16 * row);
    for (int k = 0; k < 16; k++) {
      const float d = s1_from_high(c->diag[16 * row + k]);
      if (!(touched >> k & 1) || !(d > 0.0f)) continue;
      const float step = a->rate * mean[k] / (d + ridge);
      p[16 * row + k] -= s1_max(s1_min(step, cap), -cap);
    }
  }
}
