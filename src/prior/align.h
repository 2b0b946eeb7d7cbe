// SPDX-License-Identifier: Apache-2.0
// Scale and shift of relative depth maps, for each view on its own: a monocular network tells
// inverse depth up to an affine map. Solved against what is known best there: depth maps of the
// rig's own views, else the current model where other views confirm it, else the ball around the
// scene. A solved map becomes SV_PRIOR_ALIGNED: inverse depth in world units, with a loss of its
// own (views.h). A map that nothing aligns keeps Pearson's correlation.
// Owns nothing. Never changes a map that is in world units already.
#ifndef SV_PRIOR_ALIGN_H
#define SV_PRIOR_ALIGN_H

#include "src/prior/prior.h"
#include "src/rig/bounds.h"

#ifdef __cplusplus
extern "C" {
#endif

// What a fit is made of, ascending or not, all of n values.
typedef struct {
  const float *map;        // relative values
  const float *low, *high; // what scale x map + shift lies between
  int n;
} sv_prior_fit;

// The steepest scale x map + shift, scale > 0, that lies between low and high everywhere but at
// one of 500 values: relief is as deep as the limits let it. false: there is none. work: 2 n
// floats.
bool sv_prior_fit_between(const sv_prior_fit *f, float *work, float *scale, float *shift);
// Robust line through (map, low), scale > 0: least squares, weighted anew by the distances from it
// (Cauchy's weights, median absolute deviation). false: no line rises. work: n floats.
bool sv_prior_fit_line(const sv_prior_fit *f, float *work, float *scale, float *shift);

// Solves the maps of training views that have no scale yet against the ball around the scene: the
// surface is as deep as it fits into the ball. Where the known pixels do not reach the picture's
// border, the ball is the one about bounds->centre that all their rays meet; else it is bounds.
// Left alone: views that look from inside of the ball. Returns how many maps were solved.
int sv_prior_align_to_ball(sv_prior *p, const sv_bounds *bounds);

// Solves a relative map of a training view against measured depth of its pixels ([height][width]
// along the axis, below 0: unknown), by a robust line and a smooth correction (solve.h). Pixels
// that were measured are forgotten: what the rig sees by itself needs no prior. false: too little
// in common, the map is left alone.
bool sv_prior_align_to_depth(sv_prior *p, sv_prior_depth *d, const float *depth);

// Solves aligned maps of training views again, but those of the call above: against the model as it
// is, where one of the two nearest other views sees the same surface. A map that falls where the
// model rises is not trusted until it is solved. *n_solved is how many were.
sv_status sv_prior_realign(sv_prior *p, float progress, int *n_solved) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
