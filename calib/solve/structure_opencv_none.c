// SPDX-License-Identifier: Apache-2.0
// For builds without OpenCV.
#include "calib/solve/structure.h"

#include <stddef.h>

bool sv_structure_available(void) { return false; }

sv_structure_options sv_structure_defaults(void) { return (sv_structure_options){0}; }

int sv_structure_tracks(const sv_structure_view *views, int n_views, const sv_structure_options *o,
                        sv_array_observation **observations, int *n_points) {
  (void)o;
  (void)views;
  (void)n_views;
  *observations = NULL;
  *n_points = 0;
  return 0;
}

bool sv_structure_start(sv_lens_array *b) {
  (void)b;
  return false;
}
