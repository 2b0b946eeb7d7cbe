// SPDX-License-Identifier: Apache-2.0
// What somebody else knows of a scene that few views saw: pictures of views that no camera took, and depth maps. Both
// come from outside the core (a fixer such as Difix3D+ of Wu et al. 2025, a monocular depth network, the rig's own
// depth maps) and are kept in two rings of fixed size, so that a trainer's memory is known at start. What is done with
// them is in views.h.
#ifndef SV_PRIOR_PRIOR_H
#define SV_PRIOR_PRIOR_H

#include <stdbool.h>

#include "src/base/rng.h"
#include "src/image/planes.h"
#include "src/loss/pearson.h"
#include "src/rig/rig.h"

#ifdef __cplusplus
extern "C" {
#endif

// What the values of a depth map are, of depth along the optical axis.
typedef enum {
  SV_PRIOR_RELATIVE, // some scale and offset of depth: Pearson's correlation with the rendered depth
  SV_PRIOR_INVERSE,  // of inverse depth (disparity, as monocular networks tell): the same with inverse depth
  SV_PRIOR_METRIC    // depth itself, in world units: mean absolute difference in scene radii
} sv_prior_depth_kind;

typedef struct {
  int cap_pseudo; // pseudo-views kept at a time; 0: none are ever submitted
  int cap_depths; // depth maps kept at a time; 0: none
  int every;      // steps from one that also takes a pseudo-view to the next
} sv_prior_cfg;

#define SV_PRIOR_FIRST_PSEUDO 0x40000000 // their numbers go on from here; those of training views lie below

typedef struct {
  sv_view view;
  uint8_t *rgba; // [height][width][4] of the view; A: what share of a pixel counts
  float weight;  // of its photometric loss, beside 1 of a training view
  float until;   // progress at which it expires
  int id;        // 0: never used
} sv_prior_view;

typedef struct {
  int id;     // of a training view, or of a pseudo-view; -1: never used
  float *map; // [height][width] of that view, below 0: nothing is known
  int width_px, height_px;
  sv_prior_depth_kind kind;
  float weight;
} sv_prior_depth;

typedef struct {
  sv_prior_cfg cfg;
  size_t cap_pixels;
  sv_prior_view *views;   // [cap_pseudo] ring
  sv_prior_depth *depths; // [cap_depths] ring
  int n_views, n_depths;  // ever submitted
  // Planes of the last picture's size, [cap_pixels] each: expected depth or its inverse, its prior, gradients of the sum
  // of w z, of what light is left, of the expected depth; share of each pixel that counts.
  float *expected, *prior, *g_depth, *g_trans, *g_expected, *share;
  uint8_t *mask;
  sv_pearson pearson;
  sv_rng rng;
  double last_depth_loss; // of the last step that had one
} sv_prior;

// Assigns all pointers; cap_pixels: padded floats of the largest view (sv_plane_floats). Takes nothing when both
// capacities are 0.
sv_status sv_prior_init(sv_prior *p, const sv_prior_cfg *cfg, size_t cap_pixels, uint64_t seed,
                        sv_arena *arena) SV_MUST_USE;

// A picture (3 channels, or 4 with what counts in alpha) of a view that no camera took; copied. Returns its number;
// the oldest one's place is taken when the ring is full. E_RANGE for a size that is not the view's or beyond the
// capacity, a weight below 0; E_FULL without a ring.
sv_status sv_prior_submit_view(sv_prior *p, const sv_view *view, const sv_image_u8 *picture, float weight,
                               float until, int *id) SV_MUST_USE;
// A depth map of view `id`, of width x height floats without padding, copied; below 0: nothing is known. A map of the
// same view is replaced, else the oldest.
sv_status sv_prior_submit_depth(sv_prior *p, int id, const float *map, int width_px, int height_px,
                                sv_prior_depth_kind kind, float weight) SV_MUST_USE;
// NULL when there is none, or its size is not the view's.
const sv_prior_depth *sv_prior_find_depth(const sv_prior *p, int id, const sv_view *view);
// Pseudo-views that have not expired.
int sv_prior_n_alive(const sv_prior *p, float progress);

#ifdef __cplusplus
}
#endif
#endif
