// SPDX-License-Identifier: Apache-2.0
#include "kernels/simd/v16_avx512.h"

#define AT_ONCE 12
#define V(name) name##_avx512
#include "kernels/fma_peak/fma_peak_vec.inc"
