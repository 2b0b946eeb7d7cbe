// SPDX-License-Identifier: Apache-2.0
// Renderings from around the scene.
#include "src/preview/pictures.h"

#include "src/base/mathx.h"
#include "src/base/str.h"
#include "src/format/axes.h"
#include "src/train/driver.h"

void sv_pictures_up(const sv_trainer *t, float up[3]) {
  float sum[3] = {0, -1e-3f, 0};
  double axis[3] = {0, -1, 0};
  for (int i = 0; i < sv_driver_n_views(t); i++)
    for (int k = 0; k < 3; k++) sum[k] -= sv_driver_view(t, i)->r[3 + k];
  sv_up_axis(sv_up_name(sum), axis);
  for (int k = 0; k < 3; k++) up[k] = (float)axis[k];
}

sv_view sv_pictures_turned(const sv_trainer *t, double turn_rad) {
  const sv_view *first = sv_driver_view(t, 0);
  float eye_f[3], up_f[3];
  double up[3], arm[3], centre[3], turn[9], axis[3], eye[3];
  sv_view_centre(eye_f, first);
  sv_pictures_up(t, up_f);
  for (int k = 0; k < 3; k++) {
    up[k] = (double)up_f[k];
    centre[k] = (double)t->centre[k];
    arm[k] = (double)eye_f[k] - centre[k];
    axis[k] = up[k] * turn_rad;
  }
  sv_rodrigues(turn, axis);
  sv_apply33(arm, turn, arm);
  for (int k = 0; k < 3; k++) eye[k] = centre[k] + arm[k];
  sv_pose pose;
  // Straight from above: there is no way round
  if (!sv_pose_look_at(&pose, eye, centre, up)) return *first;
  return sv_view_make(
      first->width_px, first->height_px,
      (const double[]){(double)first->fx, (double)first->fy, (double)first->cx, (double)first->cy}, &pose);
}

sv_status sv_pictures_orbit(const sv_pictures *o, int n) {
  const sv_publish *p = o->publish;
  sv_trainer *t = o->t;
  if (!p->image || sv_driver_n_views(t) < 1) return SV_OK;
  sv_render_options options = sv_train_render_options(t, 1.0f, false);
  const sv_planes *rgb = &t->render.rgb;
  for (int i = 0; i < n; i++) {
    char name[32];
    sv_view v = sv_pictures_turned(t, 2 * SV_PI * i / n);
    sv_status s = sv_render(&t->render, &t->g, &v, &options);
    if (s < 0) return s;
    for (int y = 0; y < v.height_px; y++)
      for (int x = 0; x < v.width_px; x++)
        sv_pictures_pixel(o->rgb + 3 * ((size_t)y * (size_t)v.width_px + (size_t)x), rgb, x, y);
    sv_fmt(name, sizeof name, "orbit_%d%d%d", i / 100 % 10, i / 10 % 10, i % 10);
    p->image(p->self, name, v.width_px, v.height_px, o->rgb);
  }
  return SV_OK;
}
