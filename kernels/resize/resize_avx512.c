// SPDX-License-Identifier: Apache-2.0
// resize on AVX-512.
#include "kernels/simd/v16_avx512.h"

#define V(name) name##_avx512
#include "kernels/resize/resize_vec.inc"
