// SPDX-License-Identifier: Apache-2.0
// Which view stands for a lens in training: a pinhole, or a fisheye that shows all of its field.
// Trainer and renderer know these two only; pictures of other lenses are remapped to them once,
// while they are loaded (calib/remap.h). Owns nothing.
#ifndef SV_CALIB_LENS_VIEW_H
#define SV_CALIB_LENS_VIEW_H

#include "calib/fisheye.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  sv_camera_model model; // PINHOLE or KB4, of the size of the lens's picture
  bool is_fisheye;       // KB4
  bool is_remapped;      // pictures have to be remapped from the lens to the view
  sv_fisheye fisheye;    // with is_fisheye
} sv_lens_view;

// Straight lenses, and fisheyes that polynomials describe (sv_fisheye_make), stay as they are.
// Lenses that see more than 90 degrees across, other fisheyes, and those that leave no pinhole
// without black pixels become fisheyes, whose radial function is the best one for the lens: what
// differs from it is in the remap table. No pixel that sees less than 120 degrees off the axis is
// lost. All others become the widest pinhole without black pixels. False: there is no such view.
bool sv_lens_view_make(sv_lens_view *out, const sv_camera_model *lens);

// Is a place of the view's picture inside the lens's range? True everywhere in a pinhole.
bool sv_lens_view_is_lit(const sv_lens_view *v, double u_px, double v_px);
// Is some place of it outside, as around an image circle, or may be, as it is remapped?
bool sv_lens_view_has_dark(const sv_lens_view *v);

#ifdef __cplusplus
}
#endif
#endif
