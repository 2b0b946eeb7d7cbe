// SPDX-License-Identifier: Apache-2.0
#include "kernels/simd/v16_neon.h"

#define V(name) name##_neon
#include "kernels/newton/newton_vec.inc"
