// SPDX-License-Identifier: Apache-2.0
// demosaic on SSE4.1.
#include "kernels/simd/px_x86.h"
#include "kernels/simd/v16_sse41.h"

#define V(name) name##_sse41
#include "kernels/demosaic/demosaic_vec.inc"
