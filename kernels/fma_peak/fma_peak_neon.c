// SPDX-License-Identifier: Apache-2.0
#include "kernels/simd/v16_neon.h"

#define AT_ONCE 6
#define V(name) name##_neon
#include "kernels/fma_peak/fma_peak_vec.inc"
