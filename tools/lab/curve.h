// SPDX-License-Identifier: Apache-2.0
// Gaussians along a space-filling curve: neighbors in space become neighbors in a file, which then
// compresses better.
#ifndef SV_TOOLS_LAB_CURVE_H
#define SV_TOOLS_LAB_CURVE_H

#include "src/splat/gaussians.h"

#ifdef __cplusplus
extern "C" {
#endif

// sign(x) ln(1 + |x|): far Gaussians come nearer.
float lab_curve_log(float x);
// Range of the logarithms of the positions, by axis.
void lab_curve_ranges(const sv_gaussian *v, int n, double lo[3], double hi[3]);
// All Gaussians of a model in that order, malloc'ed; NULL without memory. index: [n] their indices
// in the model, or NULL.
sv_gaussian *lab_curve_order(const sv_gaussians *g, int *index);

#ifdef __cplusplus
}
#endif
#endif
