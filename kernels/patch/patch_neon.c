// SPDX-License-Identifier: Apache-2.0
// patch_sums on AArch64 NEON.
#include "kernels/simd/v16_neon.h"

#define V(name) name##_neon
#include "kernels/patch/patch_vec.inc"
