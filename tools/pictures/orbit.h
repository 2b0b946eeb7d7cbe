// SPDX-License-Identifier: Apache-2.0
// Views on a circle around a scene.
#ifndef SV_TOOLS_PICTURES_ORBIT_H
#define SV_TOOLS_PICTURES_ORBIT_H

#include "tools/lab/lab.h"

typedef struct {
  sv_view lens; // size and lens of each view; its pose is not used
  lab_scene scene;
  double height; // of the cameras above the center, along scene.up
} lab_orbit;

// At the cameras' median distance and mean height, with the first camera's lens. width_px: the
// image's, at the same aspect ratio; below 1: the camera's.
lab_orbit lab_orbit_of_views(const lab_views *v, long width_px);
// Without cameras: so far away that the model's sphere fits, from above. Models whose file does not
// name an up axis have SV_UP_DEFAULT.
lab_orbit lab_orbit_of_model(const lab_model *m, const lab_settings *st, long width_px);
// turn: 0 to 1 for one round.
sv_status lab_orbit_view(const lab_orbit *orbit, double turn, sv_view *out, sv_err *err) SV_MUST_USE;

#endif
