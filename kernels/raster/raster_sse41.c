// SPDX-License-Identifier: Apache-2.0
#include "kernels/simd/v16_sse41.h"

#define V_LOOKS_AHEAD 0 // a vector is four registers
#define V(name)       name##_sse41
#include "kernels/raster/raster_vec.inc"
