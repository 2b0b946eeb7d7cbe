// SPDX-License-Identifier: Apache-2.0
// patch_sums on SSE4.1.
#include "kernels/simd/v16_sse41.h"

#define V(name) name##_sse41
#include "kernels/patch/patch_vec.inc"
