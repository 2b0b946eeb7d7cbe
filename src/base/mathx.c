// SPDX-License-Identifier: Apache-2.0
// Range reduction and series, written in double; no contraction (-ffp-contract=off), no libm.
#include "src/base/mathx.h"

#include <float.h>
#include <math.h>
#include <stdint.h>
#include <string.h>

static double bits_to_double(uint64_t b) {
  double d;
  memcpy(&d, &b, sizeof d);
  return d;
}

#define LN2_HI 6.93147180369123816490e-01 // ln 2 with the low 32 bits zero, so k * LN2_HI is exact
#define LN2_LO 1.90821492927058770002e-10

double sv_exp(double x) {
  if (x != x) return x;
  if (x > 709.0) return INFINITY;
  if (x < -708.0) return 0;
  double k = floor(x * 1.44269504088896340736 + 0.5);
  double r = (x - k * LN2_HI) - k * LN2_LO; // |r| <= ln2/2
  // exp(r) by its Taylor series to r^14/14!: remainder below 2e-19 at |r| = 0.35
  double p = 1.0;
  for (int i = 14; i >= 1; i--) p = 1.0 + p * (r / (double)i);
  return p * bits_to_double((uint64_t)((int64_t)k + 1023) << 52);
}

double sv_log(double x) {
  if (x != x || x < 0) return NAN;
  if (x == 0) return -INFINITY;
  if (x > DBL_MAX) return x;
  int64_t e_sub = 0;
  if (x < DBL_MIN) {
    x *= 0x1p54;
    e_sub = -54;
  }
  uint64_t b;
  memcpy(&b, &x, sizeof b);
  int64_t e = (int64_t)(b >> 52) - 1023 + e_sub;
  double m = bits_to_double((b & 0x000fffffffffffffull) | 0x3ff0000000000000ull); // [1,2)
  if (m > 1.41421356237309514547) {
    m *= 0.5;
    e++;
  }
  // log m = 2 atanh(s), s = (m-1)/(m+1), |s| <= 0.1716; odd series to s^21
  double s = (m - 1.0) / (m + 1.0), z = s * s, p = 0;
  for (int i = 21; i >= 3; i -= 2) p = (p + 1.0 / (double)i) * z;
  return (double)e * LN2_HI + (2.0 * s + (2.0 * s * p + (double)e * LN2_LO));
}

double sv_pow(double x, double y) { return x > 0 ? sv_exp(y * sv_log(x)) : (x == 0 && y > 0 ? 0 : NAN); }

// Quadrant and remainder in [-pi/4, pi/4] by a three-part pi/2 (Cody-Waite).
static double reduce(double x, int *quadrant) {
  double k = floor(x * 0.63661977236758134308 + 0.5);
  double r = x - k * 1.57079632673412561417e+00;
  r -= k * 6.07710050630396597660e-11;
  r -= k * 2.02226624871116645580e-21;
  *quadrant = (int)((int64_t)k & 3);
  return r;
}

static double sin_poly(double r) {
  double z = r * r, p = 1.0;
  for (int i = 16; i >= 2; i -= 2) p = 1.0 - p * (z / (double)(i * (i + 1)));
  return r * p;
}

static double cos_poly(double r) {
  double z = r * r, p = 1.0;
  for (int i = 17; i >= 1; i -= 2) p = 1.0 - p * (z / (double)(i * (i + 1)));
  return p;
}

double sv_sin(double x) {
  if (!(x > -1e9 && x < 1e9)) return NAN;
  int q;
  double r = reduce(x, &q), v = (q & 1) ? cos_poly(r) : sin_poly(r);
  return (q & 2) ? -v : v;
}

double sv_cos(double x) {
  if (!(x > -1e9 && x < 1e9)) return NAN;
  int q;
  double r = reduce(x, &q), v = (q & 1) ? sin_poly(r) : cos_poly(r);
  return (q == 1 || q == 2) ? -v : v;
}

double sv_tan(double x) { return sv_sin(x) / sv_cos(x); }

// atan on [0,1]: two half-angle steps bring the argument below 0.2, then the odd series.
static double atan01(double x) {
  x = x / (1.0 + sqrt(1.0 + x * x));
  x = x / (1.0 + sqrt(1.0 + x * x));
  double z = x * x, p = 0;
  for (int i = 27; i >= 3; i -= 2) p = -z * (1.0 / (double)i + p);
  return 4.0 * (x + x * p);
}

double sv_atan2(double y, double x) {
  if (x != x || y != y) return NAN;
  double ax = fabs(x), ay = fabs(y), a;
  if (ax == 0 && ay == 0) return 0;
  if (ay <= ax) a = atan01(ay / ax);
  else a = 0.5 * SV_PI - atan01(ax / ay);
  if (x < 0) a = SV_PI - a;
  return y < 0 ? -a : a;
}

double sv_acos(double x) {
  if (x >= 1) return 0;
  if (x <= -1) return SV_PI;
  return sv_atan2(sqrt((1.0 - x) * (1.0 + x)), x);
}
