// SPDX-License-Identifier: Apache-2.0
#include "src/rig/bounds.h"

// Solves a symmetric positive 3x3 system by cofactors. Returns its determinant.
static double solve3(const double a[6], const double b[3], double x[3]) { // a: xx xy xz yy yz zz
  double c00 = a[3] * a[5] - a[4] * a[4], c01 = a[2] * a[4] - a[1] * a[5], c02 = a[1] * a[4] - a[2] * a[3];
  double c11 = a[0] * a[5] - a[2] * a[2], c12 = a[1] * a[2] - a[0] * a[4], c22 = a[0] * a[3] - a[1] * a[1];
  double det = a[0] * c00 + a[1] * c01 + a[2] * c02;
  if (det == 0) return 0;
  x[0] = (c00 * b[0] + c01 * b[1] + c02 * b[2]) / det;
  x[1] = (c01 * b[0] + c11 * b[1] + c12 * b[2]) / det;
  x[2] = (c02 * b[0] + c12 * b[1] + c22 * b[2]) / det;
  return det;
}

static void ahead(const sv_view *v, const double mean[3], double forward[3], double distance, sv_bounds *b) {
  double f = sv_norm3(forward);
  for (int i = 0; i < 3; i++)
    b->centre[i] = (float)(mean[i] + (f > 1e-9 ? forward[i] / f : (double)v[0].r[6 + i]) * distance);
}

sv_bounds sv_bounds_of_views(const sv_view *views, int n) {
  double a[6] = {0}, b[3] = {0}, mean[3] = {0}, forward[3] = {0}, p[3] = {0}, spread = 0, distance = 0;
  sv_bounds out;
  for (int k = 0; k < n; k++) {
    float c[3];
    const float *d = views[k].r + 6; // optical axis in the world
    sv_view_centre(c, &views[k]);
    double m[6] = {1 - (double)d[0] * d[0], -(double)d[0] * d[1], -(double)d[0] * d[2],
                   1 - (double)d[1] * d[1], -(double)d[1] * d[2], 1 - (double)d[2] * d[2]};
    for (int i = 0; i < 6; i++) a[i] += m[i] / n;
    b[0] += (m[0] * c[0] + m[1] * c[1] + m[2] * c[2]) / n;
    b[1] += (m[1] * c[0] + m[3] * c[1] + m[4] * c[2]) / n;
    b[2] += (m[2] * c[0] + m[4] * c[1] + m[5] * c[2]) / n;
    for (int i = 0; i < 3; i++) {
      mean[i] += (double)c[i] / n;
      forward[i] += (double)d[i] / n;
    }
  }
  for (int k = 0; k < n; k++) {
    float c[3];
    sv_view_centre(c, &views[k]);
    double e[3] = {c[0] - mean[0], c[1] - mean[1], c[2] - mean[2]};
    if (sv_norm3(e) > spread) spread = sv_norm3(e);
  }
  // det is about sin^2 of the angle between the axes: below 1e-4 (half a degree) the intersection
  // is noise.
  double det = n > 1 ? solve3(a, b, p) : 0;
  double to[3] = {p[0] - mean[0], p[1] - mean[1], p[2] - mean[2]};
  if (!(det > 1e-4) || sv_dot3(to, forward) < 0) {
    distance = spread > 0 ? 10 * spread : 1;
    ahead(views, mean, forward, distance, &out);
    if (det > 1e-4 && spread > 0) // cameras that look outwards: the ball is around them
      for (int i = 0; i < 3; i++) out.centre[i] = (float)mean[i];
    out.radius = (float)(0.5 * distance);
    return out;
  }
  for (int k = 0; k < n; k++) {
    float c[3];
    sv_view_centre(c, &views[k]);
    double e[3] = {c[0] - p[0], c[1] - p[1], c[2] - p[2]};
    distance += sv_norm3(e) / n;
  }
  for (int i = 0; i < 3; i++) out.centre[i] = (float)p[i];
  out.radius = (float)(0.35 * distance);
  return out;
}
