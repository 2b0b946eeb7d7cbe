// SPDX-License-Identifier: Apache-2.0
// OpenCV's distortion with 4, 5 or 8 terms k1 k2 p1 p2 [k3 [k4 k5 k6]] (OpenCV documentation,
// "Camera Calibration and 3D Reconstruction"), with x = X/Z, y = Y/Z, s = x^2 + y^2:
//   c  = (1 + k1 s + k2 s^2 + k3 s^3) / (1 + k4 s + k5 s^2 + k6 s^3)
//   x' = x c + 2 p1 x y + p2 (s + 2 x^2),   y' = y c + p1 (s + 2 y^2) + 2 p2 x y
//   u  = fx x' + cx,                        v  = fy y' + cy
// The radial part r c(r^2) grows only up to some angle; beyond it the polynomial folds back and
// shows rays that the lens never saw inside the image. Such points are refused.
#include <math.h>
#include <stddef.h>

#include "calib/model_fn.h"
#include "calib/poly.h"

#define N_COEF SV_POLY_COEF
#define MAX_S  1e12 // beyond 89.9999 degrees there is no image

typedef struct {
  double k1, k2, p1, p2, k3, k4, k5, k6;
} distortion;

static distortion read_terms(const sv_camera_model *m) {
  double d[8] = {0};
  int n = sv_model_n_params(m->kind) - 4;
  for (int i = 0; i < n && i < 8; i++) d[i] = m->p[4 + i];
  return (distortion){d[0], d[1], d[2], d[3], d[4], d[5], d[6], d[7]};
}

// Does r c(r^2) grow strictly on the whole way from the axis to s = r^2? With c = N/D its
// derivative has the sign of N D + 2 s (N' D - N D').
static bool is_monotonic(const distortion *k, double s) {
  const double n[4] = {1, k->k1, k->k2, k->k3}, d[4] = {1, k->k4, k->k5, k->k6};
  double g[N_COEF] = {0}, den[N_COEF] = {1, k->k4, k->k5, k->k6};
  for (int i = 0; i < 4; i++)
    for (int j = 0; j < 4; j++) g[i + j] += n[i] * d[j] * (1 + 2 * (i - j));
  bool is_rational = k->k4 != 0 || k->k5 != 0 || k->k6 != 0;
  return sv_poly_is_positive(g, s) && (!is_rational || sv_poly_is_positive(den, s));
}

typedef struct {
  double xd, yd;             // distorted
  double jxx, jxy, jyy, jyx; // d(xd, yd) / d(x, y)
  double s, c, inv_d;
} distorted;

static distorted distort(const distortion *k, double x, double y) {
  double s = x * x + y * y;
  double n = 1 + s * (k->k1 + s * (k->k2 + s * k->k3)), d = 1 + s * (k->k4 + s * (k->k5 + s * k->k6));
  double dn = k->k1 + s * (2 * k->k2 + s * 3 * k->k3), dd = k->k4 + s * (2 * k->k5 + s * 3 * k->k6);
  double inv_d = 1 / d, c = n * inv_d, dc = (dn - c * dd) * inv_d; // dc = dc/ds
  distorted o = {.s = s, .c = c, .inv_d = inv_d};
  o.xd = x * c + 2 * k->p1 * x * y + k->p2 * (s + 2 * x * x);
  o.yd = y * c + k->p1 * (s + 2 * y * y) + 2 * k->p2 * x * y;
  o.jxx = c + 2 * x * x * dc + 2 * k->p1 * y + 6 * k->p2 * x;
  o.jxy = 2 * x * y * dc + 2 * k->p1 * x + 2 * k->p2 * y;
  o.jyx = o.jxy;
  o.jyy = c + 2 * y * y * dc + 6 * k->p1 * y + 2 * k->p2 * x;
  return o;
}

// Inside the range where the map is one to one: the radial part grows, and the tangential terms
// have not turned the image inside out.
static bool is_inside(const distortion *k, const distorted *o) {
  if (!(o->s <= MAX_S) || !(o->jxx * o->jyy - o->jxy * o->jyx > 0)) return false;
  return is_monotonic(k, o->s);
}

