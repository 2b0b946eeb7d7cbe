// SPDX-License-Identifier: Apache-2.0
// The vocabulary's probe on avx2.
#include "tests/kernels/v16_probe.h"
#if defined(SV_HAVE_AVX2) && SV_HAVE_AVX2
#include "kernels/simd/v16_avx2.h"

#define PROBE v16_probe_avx2
#include "tests/kernels/v16_probe.inc"
#endif
