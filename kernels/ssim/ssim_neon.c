// SPDX-License-Identifier: Apache-2.0
// ssim on AArch64 NEON.
#include "kernels/simd/v16_neon.h"

#define V(name) name##_neon
#include "kernels/ssim/ssim_vec.inc"
