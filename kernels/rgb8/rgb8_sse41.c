// SPDX-License-Identifier: Apache-2.0
// rgb8 on SSE4.1.
#include "kernels/simd/px_x86.h"
#include "kernels/simd/v16_sse41.h"

#define V(name) name##_sse41
#include "kernels/rgb8/rgb8_vec.inc"
