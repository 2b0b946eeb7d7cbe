// SPDX-License-Identifier: Apache-2.0
#include "kernels/simd/v16_avx2.h"

#define V(name) name##_avx2
#include "kernels/explore/explore_vec.inc"
