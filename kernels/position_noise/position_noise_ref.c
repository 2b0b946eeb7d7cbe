// SPDX-License-Identifier: Apache-2.0
#include "kernels/position_noise/position_noise.h"

#include "kernels/simd/s1_math.h"
#include "kernels/ops.h"

static void noise_one(float *p, const float *eta, float gain, float dead) {
  const float *q = p + 16 * SV_ROW_QUAT, *scale = p + 16 * SV_ROW_SCALE;
  float o = 1.0f / (1.0f + s1_exp2_fine(-SV_POSITION_NOISE_LOG2E * p[16 * SV_ROW_LOGIT]));
  float gate = 1.0f / (1.0f + s1_exp2_fine(SV_POSITION_NOISE_STEEPNESS * (o - dead)));
  float w = q[0], x = q[16], y = q[32], z = q[48], d[3];
  float n = 2.0f / fmaf(w, w, fmaf(x, x, fmaf(y, y, z * z)));
  for (int a = 0; a < 3; a++) {
    float s = s1_exp2_fine(SV_POSITION_NOISE_LOG2E * scale[16 * a]);
    d[a] = gate * (s1_min(gain * s, 1.0f) * s) * eta[16 * a];
  }
  // v + 2/|q|^2 (w c + u x c), c = u x v: the turn by an unnormalised quaternion (w, u).
  float cx = fmaf(y, d[2], -(z * d[1])), cy = fmaf(z, d[0], -(x * d[2])), cz = fmaf(x, d[1], -(y * d[0]));
  p[0] += fmaf(n, fmaf(w, cx, fmaf(y, cz, -(z * cy))), d[0]);
  p[16] += fmaf(n, fmaf(w, cy, fmaf(z, cx, -(x * cz))), d[1]);
  p[32] += fmaf(n, fmaf(w, cz, fmaf(x, cy, -(y * cx))), d[2]);
}

void sv_position_noise_ref(float *p, uint32_t on, const float *eta, float gain, float dead) {
  for (int k = 0; k < 16; k++)
    if (on >> k & 1) noise_one(p + k, eta + k, gain, dead);
}

uint32_t sv_blend_errors_ref(uint32_t on, float keep, const float *err, float *e, const float *logit,
                             float limit) {
  uint32_t below = 0;
  for (int k = 0; k < 16; k++) {
    if (on >> k & 1) e[k] = keep * e[k] + (1.0f - keep) * err[k];
    below |= (uint32_t) !(logit[k] > limit) << k;
  }
  return below;
}
