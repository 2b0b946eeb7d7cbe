// SPDX-License-Identifier: Apache-2.0
#include "kernels/simd/v16_sse41.h"

#define V(name) name##_sse41
#include "kernels/newton/newton_vec.inc"
