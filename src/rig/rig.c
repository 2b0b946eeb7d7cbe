// SPDX-License-Identifier: Apache-2.0
#include "src/rig/rig.h"

#include <math.h>

#include "calib/fisheye.h"

sv_status sv_rig_init(sv_rig *rig, int cap, sv_arena *arena) {
  if (cap < 1 || cap > SV_CAP_SUB_VIEWS) return SV_E_ARG;
  *rig = (sv_rig){.cap_sub_views = cap, .splines = arena};
  rig->sub_views = SV_TAKE(arena, sv_sub_view, cap);
  return arena->status < 0 ? arena->status : SV_OK;
}

bool sv_rig_is_rolling(const sv_rig *rig) {
  for (int i = 0; i < rig->n_sub_views; i++)
    if (rig->sub_views[i].shutter.readout_s > 0) return true;
  return false;
}

double sv_rig_angular_baseline_rad(const sv_rig *rig, const double point[3]) {
  double best = 0;
  for (int i = 0; i < rig->n_sub_views; i++) {
    double a[3], b[3];
    sv_pose_centre(a, &rig->sub_views[i].cam_from_rig);
    sv_sub3(a, a, point);
    for (int j = i + 1; j < rig->n_sub_views; j++) {
      sv_pose_centre(b, &rig->sub_views[j].cam_from_rig);
      sv_sub3(b, b, point);
      double angle = sv_angle_between(a, b);
      if (angle > best) best = angle;
    }
  }
  return best;
}

sv_view sv_view_make(int w, int h, const double pinhole[4], const sv_pose *pose) {
  sv_view v = {.width_px = w,
               .height_px = h,
               .fx = (float)pinhole[0],
               .fy = (float)pinhole[1],
               .cx = (float)pinhole[2],
               .cy = (float)pinhole[3]};
  for (int i = 0; i < 9; i++) v.r[i] = (float)pose->r[i];
  for (int i = 0; i < 3; i++) v.t[i] = (float)pose->t[i];
  return v;
}

void sv_view_centre(float out[3], const sv_view *v) {
  for (int i = 0; i < 3; i++) out[i] = -(v->r[i] * v->t[0] + v->r[3 + i] * v->t[1] + v->r[6 + i] * v->t[2]);
}

float sv_view_distance(const sv_view *v, const float x[3]) {
  float c[3];
  sv_view_centre(c, v);
  for (int i = 0; i < 3; i++) c[i] -= x[i];
  return sqrtf(c[0] * c[0] + c[1] * c[1] + c[2] * c[2]);
}

sv_view sv_view_scaled(const sv_view *v, int k) {
  sv_view s = *v;
  if (k <= 1) return s;
  s.width_px = v->width_px / k > 0 ? v->width_px / k : 1;
  s.height_px = v->height_px / k > 0 ? v->height_px / k : 1;
  float f = 1.0f / (float)k;
  s.fx *= f;
  s.fy *= f;
  s.cx *= f;
  s.cy *= f;
  return s;
}

sv_view sv_view_enlarged(const sv_view *v, int k) {
  sv_view s = *v;
  const float f = (float)k;
  s.width_px *= k;
  s.height_px *= k;
  s.fx *= f;
  s.fy *= f;
  s.cx *= f;
  s.cy *= f;
  return s;
}

bool sv_view_project(const sv_view *v, const float x[3], float uv_px[2], float *depth) {
  if (!v->fisheye) {
    if (!(x[2] > 0)) return false;
    uv_px[0] = v->fx * x[0] / x[2] + v->cx;
    uv_px[1] = v->fy * x[1] / x[2] + v->cy;
    *depth = x[2];
    return true;
  }
  float xy[2];
  if (!sv_fisheye_project(v->fisheye, x, xy)) return false;
  uv_px[0] = v->fx * xy[0] + v->cx;
  uv_px[1] = v->fy * xy[1] + v->cy;
  *depth = sqrtf(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]);
  return true;
}

void sv_view_jacobian(const sv_view *v, const float x[3], float j[6]) {
  if (v->fisheye) {
    sv_fisheye_jacobian(v->fisheye, x, j);
  } else {
    const float iz = 1 / x[2], of_axis[6] = {iz, 0, -x[0] * iz * iz, 0, iz, -x[1] * iz * iz};
    for (int i = 0; i < 6; i++) j[i] = of_axis[i];
  }
  for (int i = 0; i < 3; i++) {
    j[i] *= v->fx;
    j[3 + i] *= v->fy;
  }
}

bool sv_view_ray(const sv_view *v, float u_px, float v_px, float ray[3]) {
  const float xy[2] = {(u_px - v->cx) / v->fx, (v_px - v->cy) / v->fy};
  if (v->fisheye) return sv_fisheye_unproject(v->fisheye, xy, ray);
  ray[0] = xy[0];
  ray[1] = xy[1];
  ray[2] = 1;
  return true;
}
