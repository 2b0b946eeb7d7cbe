// SPDX-License-Identifier: Apache-2.0
// What FSGS (Zhu et al. 2024) and SparseGS (Xiong et al. 2023) do of their own beside the losses:
// unpooling, pruning of floaters, pseudo-views warped from the pictures that were taken, depth maps
// where views overlap. The number of Gaussians stays what it is: unpooled ones take the place of
// dead or weak ones, pruned ones become dead Gaussians, which relocation uses.
#ifndef SV_PRIOR_METHODS_H
#define SV_PRIOR_METHODS_H

#include "src/prior/prior.h"
#include "src/rig/bounds.h"

#ifdef __cplusplus
extern "C" {
#endif

const char *sv_prior_method_name(sv_prior_method m); // "none", "fsgs", "sparsegs"
int sv_prior_method_by_name(const char *name);       // -1 when unknown
// Depth maps from the training views themselves, where they overlap (sweep.h): relative maps from
// outside are solved against them (align.h). They have no loss of their own: what they tell is in
// the model from the start, and a further loss costs more than it gives
// (docs/notes/few-exposures.md).
// *n_maps is their number, 0 when the views share too little. Scratch: sv_sweep_bytes.
sv_status sv_prior_measure(sv_prior *prior, const sv_bounds *bounds, sv_arena *scratch,
                           int *n_maps) SV_MUST_USE;

// A training view's picture, carried by its depth to a view beside it: a new pseudo-view with
// colours and depth where the picture reaches. Depth is the view's map, brought to the rendering's
// scale by least squares, else the rendering's own (for colours alone: without a map and without
// warp_colour nothing is done).
sv_status sv_prior_warp(sv_prior *prior, float progress) SV_MUST_USE;

// Proximity-guided unpooling: where the mean distance to the three nearest neighbours is more than
// cfg.unpool_distance times its median, new Gaussians come to the middles of the edges to them,
// with the neighbour's scale, opacity and colour from all sides, not rotated. They take the place
// of dead ones, then of those of opacity below 0.02. Returns how many.
uint32_t sv_prior_unpool(sv_prior *prior);

// Floaters: per training view the relative difference of expected depth and of the depth of the
// largest weight; the more modes its distribution has (mean dip over the views), the more of its
// upper end are pixels of floaters, where what lies at or before the largest weight, and covers the
// pixel, dies. Returns how many did.
sv_status sv_prior_prune(sv_prior *prior, uint32_t *n_pruned) SV_MUST_USE;

// After a step: the method's own work that is due at this progress.
sv_status sv_prior_update(sv_prior *prior, float progress) SV_MUST_USE;

// --- pieces --------------------------------------------------------------------------------------
// Hartigan & Hartigan's dip statistic (1985) of n ascending values: the least largest distance of
// their distribution function from a unimodal one; 1/(2n) to 1/4. hull[2 n]: scratch.
double sv_prior_dip(const float *ascending, int n, int32_t *hull);
// Ascending order, in place (heap sort).
void sv_prior_sort(float *v, int n);

#ifdef __cplusplus
}
#endif
#endif
