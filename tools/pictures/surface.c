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

static sv_status render(lab_surface *u, const sv_gaussians *g, const sv_view *v, bool has_depth,
                        sv_err *err) {
  const sv_render_options o = lab_render_options(&u->settings, u->model.g.sh_degree, has_depth);
  const sv_status s = sv_render(&u->viewer.r, g, v, &o);
  return s < 0 ? sv_fail(err, s, "a view cannot be rendered: %s", sv_status_text(s)) : SV_OK;
}

sv_status lab_surface_render(lab_surface *u, const sv_view *v, sv_err *err) {
  return render(u, &u->model.g, v, false, err);
}

void lab_surface_depth(lab_surface *u, const sv_view *v, sv_depth_slab slab) {
  sv_render_surface(&u->viewer.r, &u->model.g, v, slab, u->depth);
}

sv_status lab_surface_render_faint(lab_surface *u, const sv_view *v, sv_err *err) {
  for (int i = 0; i < u->model.g.n; i++) {
    sv_gaussian g;
    sv_gaussians_get(&u->model.g, i, &g);
    g.opacity_logit = layered(g.opacity_logit);
    sv_gaussians_put(&u->opaque.g, i, &g);
  }
  const sv_status s = render(u, &u->opaque.g, v, true, err);
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
