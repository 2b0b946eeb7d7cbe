// SPDX-License-Identifier: Apache-2.0
#include "src/rig/photometry.h"

#include <math.h>

#include "src/base/mathx.h"

#define LEAST_LIGHT 0.05
#define MOST_LIGHT  1.5
#define MOST_GAIN   10.0

sv_photometry sv_photometry_none(const sv_camera_model *m) {
  const double *p = m->p;
  const double x = sv_maxd(p[2], m->width_px - p[2]) / p[0], y = sv_maxd(p[3], m->height_px - p[3]) / p[1];
  return (sv_photometry){
      .is_known = true, .color = {1, 0, 0, 0, 1, 0, 0, 0, 1}, .corner = sqrt(x * x + y * y)};
}

double sv_photometry_r2(const sv_photometry *p, const sv_camera_model *m, double u_px, double v_px) {
  const double x = (u_px - m->p[2]) / m->p[0], y = (v_px - m->p[3]) / m->p[1];
  return (x * x + y * y) / (p->corner * p->corner);
}

double sv_photometry_falloff(const sv_photometry *p, double r2) {
  const double q = r2 < 1 ? r2 : 1;
  return 1 + q * (p->falloff[0] + q * (p->falloff[1] + q * p->falloff[2]));
}

void sv_photometry_fit(const double light[3], double k[3]) {
  double d[3];
  for (int i = 0; i < 3; i++) d[i] = (light[i] - 1) * 3 / (i + 1);
  // a parabola through three points one third apart, about the first
  const double second = 4.5 * (d[2] - 2 * d[1] + d[0]), first = 3 * (d[1] - d[0]) - second / 3;
  k[2] = second;
  k[1] = first - 2 * second / 3;
  k[0] = d[0] - first / 3 + second / 9;
}

bool sv_photometry_inverse(const sv_photometry *p, double out[9]) {
  const double *m = p->color;
  const double c[9] = {m[4] * m[8] - m[5] * m[7], m[2] * m[7] - m[1] * m[8], m[1] * m[5] - m[2] * m[4],
                       m[5] * m[6] - m[3] * m[8], m[0] * m[8] - m[2] * m[6], m[2] * m[3] - m[0] * m[5],
                       m[3] * m[7] - m[4] * m[6], m[1] * m[6] - m[0] * m[7], m[0] * m[4] - m[1] * m[3]};
  const double det = m[0] * c[0] + m[1] * c[3] + m[2] * c[6];
  if (!(det > 0)) return false;
  for (int i = 0; i < 9; i++) {
    out[i] = c[i] / det;
    if (!(fabs(out[i]) <= MOST_GAIN)) return false;
  }
  return true;
}

double sv_photometry_response(const sv_photometry *p) {
  const double green = p->is_known ? p->color[3] + p->color[4] + p->color[5] : 1;
  return green > 1 / MOST_GAIN && green < MOST_GAIN ? green : 1;
}

bool sv_photometry_has_light(const sv_photometry *p) {
  for (int i = 0; i <= 64; i++) {
    const double f = sv_photometry_falloff(p, i / 64.0);
    if (!(f >= LEAST_LIGHT && f <= MOST_LIGHT)) return false;
  }
  return true;
}
