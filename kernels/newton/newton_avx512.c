// SPDX-License-Identifier: Apache-2.0
#include "kernels/simd/v16_avx512.h"

#define V(name) name##_avx512
#include "kernels/newton/newton_vec.inc"
