// SPDX-License-Identifier: Apache-2.0
// The vocabulary's probe on ref.
#include "kernels/simd/v16_ref.h"

#define PROBE v16_probe_ref
#include "tests/kernels/v16_probe.inc"
