// SPDX-License-Identifier: Apache-2.0
#include "calib/poly.h"

#define N_COEF  SV_POLY_COEF
#define N_SPLIT 24

// Bernstein coefficients bound the polynomial from below; where the bound does not decide, the
// interval is halved (de Casteljau), left half first.
bool sv_poly_is_positive(const double a[N_COEF], double s_max) {
  // binomial(i, j) / binomial(6, j): from powers to the Bernstein basis on [0, 1]
  static const double w[N_COEF][N_COEF] = {{1},
                                           {1, 1.0 / 6},
                                           {1, 2.0 / 6, 1.0 / 15},
                                           {1, 3.0 / 6, 3.0 / 15, 1.0 / 20},
                                           {1, 4.0 / 6, 6.0 / 15, 4.0 / 20, 1.0 / 15},
                                           {1, 5.0 / 6, 10.0 / 15, 10.0 / 20, 5.0 / 15, 1.0 / 6},
                                           {1, 1, 1, 1, 1, 1, 1}};
  double stack[N_SPLIT + 1][N_COEF], pw = 1, scaled[N_COEF];
  for (int j = 0; j < N_COEF; j++, pw *= s_max) scaled[j] = a[j] * pw;
  for (int i = 0; i < N_COEF; i++) {
    stack[0][i] = 0;
    for (int j = 0; j <= i; j++) stack[0][i] += w[i][j] * scaled[j];
  }
  for (int top = 0, n_done = 0; top >= 0; n_done++) {
    double *b = stack[top], lo = b[0];
    for (int i = 1; i < N_COEF; i++)
      if (!(b[i] >= lo)) lo = b[i]; // NaN stays
    if (lo > 0) {
      top--;
      continue;
    }
    if (!(b[0] > 0 && b[N_COEF - 1] > 0) || top == N_SPLIT || n_done > 8 * N_SPLIT) return false;
    double *left = stack[top + 1]; // b becomes the right half
    for (int i = 0; i < N_COEF; i++) {
      left[i] = b[0];
      for (int j = 0; j < N_COEF - 1 - i; j++) b[j] = 0.5 * (b[j] + b[j + 1]);
    }
    top++;
  }
  return true;
}
