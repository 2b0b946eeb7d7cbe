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

void sv_curvature_ref(float keep, int n_rows, uint32_t touched, const float *x, int is_square,
                      uint16_t *diag) {
  for (int i = 0; i < 16 * n_rows; i++) {
    if (!(touched >> (i & 15) & 1)) continue;
    const float s = is_square ? x[i] : x[i] * x[i], d = s1_from_high(diag[i]);
    diag[i] = s1_high(d > 0.0f ? fmaf(keep, d, (1.0f - keep) * s) : s);
  }
}

void sv_newton_ref(const sv_newton_args *a, uint32_t touched, const float *grad, const uint16_t *diag,
                   float *p, uint16_t *m) {
  float c1 = 1.0f - a->beta1, size[16];
  const float *s = p + 16 * SV_ROW_SCALE;
  for (int k = 0; k < 16; k++)
    size[k] = a->cap_mean * s1_exp2_fine((s[k] + s[16 + k] + s[32 + k]) * SV_NEWTON_LOG2E_3);
  for (int row = 0; row < a->n_rows; row++) {
    float d[16], lanes[16];
    for (int k = 0; k < 16; k++) d[k] = lanes[k] = s1_from_high(diag[16 * row + k]);
    float ridge = a->damping[row] * (s1_sum16(lanes) * (1.0f / 16.0f));
    for (int k = 0; k < 16; k++) {
      int i = 16 * row + k;
      if (!(touched >> k & 1)) continue;
      float mean = fmaf(a->beta1, s1_from_high(m[i]), c1 * grad[i]);
      m[i] = s1_high(mean);
      if (!(d[k] > 0.0f)) continue;
      float step = a->rate * mean / (d[k] + ridge), cap = row < SV_ROW_QUAT ? size[k] : a->cap[row];
      p[i] -= s1_max(s1_min(step, cap), -cap);
    }
  }
}
