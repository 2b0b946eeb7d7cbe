// SPDX-License-Identifier: Apache-2.0
#include "kernels/simd/v16_sse41.h"

#define AT_ONCE 3
#define V(name) name##_sse41
#include "kernels/fma_peak/fma_peak_vec.inc"
