// SPDX-License-Identifier: Apache-2.0
#include <math.h>
#include <stddef.h>

#include "kernels/appearance/appearance.h"
#include "kernels/ops.h"
#include "kernels/simd/s1_math.h"

static float square_of(const sv_appearance_args *a, int row, int i) {
  const float dy = ((float)row + 0.5f) - a->cy, dx = (float)i + (0.5f - a->cx);
  return fmaf(dx, dx, dy * dy) * a->inv_r2;
}

static float falloff(const sv_appearance_args *a, float r2) {
  return fmaf(r2, fmaf(r2, fmaf(r2, a->k[2], a->k[1]), a->k[0]), 1.0f);
}

static void affine(const sv_appearance_args *a, const float x[3], float y[3]) {
  for (int c = 0; c < 3; c++)
    y[c] = fmaf(a->m[3 * c], x[0], fmaf(a->m[3 * c + 1], x[1], fmaf(a->m[3 * c + 2], x[2], a->b[c])));
}

void sv_appearance_ref(const sv_appearance_args *a) {
  for (int r = a->row0; r < a->row1; r++) {
    const size_t at = (size_t)r * (size_t)a->stride;
    for (int i = 0; i < a->width_px; i++) {
      const float x[3] = {a->x[0][at + (size_t)i], a->x[1][at + (size_t)i], a->x[2][at + (size_t)i]};
      const float f = falloff(a, square_of(a, r, i));
      float y[3];
      affine(a, x, y);
      for (int c = 0; c < 3; c++) a->out[c][at + (size_t)i] = f * y[c];
    }
    for (int i = a->width_px; i < a->stride; i++)
      for (int c = 0; c < 3; c++) a->out[c][at + (size_t)i] = 0.0f;
  }
}

void sv_appearance_bwd_ref(const sv_appearance_args *a) {
  for (int r = a->row0; r < a->row1; r++) {
    const size_t at = (size_t)r * (size_t)a->stride;
    float lane[SV_APPEARANCE_SUMS][16] = {{0}};
    for (int i = 0; i < a->width_px; i++) {
      const size_t p = at + (size_t)i;
      const int l = i & 15;
      const float x[3] = {a->x[0][p], a->x[1][p], a->x[2][p]};
      const float r2 = square_of(a, r, i), f = falloff(a, r2);
      float y[3], g[3], h[3];
      affine(a, x, y);
      for (int c = 0; c < 3; c++) {
        g[c] = a->out[c][p];
        h[c] = f * g[c];
      }
      for (int c = 0; c < 3; c++) {
        for (int k = 0; k < 3; k++) lane[3 * c + k][l] = fmaf(h[c], x[k], lane[3 * c + k][l]);
        lane[9 + c][l] += h[c];
      }
      float q = fmaf(g[0], y[0], fmaf(g[1], y[1], g[2] * y[2]));
      for (int k = 0; k < 3; k++) {
        q *= r2;
        lane[12 + k][l] += q;
      }
      for (int k = 0; k < 3; k++)
        a->out[k][p] = fmaf(a->m[k], h[0], fmaf(a->m[3 + k], h[1], a->m[6 + k] * h[2]));
    }
    for (int i = a->width_px; i < a->stride; i++)
      for (int c = 0; c < 3; c++) a->out[c][at + (size_t)i] = 0.0f;
    for (int s = 0; s < SV_APPEARANCE_SUMS; s++) a->row_sum[r * SV_APPEARANCE_SUMS + s] = s1_sum16(lane[s]);
  }
}
