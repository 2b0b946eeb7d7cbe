// SPDX-License-Identifier: Apache-2.0
// `adam` on 16 lanes. adam_ref.c is the specification.
#include "kernels/adam/adam.h"
#include "kernels/simd/v16.h"

void V(sv_adam)(const sv_adam_args *a, uint32_t touched, const float *grad, float *p, uint16_t *m,
                uint16_t *v) {
  v16 b1 = v16_set1(a->beta1), b2 = v16_set1(a->beta2), c1 = v16_set1(1.0f - a->beta1),
      c2 = v16_set1(1.0f - a->beta2);
  v16 eps = v16_set1(a->eps), rs = v16_set1(a->rsqrt_bias2);
  v16i of_step = v16i_set1((int32_t)(a->step * SV_ADAM_GOLDEN >> 16)), low = v16i_set1(0xffff);
  v16m on = v16m_from_bits(touched);
  for (int row = 0; row < a->n_rows; row++) {
    v16 g = v16_load(grad + 16 * row), m0 = v16_load_high(m + 16 * row), v0 = v16_load_high(v + 16 * row);
    v16 p0 = v16_load(p + 16 * row);
    v16 m1 = v16_fma(b1, m0, v16_mul(c1, g)), v1 = v16_fma(b2, v0, v16_mul(c2, v16_mul(g, g)));
    v16 step = v16_div(v16_mul(v16_set1(a->lr[row]), m1), v16_fma(v16_sqrt(v1), rs, eps));
    v16i up = v16i_and(v16i_add(of_step, v16i_add(v16_bits(g), v16_bits(p0))), low);
    v16_store_high(m + 16 * row, v16_sel(on, m1, m0));
    v16i_store_high(v + 16 * row,
                    v16i_add(v16_bits(v16_sel(on, v1, v0)), up)); // v0 stays: its lower half is 0
    v16_store(p + 16 * row, v16_sel(on, v16_sub(p0, step), p0));
  }
}
