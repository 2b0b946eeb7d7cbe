// SPDX-License-Identifier: Apache-2.0
// rgb8 on AArch64 NEON.
#include "kernels/simd/px_neon.h"
#include "kernels/simd/v16_neon.h"

#define V(name) name##_neon
#include "kernels/rgb8/rgb8_vec.inc"
