// SPDX-License-Identifier: Apache-2.0
// The vocabulary's probe on ref.
// GCC 12 for AArch64 at -O3 moves a copy of one struct over another's (found by this very check); the words
// are the specification, so they are compiled without that freedom.
#pragma GCC optimize("no-strict-aliasing")
#include "kernels/simd/v16_ref.h"

#define PROBE v16_probe_ref
#include "tests/kernels/v16_probe.inc"
