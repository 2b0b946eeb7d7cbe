// SPDX-License-Identifier: Apache-2.0
// `fma_peak` on 16 lanes. AT_ONCE chains run side by side: no more than the registers hold beside
// two constants.
#include "kernels/fma_peak/fma_peak.h"
#include "kernels/simd/v16.h"

enum { AT_ONCE = V16_REGISTERS >= 16 ? 12 : V16_REGISTERS * 3 / 4 };

void V(sv_fma_peak)(int n_rounds, float x, float *out) {
  const v16 a = v16_set1(x), b = v16_set1(0.999f);
  v16 sum = v16_zero();
  for (int c = 0; c < SV_FMA_PEAK_CHAINS; c += AT_ONCE) {
    v16 s[AT_ONCE];
    for (int k = 0; k < AT_ONCE; k++) s[k] = v16_add(v16_set1((float)(c + k)), v16_iota());
    for (int i = 0; i < n_rounds; i++)
      for (int k = 0; k < AT_ONCE; k++) s[k] = v16_fma(s[k], b, a);
    for (int k = 0; k < AT_ONCE; k++) sum = v16_add(sum, s[k]);
  }
  v16_store(out, sum);
}
