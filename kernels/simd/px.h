// SPDX-License-Identifier: Apache-2.0
// Shuffles that the 16-lane vocabulary does not have: interleaved bytes to and from planes, sums of
// neighbours.
#ifndef SV_KERNELS_PX_H
#define SV_KERNELS_PX_H
#if defined(__aarch64__)
#include "kernels/simd/px_neon.h"
#elif defined(__SSE4_1__)
#include "kernels/simd/px_x86.h"
#endif
#endif
