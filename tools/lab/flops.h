// SPDX-License-Identifier: Apache-2.0
// The measured peak of fused multiply-adds, for bounds on how fast a step can be.
#ifndef SV_TOOLS_LAB_FLOPS_H
#define SV_TOOLS_LAB_FLOPS_H

#include "kernels/kernels.h"
#include "src/port/port.h"

// Floating-point operations a second (a multiply-add is two) of all threads of the pool together, with the
// vector width of `isa`. Takes about 0.1 s.
double lab_peak_flops(sv_isa isa, const sv_pool *pool, const sv_clock *clock);

#endif