bool sv_opencv8_project(const sv_camera_model *m, const double x_cam[3], double uv[2], double *duv_dx,
                        double *duv_dp) {
  if (!(x_cam[2] > 0)) return false;
  double iz = 1 / x_cam[2], x = x_cam[0] * iz, y = x_cam[1] * iz, fx = m->p[0], fy = m->p[1];
  distortion k = read_terms(m);
  distorted o = distort(&k, x, y);
  if (!is_inside(&k, &o)) return false;
  uv[0] = fx * o.xd + m->p[2];
  uv[1] = fy * o.yd + m->p[3];
  if (!(fabs(uv[0]) < 1e300 && fabs(uv[1]) < 1e300)) return false;
  if (duv_dx) {
    duv_dx[0] = fx * o.jxx * iz;
    duv_dx[1] = fx * o.jxy * iz;
    duv_dx[2] = -(duv_dx[0] * x + duv_dx[1] * y);
    duv_dx[3] = fy * o.jyx * iz;
    duv_dx[4] = fy * o.jyy * iz;
    duv_dx[5] = -(duv_dx[3] * x + duv_dx[4] * y);
  }
  if (duv_dp) {
    int n = sv_model_n_params(m->kind);
    double s = o.s, e = o.inv_d, ec = -o.c * o.inv_d; // dc/dk1 = s/D, dc/dk4 = -c s/D, ...
    const double row_u[12] = {o.xd,
                              0,
                              1,
                              0,
                              fx * x * e * s,
                              fx * x * e * s * s,
                              fx * 2 * x * y,
                              fx * (s + 2 * x * x),
                              fx * x * e * s * s * s,
                              fx * x * ec * s,
                              fx * x * ec * s * s,
                              fx * x * ec * s * s * s};
    const double row_v[12] = {0,
                              o.yd,
                              0,
                              1,
                              fy * y * e * s,
                              fy * y * e * s * s,
                              fy * (s + 2 * y * y),
                              fy * 2 * x * y,
                              fy * y * e * s * s * s,
                              fy * y * ec * s,
                              fy * y * ec * s * s,
                              fy * y * ec * s * s * s};
    for (int i = 0; i < n && i < 12; i++) {
      duv_dp[i] = row_u[i];
      duv_dp[n + i] = row_v[i];
    }
  }
  return true;
}

// Newton on (x, y), with the step halved until it stays in the range and comes nearer. The barrel
// lens of a phone converges from below without halving; a folded start is pulled towards the axis.
bool sv_opencv8_unproject(const sv_camera_model *m, const double uv[2], double ray[3]) {
  double fx = m->p[0], fy = m->p[1], tx = (uv[0] - m->p[2]) / fx, ty = (uv[1] - m->p[3]) / fy;
  if (!(fabs(tx) < 1e6 && fabs(ty) < 1e6)) return false;
  distortion k = read_terms(m);
  double x = tx, y = ty;
  distorted o = distort(&k, x, y);
  for (int i = 0; i < 60 && !is_inside(&k, &o); i++) {
    x *= 0.75;
    y *= 0.75;
    o = distort(&k, x, y);
  }
  if (!is_inside(&k, &o)) return false;
  double ex = o.xd - tx, ey = o.yd - ty, err = ex * ex + ey * ey;
  for (int it = 0; it < 100 && err > 0; it++) {
    double det = o.jxx * o.jyy - o.jxy * o.jyx;
    double dx = (o.jyy * ex - o.jxy * ey) / det, dy = (o.jxx * ey - o.jyx * ex) / det, step = 1;
    bool is_better = false;
    for (int half = 0; half < 40 && !is_better; half++, step *= 0.5) {
      distorted o2 = distort(&k, x - step * dx, y - step * dy);
      double fx2 = o2.xd - tx, fy2 = o2.yd - ty, err2 = fx2 * fx2 + fy2 * fy2;
      if (!(err2 < err) || !is_inside(&k, &o2)) continue;
      x -= step * dx;
      y -= step * dy;
      o = o2;
      ex = fx2;
      ey = fy2;
      err = err2;
      is_better = true;
    }
    if (!is_better) break;
  }
  // Far from the pixel means outside what the lens sees; what rounding leaves is below 1e-10 px.
  if (!(sqrt(err) * (fabs(fx) > fabs(fy) ? fabs(fx) : fabs(fy)) < 1e-8)) return false;
  double n = sqrt(x * x + y * y + 1);
  ray[0] = x / n;
  ray[1] = y / n;
  ray[2] = 1 / n;
  return true;
}
