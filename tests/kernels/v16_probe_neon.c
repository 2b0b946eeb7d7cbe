// SPDX-License-Identifier: Apache-2.0
// The vocabulary's probe on neon.
#include "tests/kernels/v16_probe.h"
#if defined(SV_HAVE_NEON) && SV_HAVE_NEON
#include "kernels/simd/v16_neon.h"

#define PROBE v16_probe_neon
#include "tests/kernels/v16_probe.inc"
#endif
