// SPDX-License-Identifier: Apache-2.0
#include "src/base/cholesky.h"

#include <math.h>
#include <stddef.h>

bool sv_cholesky(double *s, int n) {
  for (int i = 0; i < n; i++)
    for (int j = 0; j <= i; j++) {
      double *si = s + (size_t)i * (size_t)n, *sj = s + (size_t)j * (size_t)n, sum = si[j];
      for (int k = 0; k < j; k++) sum -= si[k] * sj[k];
      if (i > j) si[j] = sum / sj[j];
      else if (sum > 0) si[j] = sqrt(sum);
      else return false;
    }
  return true;
}

void sv_cholesky_solve(const double *s, int n, double *x) {
  for (int i = 0; i < n; i++) {
    const double *row = s + (size_t)i * (size_t)n;
    for (int k = 0; k < i; k++) x[i] -= row[k] * x[k];
    x[i] /= row[i];
  }
  for (int i = n - 1; i >= 0; i--) {
    x[i] /= s[(size_t)i * (size_t)n + (size_t)i];
    for (int k = 0; k < i; k++) x[k] -= s[(size_t)i * (size_t)n + (size_t)k] * x[i];
  }
}
