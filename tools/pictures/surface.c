// SPDX-License-Identifier: Apache-2.0
#include "tools/pictures/surface.h"

#include <math.h>
#include <stdlib.h>

#include "tools/lab/model_formats.h"

#define DEPTH_ALPHA_MIN 0.5f // a pixel that is mostly background has no depth

#define N_LAYERS 4 // of which lab_surface_render_faint sees each Gaussian

// 1 - (1 - opacity)^N_LAYERS
static float layered(float logit) {
  const double through = pow(1 / (1 + exp((double)logit)), N_LAYERS);
  return (float)log(fmax(1 - through, 1e-12) / fmax(through, 1e-12));
}

// at 0: of layers.
static void make_opaque(sv_gaussians *to, const sv_gaussians *from, float at) {
  for (int i = 0; i < from->n; i++) {
    sv_gaussian v;
    sv_gaussians_get(from, i, &v);
    v.opacity_logit = at > 0 ? sv_surface_logit(v.opacity_logit, at) : layered(v.opacity_logit);
    sv_gaussians_put(to, i, &v);
  }
}

sv_status lab_surface_open(lab_surface *u, const lab_options *o, lab_session *se, const char *split,
                           sv_err *err) {
  sv_status s = lab_model_read(&u->model, o->model, err);
  if (s == SV_OK) s = lab_model_read(&u->opaque, o->model, err);
  if (s == SV_OK) s = lab_settings_for(&u->settings, o, &u->model, err);
  if (s != SV_OK) return s;
  const lab_source src = {.folder = o->data,
                          .transforms = u->settings.transforms,
                          .told_by = u->settings.told_by,
                          .refined = u->settings.refined,
                          .split = split,
                          .scale = u->settings.scale};
  if ((s = lab_views_open(&u->views, &src, &se->pool, err)) != SV_OK) return s;
  lab_turn_back(&u->model, se, o->model, o->up, &u->views);
  u->depth = malloc(u->views.cap_floats * sizeof *u->depth);
  if (!u->depth) return sv_fail(err, SV_E_NOMEM, "no memory for an image");
  return lab_viewer_start(&u->viewer, se,
                          (sv_renderer_cfg){.cap_gaussians = u->model.g.n,
                                            .cap_width_px = u->views.cap_width_px,
                                            .cap_height_px = u->views.cap_height_px,
                                            .cap_pixels = u->views.cap_floats},
                          err);
}

static sv_status render(lab_surface *u, const sv_view *v, float at, sv_err *err) {
  sv_render_options o = lab_render_options(&u->settings, u->model.g.sh_degree, true);
  o.has_surface = at > 0;
  for (int c = 0; c < 3; c++) o.bg[c] = 0;
  make_opaque(&u->opaque.g, &u->model.g, at);
  sv_status s = sv_render(&u->viewer.r, &u->opaque.g, v, &o);
  return s < 0 ? sv_fail(err, s, "a view cannot be rendered: %s", sv_status_text(s)) : SV_OK;
}

sv_status lab_surface_render(lab_surface *u, const sv_view *v, float at, sv_err *err) {
  sv_status s = render(u, v, at, err);
  if (s == SV_OK) sv_render_surface_depth(&u->viewer.r, DEPTH_ALPHA_MIN, u->depth);
  return s;
}

sv_status lab_surface_render_faint(lab_surface *u, const sv_view *v, sv_err *err) {
  sv_status s = render(u, v, 0, err);
  if (s == SV_OK) sv_render_expected_depth(&u->viewer.r, DEPTH_ALPHA_MIN, u->depth);
  return s;
}

void lab_surface_close(lab_surface *u) {
  free(u->depth);
  lab_viewer_stop(&u->viewer);
  lab_views_free(&u->views);
  lab_model_free(&u->opaque);
  lab_model_free(&u->model);
}
