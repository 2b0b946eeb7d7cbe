// SPDX-License-Identifier: Apache-2.0
// Private to calib/: signs of polynomials, for the ranges in which lens distortion is one to one.
#ifndef SV_CALIB_POLY_H
#define SV_CALIB_POLY_H

#include <stdbool.h>

#ifdef __cplusplus
extern "C" {
#endif

#define SV_POLY_COEF 7 // polynomials of degree 6

// Is the polynomial sum a_i s^i positive on all of [0, s_max]? When that cannot be decided (a root,
// or nearly one): false.
bool sv_poly_is_positive(const double a[SV_POLY_COEF], double s_max);

#ifdef __cplusplus
}
#endif
#endif
