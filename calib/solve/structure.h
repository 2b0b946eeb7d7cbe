// SPDX-License-Identifier: Apache-2.0
// Structure from motion over the views of one instant, all of one textured, still object: features
// (SIFT), matches refined by alignment (align.h), a first pair by the essential matrix, the others
// by PnP with RANSAC; OpenCV's. It makes the start of the bundle adjustment. Tools and tests only:
// heap, C++.
#ifndef SV_CALIB_SOLVE_STRUCTURE_H
#define SV_CALIB_SOLVE_STRUCTURE_H

#include <stdint.h>

#include "calib/solve/lens_array.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  int width_px, height_px;
  const uint8_t *grey; // [height][width]
  const uint8_t *mask; // [height][width] 0 where the image must not be used; NULL: all of it
  // where it lies among the views, in any unit: it is matched with its neighbors
  double place[6];
} sv_structure_view;

// How views are matched.
typedef struct {
  int n_features;   // of an image
  int n_neighbours; // views that one is matched with; tracks join further ones
  int n_seen;       // images that a point must be seen in, at least
  // Features that alignment cannot refine (views differ too much there) stay where SIFT found them
  bool keeps_unaligned;
  // Called after each image and each image's matches; false ends the search. May be NULL.
  bool (*may_run)(void *self);
  void *self;
} sv_structure_options;
// Lens images of one sensor: 800 features, 6 neighbors, 3 images, aligned.
sv_structure_options sv_structure_defaults(void);

bool sv_structure_available(void);

// Points seen in several of the n_views images, as tracks: *observations (malloc'ed, the caller's)
// by point. The number of points in *n_points, of observations returned; 0 when there are none, -1
// without memory or when may_run ended it. Visible in the module subview-matches.so.
__attribute__((visibility("default"))) int sv_structure_tracks(const sv_structure_view *views, int n_views,
                                                               const sv_structure_options *o,
                                                               sv_array_observation **observations,
                                                               int *n_points);

// Poses of all views (view 0: identity) and positions of the points from their tracks, with the
// lenses as given. Observations that RANSAC threw out are marked. False when the views could not be
// joined.
bool sv_structure_start(sv_lens_array *b);

#ifdef __cplusplus
}
#endif
#endif
