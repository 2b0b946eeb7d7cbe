// SPDX-License-Identifier: Apache-2.0
// Adam (Kingma & Ba 2015) on the touched lanes of one block of Gaussians.
#ifndef SV_KERNELS_ADAM_H
#define SV_KERNELS_ADAM_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  float beta1, beta2, eps;
  float rsqrt_bias2; // 1/sqrt(1 - beta2^t)
  const float *lr;   // [n_rows], already divided by 1 - beta1^t
  int n_rows;
  uint32_t step; // one more each time; rounds v
} sv_adam_args;

// m and v are kept as the upper halves of floats (bfloat16), m to the nearest. So would a v that
// changes by a thousandth a step stay where it is: it goes up or down as often as its mean asks for
// (stochastic rounding). To its bits 16 others are added before the lower half is cut off, those of
// a sequence that fills them evenly, the multiples of the golden section by step, and the lower
// ones of g and p.
#define SV_ADAM_GOLDEN 0x9e3779b1u

// p, m, v: [n_rows][16] of the block, updated; grad [n_rows][16]. Lanes whose bit in touched is 0
// keep p, m and v.   m = b1 m + (1-b1) g;  v = b2 v + (1-b2) g^2;  p -= lr m / (sqrt(v) rsqrt_bias2
// + eps). exact.
typedef void sv_adam_fn(const sv_adam_args *a, uint32_t touched, const float *grad, float *p, uint16_t *m,
                        uint16_t *v);

#ifdef __cplusplus
}
#endif
#endif
