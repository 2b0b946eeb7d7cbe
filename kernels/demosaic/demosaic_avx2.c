// SPDX-License-Identifier: Apache-2.0
// demosaic on AVX2 with FMA.
#include "kernels/simd/px_x86.h"
#include "kernels/simd/v16_avx2.h"

#define V(name) name##_avx2
#include "kernels/demosaic/demosaic_vec.inc"
