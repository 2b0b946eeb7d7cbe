// SPDX-License-Identifier: Apache-2.0
// u = fx X/Z + cx, v = fy Y/Z + cy.
#include <math.h>
#include <stddef.h>

#include "calib/model_fn.h"

bool sv_pinhole_project(const sv_camera_model *m, const double x_cam[3], double uv[2], double *duv_dx,
                        double *duv_dp) {
  if (!(x_cam[2] > 0)) return false;
  double iz = 1 / x_cam[2], x = x_cam[0] * iz, y = x_cam[1] * iz;
  double fx = m->p[0], fy = m->p[1];
  uv[0] = fx * x + m->p[2];
  uv[1] = fy * y + m->p[3];
  if (!(fabs(uv[0]) < 1e300 && fabs(uv[1]) < 1e300)) return false;
  if (duv_dx) {
    duv_dx[0] = fx * iz;
    duv_dx[1] = 0;
    duv_dx[2] = -fx * x * iz;
    duv_dx[3] = 0;
    duv_dx[4] = fy * iz;
    duv_dx[5] = -fy * y * iz;
  }
  if (duv_dp) {
    duv_dp[0] = x;
    duv_dp[1] = 0;
    duv_dp[2] = 1;
    duv_dp[3] = 0;
    duv_dp[4] = 0;
    duv_dp[5] = y;
    duv_dp[6] = 0;
    duv_dp[7] = 1;
  }
  return true;
}

bool sv_pinhole_unproject(const sv_camera_model *m, const double uv[2], double ray[3]) {
  double x = (uv[0] - m->p[2]) / m->p[0], y = (uv[1] - m->p[3]) / m->p[1];
  double n = sqrt(x * x + y * y + 1);
  if (!(n < 1e150)) return false; // also NaN: a focal length of zero
  ray[0] = x / n;
  ray[1] = y / n;
  ray[2] = 1 / n;
  return true;
}
