// SPDX-License-Identifier: Apache-2.0
#include "src/splat/surface.h"

#include <math.h>

#include "src/base/mathx.h"
#include "src/base/vec.h"

// Axes of a Gaussian in the camera's frame, each as long as its deviation: columns of axis.
static void camera_axes(const sv_gaussian *g, const sv_view *v, float axis[9]) {
  const double q[4] = {(double)g->quat_wxyz[0], (double)g->quat_wxyz[1], (double)g->quat_wxyz[2],
                       (double)g->quat_wxyz[3]};
  double r[9];
  sv_quat_to_mat(r, q);
  for (int k = 0; k < 3; k++) {
    const float size = (float)sv_exp((double)g->log_scale[k]);
    for (int i = 0; i < 3; i++) {
      float sum = 0;
      for (int j = 0; j < 3; j++) sum += v->r[3 * i + j] * (float)r[3 * j + k];
      axis[3 * i + k] = sum * size;
    }
  }
}

// Slopes of depth over the image: Cov(depth, place) Cov(place)^-1.
static void slopes(const sv_surface *s, const sv_gaussian *g, const float x_cam[3], float *slope) {
  float axis[9], j[6], to_depth[3] = {0, 0, 1};
  float uu = s->dilation_px2, uv = 0, vv = s->dilation_px2, zu = 0, zv = 0;
  camera_axes(g, s->view, axis);
  sv_view_jacobian(s->view, x_cam, j);
  if (s->view->fisheye) { // there depth is the distance
    const float length = sqrtf(x_cam[0] * x_cam[0] + x_cam[1] * x_cam[1] + x_cam[2] * x_cam[2]);
    for (int k = 0; k < 3; k++) to_depth[k] = x_cam[k] / sv_maxf(length, 1e-20f);
  }
  for (int k = 0; k < 3; k++) {
    float u = 0, v = 0, z = 0;
    for (int i = 0; i < 3; i++) {
      u += j[i] * axis[3 * i + k];
      v += j[3 + i] * axis[3 * i + k];
      z += to_depth[i] * axis[3 * i + k];
    }
    uu += u * u;
    uv += u * v;
    vv += v * v;
    zu += z * u;
    zv += z * v;
  }
  const float det = uu * vv - uv * uv;
  slope[0] = det > 0 ? (zu * vv - zv * uv) / det : 0;
  slope[1] = det > 0 ? (zv * uu - zu * uv) / det : 0;
}

void sv_surface_slopes(const sv_surface *s, int begin, int end, sv_splat *splat) {
  const sv_view *v = s->view;
  if (end > s->g->n) end = s->g->n;
  for (int i = begin; i < end; i++) {
    sv_gaussian g;
    float x[3];
    if (!splat[i].n_intersections) continue;
    sv_gaussians_get(s->g, i, &g);
    for (int k = 0; k < 3; k++)
      x[k] = v->r[3 * k] * g.mean[0] + v->r[3 * k + 1] * g.mean[1] + v->r[3 * k + 2] * g.mean[2] + v->t[k];
    slopes(s, &g, x, splat[i].rgb);
  }
}
