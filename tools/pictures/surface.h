// SPDX-License-Identifier: Apache-2.0
// Depth of a model's surface in the views of a dataset (src/splat/surface.h).
#ifndef SV_TOOLS_PICTURES_SURFACE_H
#define SV_TOOLS_PICTURES_SURFACE_H

#include "tools/train/evaluate.h"

typedef struct {
  lab_model model, opaque; // as trained; with the opacities of lab_surface_render_faint
  lab_views views;
  lab_settings settings;
  lab_viewer viewer;
  float *depth; // [height][viewer.r.rgb.stride] of the last view, 0: no surface
} lab_surface;

// The model and the views of a split that the options name.
sv_status lab_surface_open(lab_surface *u, const lab_options *o, lab_session *se, const char *split,
                           sv_err *err) SV_MUST_USE;
// Renders a view in color.
sv_status lab_surface_render(lab_surface *u, const sv_view *v, sv_err *err) SV_MUST_USE;
// The depth of the surface in the view that was rendered last.
void lab_surface_depth(lab_surface *u, const sv_view *v, sv_depth_slab slab);
// Renders the expected depth of centers, faint Gaussians included: for what is removed when it lies
// elsewhere.
sv_status lab_surface_render_faint(lab_surface *u, const sv_view *v, sv_err *err) SV_MUST_USE;
void lab_surface_close(lab_surface *u); // safe after a failed open, and when it is all zero

#endif
