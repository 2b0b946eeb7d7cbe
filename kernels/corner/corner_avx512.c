// SPDX-License-Identifier: Apache-2.0
// corner on AVX-512.
#include "kernels/simd/v16_avx512.h"

#define V(name) name##_avx512
#include "kernels/corner/corner_vec.inc"
