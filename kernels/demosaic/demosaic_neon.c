// SPDX-License-Identifier: Apache-2.0
// demosaic on AArch64 NEON.
#include "kernels/simd/px_neon.h"
#include "kernels/simd/v16_neon.h"

#define V(name) name##_neon
#include "kernels/demosaic/demosaic_vec.inc"
