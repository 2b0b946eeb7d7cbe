// SPDX-License-Identifier: Apache-2.0
#include "kernels/adam/adam.h"

#include <math.h>

#include "kernels/simd/s1_math.h"
#include "kernels/ops.h"

void sv_adam_ref(const sv_adam_args *a, uint32_t touched, const float *grad, float *p, uint16_t *m,
                 uint16_t *v) {
  const float c1 = 1.0f - a->beta1, c2 = 1.0f - a->beta2;
  const uint32_t of_step = a->step * SV_ADAM_GOLDEN >> 16;
  for (int row = 0; row < a->n_rows; row++)
    for (int k = 0; k < 16; k++) {
      int i = 16 * row + k;
      if (!(touched >> k & 1)) continue;
      float g = grad[i];
      float m1 = fmaf(a->beta1, s1_from_high(m[i]), c1 * g);
      float v1 = fmaf(a->beta2, s1_from_high(v[i]), c2 * (g * g));
      m[i] = s1_high(m1);
      v[i] = (uint16_t)((s1_bits(v1) + ((of_step + s1_bits(g) + s1_bits(p[i])) & 0xffff)) >> 16);
      p[i] -= a->lr[row] * m1 / fmaf(sqrtf(v1), a->rsqrt_bias2, a->eps);
    }
}
