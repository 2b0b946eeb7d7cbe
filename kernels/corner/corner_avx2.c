// SPDX-License-Identifier: Apache-2.0
// corner on AVX2 with FMA.
#include "kernels/simd/v16_avx2.h"

#define V(name) name##_avx2
#include "kernels/corner/corner_vec.inc"
