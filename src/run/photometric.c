// SPDX-License-Identifier: Apache-2.0
// What a run measured of its cameras' light (src/train/appearance_start.h), as a photometric
// calibration of each sub-view: a member of run.json.
#include <math.h>
#include <string.h>

#include "src/base/mathx.h"
#include "src/format/photometry_json.h"
#include "src/run/app.h"

#define CAP_REPORTED 64 // sub-views; more would not fit into run.json

// Pictures that a calibration of the rig corrected already tell only what it left.
static bool is_raw(const sv_app *app) {
  if (app->cfg.is_deep || app->trainer.cfg.appearance.n_cameras < 1 || app->exposures.n < 1 ||
      app->cfg.rig->n_sub_views > CAP_REPORTED)
    return false;
  for (int i = 0; i < app->cfg.rig->n_sub_views; i++)
    if (app->cfg.rig->sub_views[i].photometric.is_known) return false;
  return true;
}

// r^2 in the pictures that were trained on, of a place in those of the lens.
static bool view_r2(const sv_view *view, const sv_camera_model *lens, const double uv_px[2], double *r2) {
  double ray[3];
  float x[3], at[2], depth;
  if (!sv_model_unproject(lens, uv_px, ray)) return false;
  for (int i = 0; i < 3; i++) x[i] = (float)ray[i];
  if (!sv_view_project(view, x, at, &depth)) return false;
  const double far_x = (double)sv_maxf(view->cx, (float)view->width_px - view->cx),
               far_y = (double)sv_maxf(view->cy, (float)view->height_px - view->cy),
               dx = (double)(at[0] - view->cx), dy = (double)(at[1] - view->cy);
  *r2 = (dx * dx + dy * dy) / (far_x * far_x + far_y * far_y);
  return true;
}

// The falloff over the lens's own radius, whose corner is the farthest of its images.
static void set_falloff(sv_photometry *p, const sv_photometry *measured, const sv_view *view,
                        const sv_camera_model *lens) {
  double light[3], corner[2];
  corner[0] = lens->p[2] > 0.5 * lens->width_px ? 0 : lens->width_px;
  corner[1] = lens->p[3] > 0.5 * lens->height_px ? 0 : lens->height_px;
  for (int i = 0; i < 3; i++) {
    const double r = sqrt((i + 1) / 3.0);
    double uv_px[2], r2 = 1;
    for (int k = 0; k < 2; k++) uv_px[k] = lens->p[2 + k] + r * (corner[k] - lens->p[2 + k]);
    if (!view_r2(view, lens, uv_px, &r2)) r2 = 1; // outside what was trained on
    light[i] = sv_photometry_falloff(measured, r2);
  }
  sv_photometry_fit(light, p->falloff);
}

static sv_photometry photometry_of(const sv_app *app, int i_sub) {
  const sv_sub_view *v = &app->cfg.rig->sub_views[i_sub];
  const sv_photometry *measured = &app->trainer.appearance.measured[v->i_camera];
  sv_photometry p = *measured;
  sv_image_u8 image;
  sv_view view;
  sv_exposures_get(&app->exposures, 0, i_sub, &image, &view);
  p.corner = sv_photometry_none(&v->model).corner;
  set_falloff(&p, measured, &view, &v->model);
  return p;
}

void sv_app_add_photometric(sv_str *s, const sv_app *app) {
  int n = 0;
  if (!is_raw(app)) return;
  for (int i = 0; i < app->cfg.rig->n_sub_views; i++) {
    const sv_sub_view *v = &app->cfg.rig->sub_views[i];
    if (!sv_app_is_trained_on(&app->cfg, i) || !app->trainer.appearance.measured[v->i_camera].is_known)
      continue;
    const sv_photometry p = photometry_of(app, i);
    sv_str_add(s, "%s\n    {\"name\": \"", n++ ? "," : "  \"measured\": [");
    sv_str_add_json(s, v->name);
    sv_str_add(s, "\", ");
    sv_photometry_json_write(s, &p);
    sv_str_add(s, "}");
  }
  if (n) sv_str_add(s, "],\n");
}
