// SPDX-License-Identifier: Apache-2.0
// Kannala and Brandt's fisheye ("A Generic Camera Model and Calibration Method for Conventional,
// Wide-Angle, and Fish-Eye Lenses", PAMI 2006) with four terms, as OpenCV's fisheye module,
// COLMAP's OPENCV_FISHEYE and Kalibr's equidistant have it. With r = sqrt(X^2 + Y^2), t = atan2(r,
// Z):
//   d(t) = t + k1 t^3 + k2 t^5 + k3 t^7 + k4 t^9,  u = fx d(t) X/r + cx,  v = fy d(t) Y/r + cy
// Rays are accepted as far as d grows, at most to 180 degrees off the axis: also behind the
// camera's plane.
#include <math.h>
#include <stddef.h>

#include "calib/model_fn.h"
#include "calib/poly.h"
#include "src/base/mathx.h"

typedef struct {
  double d, dd; // d(t) and its derivative
} radial;

static radial radial_at(const double k[4], double t) {
  double s = t * t;
  return (radial){t * (1 + s * (k[0] + s * (k[1] + s * (k[2] + s * k[3])))),
                  1 + s * (3 * k[0] + s * (5 * k[1] + s * (7 * k[2] + s * 9 * k[3])))};
}

static bool is_growing(const double k[4], double t) {
  const double slope[SV_POLY_COEF] = {1, 3 * k[0], 5 * k[1], 7 * k[2], 9 * k[3]};
  return sv_poly_is_positive(slope, t * t);
}

bool sv_kb4_project(const sv_camera_model *m, const double x_cam[3], double uv[2], double *duv_dx,
                    double *duv_dp) {
  double x = x_cam[0], y = x_cam[1], z = x_cam[2], r2 = x * x + y * y, r = sqrt(r2), n2 = r2 + z * z;
  const double *k = m->p + 4, fx = m->p[0], fy = m->p[1];
  if (!(n2 > 0 && n2 < 1e300)) return false;
  double t = sv_atan2(r, z);
  // On the axis behind the camera there is no direction to go.
  bool is_axis = r2 < 1e-24 * n2;
  if ((is_axis && z < 0) || !is_growing(k, t)) return false;
  radial g = radial_at(k, t);
  double a = is_axis ? 1 / z : g.d / r; // d(t) / r
  uv[0] = fx * a * x + m->p[2];
  uv[1] = fy * a * y + m->p[3];
  if (!(fabs(uv[0]) < 1e300 && fabs(uv[1]) < 1e300)) return false;
  if (duv_dx) {
    double da_dr2 = is_axis ? 0 : (g.dd * z / n2 - a) / r2; // da/dX = X da_dr2
    double da_dz = is_axis ? -1 / (z * z) : -g.dd / n2;
    duv_dx[0] = fx * (a + x * x * da_dr2);
    duv_dx[1] = fx * x * y * da_dr2;
    duv_dx[2] = fx * x * da_dz;
    duv_dx[3] = fy * x * y * da_dr2;
    duv_dx[4] = fy * (a + y * y * da_dr2);
    duv_dx[5] = fy * y * da_dz;
  }
  if (duv_dp) {
    double cx = is_axis ? 0 : x / r, cy = is_axis ? 0 : y / r, power = t * t * t;
    duv_dp[0] = a * x;
    duv_dp[1] = 0;
    duv_dp[2] = 1;
    duv_dp[3] = 0;
    duv_dp[8] = 0;
    duv_dp[9] = a * y;
    duv_dp[10] = 0;
    duv_dp[11] = 1;
    for (int i = 0; i < 4; i++, power *= t * t) {
      duv_dp[4 + i] = fx * cx * power;
      duv_dp[12 + i] = fy * cy * power;
    }
  }
  return true;
}

// d(t) = rho by Newton, kept inside a bracket: d grows from 0 on.
bool sv_kb4_unproject(const sv_camera_model *m, const double uv[2], double ray[3]) {
  double x = (uv[0] - m->p[2]) / m->p[0], y = (uv[1] - m->p[3]) / m->p[1], rho = sqrt(x * x + y * y);
  const double *k = m->p + 4, f = fabs(m->p[0]) > fabs(m->p[1]) ? fabs(m->p[0]) : fabs(m->p[1]);
  if (!(rho < 1e6)) return false; // also NaN
  double lo = 0, hi = SV_PI, t = rho < hi ? rho : hi;
  for (int it = 0; it < 200; it++) {
    radial g = radial_at(k, t);
    bool is_past = !is_growing(k, t) || g.d > rho;
    if (is_past) hi = t;
    else lo = t;
    double next = g.dd > 0 ? t - (g.d - rho) / g.dd : lo;
    if (!(next > lo && next < hi)) next = 0.5 * (lo + hi);
    if (next == t || next == lo || next == hi) {
      t = next;
      break;
    }
    t = next;
  }
  if (!is_growing(k, t) || !(fabs(radial_at(k, t).d - rho) * f < 1e-8)) return false;
  double s = rho > 0 ? sv_sin(t) / rho : 0;
  ray[0] = x * s;
  ray[1] = y * s;
  ray[2] = sv_cos(t);
  return true;
}
