// SPDX-License-Identifier: Apache-2.0
#include "kernels/fma_peak/fma_peak.h"
#include "kernels/ops.h"

#include <math.h>

void sv_fma_peak_ref(int n_rounds, float x, float *out) {
  for (int k = 0; k < 16; k++) {
    float sum = 0.0f;
    for (int c = 0; c < SV_FMA_PEAK_CHAINS; c++) {
      float s = (float)(c + k);
      for (int i = 0; i < n_rounds; i++) s = fmaf(s, 0.999f, x);
      sum += s;
    }
    out[k] = sum;
  }
}
