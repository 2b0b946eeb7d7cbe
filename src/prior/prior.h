// SPDX-License-Identifier: Apache-2.0
// Priors for sparse views: images of pseudo-views, which no camera captured, and depth maps. Both
// come from outside the trainer (a fixer such as Difix3D+, Wu et al. 2025; a monocular depth
// network; depth maps of the rig's own views). views.h says how they enter the loss.
// Owns two rings of fixed size, so that memory is known at start.
// Never calls a network or reads a file: the caller submits images and maps.
#ifndef SV_PRIOR_PRIOR_H
#define SV_PRIOR_PRIOR_H

#include <stdbool.h>

#include "src/base/rng.h"
#include "src/image/planes.h"
#include "src/loss/pearson.h"
#include "src/train/train.h"

#ifdef __cplusplus
extern "C" {
#endif

// What a depth map holds, all along the optical axis.
typedef enum {
  SV_PRIOR_RELATIVE, // depth up to scale and offset; loss: Pearson correlation with rendered depth
  SV_PRIOR_INVERSE,  // the same of inverse depth (disparity, as monocular networks give it)
  SV_PRIOR_METRIC,   // depth in world units; loss: mean absolute difference in scene radii
  SV_PRIOR_ALIGNED   // inverse depth in world units, of a relative map that was solved (align.h);
                     // loss: mean absolute difference times the distance of the scene, by trust
} sv_prior_depth_kind;

typedef enum { SV_PRIOR_NONE, SV_PRIOR_FSGS, SV_PRIOR_SPARSEGS } sv_prior_method;

typedef struct {
  int cap_pseudo; // Size of the ring of pseudo-views; 0: none are submitted.
  int cap_depths; // Size of the ring of depth maps; 0: none.
  int every;      // Steps from one that also renders a pseudo-view to the next.
  // The method's own schedule (progress 0 to 1) and weights, set by sv_prior_set_method.
  sv_prior_method method;
  float late_from, late_factor;  // from there on depth counts so many times of it
  float patch_weight;            // of the patch-wise correlation, beside 1 of the whole picture's;
                                 // 0: none
  float patch_side, patch_share; // of the picture's longer side; of its area, that patches are
                                 // drawn for
  int warp_every;                // steps from one warped pseudo-view to the next
  float warp_from, warp_until, warp_ramp;
  float warp_colour, warp_depth;   // weights of a warped pseudo-view's colours and of its depth,
                                   // after the ramp
  float unpool_from, unpool_until; // 0, 0: none
  float unpool_distance;           // times the median of the mean distance to the three neighbours
  float unpool_share;              // of the Gaussians, at most, in one go
  float prune_at[2];               // 2: never
} sv_prior_cfg;

// Weights and schedules of a method (prior.c names their source), with rings for n_views training
// views. Adds to what cfg has room for.
void sv_prior_set_method(sv_prior_cfg *cfg, sv_prior_method method, int n_views);

#define SV_PRIOR_PATCHES 16 // of a patch-wise correlation, at most
// their numbers go on from here; those of training views lie below
#define SV_PRIOR_FIRST_PSEUDO 0x40000000

typedef struct {
  sv_view view;
  uint8_t *rgba; // [height][width][4]; A: weight of the pixel, 0 to 255
  float weight;  // of its photometric loss; a training view has 1
  float until;   // progress at which it expires
  int id;        // 0: never used
} sv_prior_view;

typedef struct {
  int id;     // of a training view, or of a pseudo-view; -1: never used
  float *map; // [height][width] of that view; below 0: unknown
  int width_px, height_px;
  sv_prior_depth_kind kind;
  float weight;
  // Of ALIGNED:
  float unit;       // inverse depth of the scene, by which differences are divided
  bool is_of_depth; // the map was depth, not inverse depth: scale and shift are those of depth
  bool is_measured; // solved against depth that the rig measured: not solved again
  float trust;      // share of its weight that the map's residuals leave it, 0 to 1
} sv_prior_depth;

#define SV_PRIOR_SAMPLES 2048 // pixels of a map that its scale and shift are solved from, at most

// Of a fit (align.h).
typedef struct {
  float map[SV_PRIOR_SAMPLES], low[SV_PRIOR_SAMPLES], high[SV_PRIOR_SAMPLES], work[2 * SV_PRIOR_SAMPLES];
  float at[SV_PRIOR_SAMPLES][2];    // place in the picture, 0 to 1
  float point[SV_PRIOR_SAMPLES][3]; // in the world
  bool is_confirmed[SV_PRIOR_SAMPLES];
  int n;
} sv_prior_samples;

typedef struct {
  sv_prior_cfg cfg;
  sv_trainer *t;
  size_t cap_pixels;
  sv_prior_view *views;   // [cap_pseudo] ring
  sv_prior_depth *depths; // [cap_depths] ring
  int n_views, n_depths;  // submitted so far; maps that replaced others
  // Planes of the last image's size, [cap_pixels] each: expected depth or its inverse, its prior,
  // gradients of the sum of w z, of transmittance and of expected depth; weight of each pixel.
  float *expected, *target, *g_depth, *g_trans, *g_expected, *share;
  uint8_t *mask;
  uint8_t *warped;   // [cap_pixels][4], with a method
  sv_arena *scratch; // of unpooling and pruning
  // Set by the caller: the first Gaussians cover the surface, as they come from depth maps of the
  // views. Then there are no gaps to unpool into. Default false.
  bool is_covered;
  int n_unpooled, n_pruned, n_warped; // ever
  double last_dip;                    // of the last pruning, mean over the views
  sv_prior_samples *samples;          // with depth maps
  sv_pearson pearson;
  sv_rng rng;
  double last_depth_loss; // of the last step that had one
  float updated_until;    // progress up to which the method's own work is done
} sv_prior;

// Adapts a trainer's settings after the objective was set (src/train/objective.h): memory for
// further images, and FSGS's early SH degrees where there are any.
void sv_prior_prepare(const sv_prior_cfg *cfg, sv_train_cfg *train);
// Memory beside that of a trainer with these settings; 0 when both capacities are.
size_t sv_prior_bytes(const sv_prior_cfg *cfg, const sv_train_cfg *train);
// Attaches priors to a trainer of a still scene, which must outlive them. Takes no memory and
// attaches nothing when both capacities are 0. E_ARG and E_UNSUPPORTED name a bad setting in err.
sv_status sv_prior_init(sv_prior *p, const sv_prior_cfg *cfg, sv_trainer *t, sv_arena *arena,
                        sv_err *err) SV_MUST_USE;

// Scratch of the methods' own work (unpool.c, floaters.c).
size_t sv_prior_scratch_bytes(int n_gaussians);
size_t sv_prior_unpool_bytes(int n_gaussians);
size_t sv_prior_prune_bytes(int n_gaussians);

// Empties both rings and resets the counts.
void sv_prior_clear(sv_prior *p);

// An image (3 channels, or 4 with the pixels' weights in alpha) of a pseudo-view; copied. *id is
// its number; a full ring replaces its oldest image. E_RANGE: the size differs from the view's or
// exceeds the capacity, or the weight is below 0. E_FULL: there is no ring.
sv_status sv_prior_submit_view(sv_prior *p, const sv_view *view, const sv_image_u8 *picture, float weight,
                               float until, int *id) SV_MUST_USE;
// A depth map from outside.
typedef struct {
  const float *px; // [height_px][width_px]; below 0: unknown
  int width_px, height_px;
  sv_prior_depth_kind kind;
  float weight; // of its loss
} sv_prior_map;
// A depth map of view `id`, copied. One of the same view is replaced, else one of a pseudo-view
// that is gone, else the next in turn.
sv_status sv_prior_submit_depth(sv_prior *p, int id, const sv_prior_map *map) SV_MUST_USE;
// NULL when there is none, or its size is not the view's.
sv_prior_depth *sv_prior_find_depth(const sv_prior *p, int id, const sv_view *view);
// Pseudo-views that have not expired.
int sv_prior_n_alive(const sv_prior *p, float progress);

#ifdef __cplusplus
}
#endif
#endif
