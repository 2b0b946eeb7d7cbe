// SPDX-License-Identifier: Apache-2.0
// rgb8 on AVX-512.
#include "kernels/simd/px_x86.h"
#include "kernels/simd/v16_avx512.h"

#define V(name) name##_avx512
#include "kernels/rgb8/rgb8_vec.inc"
