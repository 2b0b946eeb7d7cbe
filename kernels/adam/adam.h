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
} sv_adam_args;

// p, m, v: [n_rows][16] of the block, updated; grad [n_rows][16]. Lanes whose bit in touched is 0 keep
// p, m and v.   m = b1 m + (1-b1) g;  v = b2 v + (1-b2) g^2;  p -= lr m / (sqrt(v) rsqrt_bias2 + eps). exact.
typedef void (*sv_adam_fn)(const sv_adam_args *a, uint32_t touched, const float *grad, float *p, float *m,
                           float *v);

#define SV_DECLARE(isa)                                                                                      \
  void sv_adam_##isa(const sv_adam_args *a, uint32_t touched, const float *grad, float *p, float *m,         \
                     float *v);
SV_DECLARE(ref)
SV_DECLARE(sse41)
SV_DECLARE(avx2)
SV_DECLARE(avx512)
SV_DECLARE(neon)
#undef SV_DECLARE

#ifdef __cplusplus
}
#endif
#endif
