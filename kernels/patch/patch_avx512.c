// SPDX-License-Identifier: Apache-2.0
// patch_sums on AVX-512.
#include "kernels/simd/v16_avx512.h"

#define V(name) name##_avx512
#include "kernels/patch/patch_vec.inc"
