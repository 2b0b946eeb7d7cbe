// SPDX-License-Identifier: Apache-2.0
#include "kernels/simd/v16_avx2.h"

#define V(name) name##_avx2
#include "kernels/newton/newton_vec.inc"
