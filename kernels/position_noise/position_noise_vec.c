// SPDX-License-Identifier: Apache-2.0
// `position_noise` on 16 lanes. position_noise_ref.c is the specification.
#include "kernels/position_noise/position_noise.h"
#include "kernels/simd/v16.h"

static inline v16 row(const float *p, int i) { return v16_load(p + 16 * i); }

static inline v16 logistic(v16 log2_odds_against) {
  return v16_div(v16_set1(1.0f), v16_add(v16_set1(1.0f), v16_exp2_fine(log2_odds_against)));
}

// a b - c d
static inline v16 cross(v16 a, v16 b, v16 c, v16 d) { return v16_fma(a, b, v16_neg(v16_mul(c, d))); }

void V(sv_position_noise)(float *p, uint32_t on, const float *eta, float gain, float dead) {
  const v16 log2e = v16_set1(SV_POSITION_NOISE_LOG2E);
  v16 o = logistic(v16_mul(v16_neg(log2e), row(p, SV_ROW_LOGIT)));
  v16 gate = logistic(v16_mul(v16_set1(SV_POSITION_NOISE_STEEPNESS), v16_sub(o, v16_set1(dead))));
  v16 w = row(p, SV_ROW_QUAT), x = row(p, SV_ROW_QUAT + 1), y = row(p, SV_ROW_QUAT + 2),
      z = row(p, SV_ROW_QUAT + 3);
  v16 n = v16_div(v16_set1(2.0f), v16_fma(w, w, v16_fma(x, x, v16_fma(y, y, v16_mul(z, z))))), d[3];
  for (int a = 0; a < 3; a++) {
    v16 s = v16_exp2_fine(v16_mul(log2e, row(p, SV_ROW_SCALE + a)));
    v16 reach = v16_mul(v16_min(v16_mul(v16_set1(gain), s), v16_set1(1.0f)), s);
    d[a] = v16_mul(v16_mul(gate, reach), row(eta, a));
  }
  v16 cx = cross(y, d[2], z, d[1]), cy = cross(z, d[0], x, d[2]), cz = cross(x, d[1], y, d[0]);
  v16 by[3] = {v16_fma(n, v16_fma(w, cx, cross(y, cz, z, cy)), d[0]),
               v16_fma(n, v16_fma(w, cy, cross(z, cx, x, cz)), d[1]),
               v16_fma(n, v16_fma(w, cz, cross(x, cy, y, cx)), d[2])};
  v16m lanes = v16m_from_bits(on);
  for (int a = 0; a < 3; a++) {
    v16 at = row(p, SV_ROW_MEAN + a);
    v16_store(p + 16 * (SV_ROW_MEAN + a), v16_sel(lanes, v16_add(at, by[a]), at));
  }
}

uint32_t V(sv_blend_errors)(uint32_t on, float keep, const float *err, float *e, const float *logit,
                            float limit) {
  v16 old = v16_load(e), part = v16_mul(v16_set1(1.0f - keep), v16_load(err));
  v16_store(e, v16_sel(v16m_from_bits(on), v16_add(v16_mul(v16_set1(keep), old), part), old));
  return ~v16m_bits(v16_gt(v16_load(logit), v16_set1(limit))) & 0xffffu;
}
