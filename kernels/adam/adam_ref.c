// SPDX-License-Identifier: Apache-2.0
#include "kernels/adam/adam.h"

#include <math.h>

void sv_adam_ref(const sv_adam_args *a, uint32_t touched, const float *grad, float *p, float *m, float *v) {
  float c1 = 1.0f - a->beta1, c2 = 1.0f - a->beta2;
  for (int row = 0; row < a->n_rows; row++)
    for (int k = 0; k < 16; k++) {
      int i = 16 * row + k;
      if (!(touched >> k & 1)) continue;
      float g = grad[i];
      m[i] = fmaf(a->beta1, m[i], c1 * g);
      v[i] = fmaf(a->beta2, v[i], c2 * (g * g));
      p[i] -= a->lr[row] * m[i] / fmaf(sqrtf(v[i]), a->rsqrt_bias2, a->eps);
    }
}
