// SPDX-License-Identifier: Apache-2.0
// The vocabulary's probe on sse41.
#include "tests/kernels/v16_probe.h"
#if defined(SV_HAVE_SSE41) && SV_HAVE_SSE41
#include "kernels/simd/v16_sse41.h"

#define PROBE v16_probe_sse41
#include "tests/kernels/v16_probe.inc"
#endif
