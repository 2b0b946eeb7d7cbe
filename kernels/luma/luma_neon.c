// SPDX-License-Identifier: Apache-2.0
// luma on AArch64 NEON.
#include "kernels/simd/px_neon.h"
#include "kernels/simd/v16_neon.h"

#define V(name) name##_neon
#include "kernels/luma/luma_vec.inc"
