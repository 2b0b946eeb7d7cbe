// SPDX-License-Identifier: Apache-2.0
// Sorted times, and how they grow with the size of the problem.
#include "tools/bench/bench.h"
#include "src/base/mathx.h"

static void sort(double *v, int n) {
  for (int i = 1; i < n; i++) {
    double x = v[i];
    int k = i;
    for (; k > 0 && v[k - 1] > x; k--) v[k] = v[k - 1];
    v[k] = x;
  }
}

// Between the two samples around it.
static double quantile(const double *v, int n, double q) {
  double at = q * (n - 1);
  int i = (int)at;
  return i + 1 < n ? v[i] + (at - i) * (v[i + 1] - v[i]) : v[n - 1];
}

sv_bench_times sv_bench_times_of(double *v, int n) {
  if (n < 1) return (sv_bench_times){0};
  sort(v, n);
  return (sv_bench_times){
      .median = quantile(v, n, 0.5), .least = v[0], .q1 = quantile(v, n, 0.25), .q3 = quantile(v, n, 0.75)};
}

// The slope of log t over log x through the cases of one row: those that have the same other size.
static double mean_exponent(const sv_bench_step *r, int n, bool is_by_pixels) {
  double sum = 0;
  int rows = 0;
  for (int i = 0; i < n; i++) {
    bool is_first = true;
    double sx = 0, sy = 0, sxx = 0, sxy = 0, m = 0;
    for (int k = 0; k < n; k++) {
      if (is_by_pixels ? r[k].n_gaussians != r[i].n_gaussians : r[k].n.n_pixels != r[i].n.n_pixels) continue;
      if (k < i) is_first = false;
      double x = sv_log(is_by_pixels ? (double)r[k].n.n_pixels : (double)r[k].n_gaussians);
      double y = sv_log(r[k].step_ms.least);
      sx += x;
      sy += y;
      sxx += x * x;
      sxy += x * y;
      m += 1;
    }
    double d = m * sxx - sx * sx;
    if (!is_first || m < 2 || d < 1e-9) continue;
    sum += (m * sxy - sx * sy) / d;
    rows++;
  }
  return rows ? sum / rows : 0;
}

// Solves a[3][4] in place by elimination with pivots; false when it is singular.
static bool solve3(double a[3][4], double x[3]) {
  for (int c = 0; c < 3; c++) {
    int best = c;
    for (int i = c + 1; i < 3; i++)
      if (fabs(a[i][c]) > fabs(a[best][c])) best = i;
    if (fabs(a[best][c]) < 1e-12) return false;
    for (int k = 0; k < 4; k++) {
      double s = a[c][k];
      a[c][k] = a[best][k];
      a[best][k] = s;
    }
    for (int i = 0; i < 3; i++) {
      double f = i == c ? 0 : a[i][c] / a[c][c];
      for (int k = c; k < 4; k++) a[i][k] -= f * a[c][k];
    }
  }
  for (int c = 0; c < 3; c++) x[c] = a[c][3] / a[c][c];
  return true;
}

sv_bench_growth sv_bench_growth_of(const sv_bench_step *r, int n) {
  sv_bench_growth g = {0};
  double a[3][4] = {{0}}, x[3];
  for (int i = 0; i < n; i++) {
    if (!(r[i].step_ms.least > 0)) return g;
    // Sizes in thousands keep the three columns comparable; every case counts alike.
    double t = r[i].step_ms.least,
           row[4] = {1 / t, 1e-3 * r[i].n_gaussians / t, 1e-3 * r[i].n.n_pixels / t, 1};
    for (int k = 0; k < 3; k++)
      for (int l = 0; l < 4; l++) a[k][l] += row[k] * row[l];
  }
  if (n < 3 || !solve3(a, x)) return g;
  g.fixed_ms = x[0];
  g.ns_per_gaussian = 1e3 * x[1];
  g.ns_per_pixel = 1e3 * x[2];
  for (int i = 0; i < n; i++) {
    double t = r[i].step_ms.least,
           e = fabs((x[0] + 1e-3 * (x[1] * r[i].n_gaussians + x[2] * r[i].n.n_pixels)) / t - 1);
    if (e > g.worst) g.worst = e;
  }
  g.by_gaussians = mean_exponent(r, n, false);
  g.by_pixels = mean_exponent(r, n, true);
  return g;
}
