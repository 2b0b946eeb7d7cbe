// SPDX-License-Identifier: Apache-2.0
// Elementary functions with the same bits on every machine.
// libm differs between x86 and aarch64 and between processors of one kind, so nothing that reaches
// a digest may use it. The operations + - * / sqrt, floor and fma are exact by IEEE 754 and may be
// used. Error bounds were measured against libm over the stated ranges (tests/unit/test_base.c).
#ifndef SV_BASE_MATHX_H
#define SV_BASE_MATHX_H

#ifdef __cplusplus
extern "C" {
#endif

#define SV_PI 3.14159265358979323846

double sv_exp(double x);           // rel. error < 1e-15 on [-700, 700]; 0 below, inf above
double sv_log(double x);           // rel. error < 1e-15; -inf at 0, NaN below
double sv_pow(double x, double y); // x > 0; exp(y log x), rel. error < 1e-14 for |y log x| < 30
double sv_sin(double x_rad);       // abs. error < 1e-15 for |x| < 1e5
double sv_cos(double x_rad);
double sv_tan(double x_rad);
double sv_atan2(double y, double x); // abs. error < 1e-15
double sv_acos(double x);            // through atan2: full accuracy near 1 and -1

static inline float sv_minf(float a, float b) { return a < b ? a : b; }
static inline double sv_mind(double a, double b) { return a < b ? a : b; }
static inline double sv_maxd(double a, double b) { return a > b ? a : b; }
static inline float sv_maxf(float a, float b) { return a > b ? a : b; }
static inline float sv_clampf(float x, float lo, float hi) { return x < lo ? lo : x > hi ? hi : x; }
static inline int sv_mini(int a, int b) { return a < b ? a : b; }
static inline int sv_maxi(int a, int b) { return a > b ? a : b; }
static inline int sv_clampi(int x, int lo, int hi) { return x < lo ? lo : x > hi ? hi : x; }

#ifdef __cplusplus
}
#endif
#endif
