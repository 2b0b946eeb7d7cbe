// SPDX-License-Identifier: Apache-2.0
// Pictures of the model from all round.
#include "src/run/app.h"
#include "src/base/mathx.h"

void sv_app_up(const sv_app *app, float up[3]) {
  float sum[3] = {0};
  for (int i = 0; i < sv_driver_n_views(&app->trainer); i++)
    for (int k = 0; k < 3; k++) sum[k] -= sv_driver_view(&app->trainer, i)->r[3 + k];
  float n = sqrtf(sum[0] * sum[0] + sum[1] * sum[1] + sum[2] * sum[2]);
  for (int k = 0; k < 3; k++) up[k] = n > 1e-3f ? sum[k] / n : k == 1 ? -1.0f : 0.0f;
}

static sv_view orbit_view(const sv_app *app, int i, int n) {
  const sv_view *first = sv_driver_view(&app->trainer, 0);
  float eye_f[3], up_f[3];
  double up[3], arm[3], centre[3], turn[9], axis[3], eye[3];
  sv_view_centre(eye_f, first);
  sv_app_up(app, up_f);
  for (int k = 0; k < 3; k++) {
    up[k] = (double)up_f[k];
    centre[k] = (double)app->trainer.centre[k];
    arm[k] = (double)eye_f[k] - centre[k];
    axis[k] = up[k] * 2 * SV_PI * i / n;
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

sv_status sv_app_publish_orbit(sv_app *app, int n) {
  const sv_publish *p = &app->port.publish;
  if (!p->image || sv_driver_n_views(&app->trainer) < 1) return SV_OK;
  sv_render_options o = sv_train_render_options(&app->trainer, 1.0f, false);
  const sv_planes *rgb = &app->trainer.render.rgb;
  for (int i = 0; i < n; i++) {
    char name[32];
    sv_view v = orbit_view(app, i, n);
    sv_status s = sv_render(&app->trainer.render, &app->trainer.g, &v, &o);
    if (s < 0) return s;
    for (int y = 0; y < v.height_px; y++)
      for (int x = 0; x < v.width_px; x++)
        for (int k = 0; k < 3; k++)
          app->picture[3 * ((size_t)y * (size_t)v.width_px + (size_t)x) + (size_t)k] =
              (uint8_t)(sv_clampf(rgb->c[k][(long)y * rgb->stride + x], 0.0f, 1.0f) * 255.0f + 0.5f);
    sv_fmt(name, sizeof name, "orbit_%d%d%d", i / 100 % 10, i / 10 % 10, i % 10);
    p->image(p->self, name, v.width_px, v.height_px, app->picture);
  }
  return SV_OK;
}
