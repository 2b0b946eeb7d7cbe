// SPDX-License-Identifier: Apache-2.0
// Dense symmetric positive definite systems by Cholesky, in place and in double.
#ifndef SV_BASE_CHOLESKY_H
#define SV_BASE_CHOLESKY_H

#include <stdbool.h>

#ifdef __cplusplus
extern "C" {
#endif

// s[n][n]: only the lower triangle is read; it becomes the factor. False: not positive definite.
bool sv_cholesky(double *s, int n);
// x[n]: the right side becomes the solution; s as sv_cholesky left it.
void sv_cholesky_solve(const double *s, int n, double *x);

#ifdef __cplusplus
}
#endif
#endif
