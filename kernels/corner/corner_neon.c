// SPDX-License-Identifier: Apache-2.0
// corner on AArch64 NEON.
#include "kernels/simd/v16_neon.h"

#define V(name) name##_neon
#include "kernels/corner/corner_vec.inc"
