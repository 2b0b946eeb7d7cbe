// SPDX-License-Identifier: Apache-2.0
// The vocabulary's probe on avx512.
#include "tests/kernels/v16_probe.h"
#if defined(SV_HAVE_AVX512) && SV_HAVE_AVX512
#include "kernels/simd/v16_avx512.h"

#define PROBE v16_probe_avx512
#include "tests/kernels/v16_probe.inc"
#endif
