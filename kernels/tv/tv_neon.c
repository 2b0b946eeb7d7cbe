// SPDX-License-Identifier: Apache-2.0
// tv on AArch64 NEON.
#include "kernels/simd/v16_neon.h"

#define V(name) name##_neon
#include "kernels/tv/tv_vec.inc"
