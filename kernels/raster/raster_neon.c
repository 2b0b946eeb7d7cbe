// SPDX-License-Identifier: Apache-2.0
#include "kernels/simd/v16_neon.h"

#define V_LOOKS_AHEAD 0 // a vector is four registers
#define V_BY_RECORDS  1
#define V(name)       name##_neon
#include "kernels/raster/raster_vec.inc"
