// SPDX-License-Identifier: Apache-2.0
// Starting points from what the views themselves tell of the surface (sweep.h), for rigs whose
// sub-views overlap and for neighbouring pictures of one camera.
#ifndef SV_TRAIN_STEREO_H
#define SV_TRAIN_STEREO_H

#include "src/train/sweep.h"

#ifdef __cplusplus
extern "C" {
#endif

// Points of the surface, the caller's memory.
typedef struct {
  sv_point *point; // [cap]
  int cap;
  // [view][height][width] what another model takes for the depth there, 0: nothing; points that
  // differ by more than a tenth are left out. NULL: all are taken
  float *const *depth;
  int n;      // out: points
  int n_maps; // out: depth maps that they are from
} sv_stereo_cloud;

// Points in the images' colors from depth maps of the trainer's views: all of them or, when there
// are more than cap, evenly over all maps. `bounds` is where the scene is about (its near side and
// far behind it are searched). AGAIN: too few for a start (a sixteenth of cap), as the views do not
// overlap or are without structure; transparent pixels give none. Scratch: sv_sweep_bytes.
sv_status sv_stereo_points(const sv_trainer *t, const sv_bounds *bounds, sv_arena *scratch,
                           sv_stereo_cloud *out) SV_MUST_USE;
// The point of a map's pixel, *z its depth; false: not measured, or transparent.
bool sv_stereo_point(const sv_trainer *t, const sv_depth_map *m, int x, int y, sv_point *out, float *z);
// How Gaussians start at such points. Points lie about as far apart as they should be large.
sv_init_cfg sv_stereo_init(const sv_bounds *bounds, uint64_t seed);

#ifdef __cplusplus
}
#endif
#endif
