// SPDX-License-Identifier: Apache-2.0
#include "kernels/simd/v16_avx512.h"

#define V_LOOKS_AHEAD 2 // 32 registers
#define V(name)       name##_avx512
#include "kernels/raster/raster_vec.inc"
