// SPDX-License-Identifier: Apache-2.0
// One map against known depth of some of its pixels: scale and shift by a robust line, then a
// smooth correction, then how far the map is trusted. A network's errors are smooth: where depth is
// known, its map keeps the shape between the known places and gives up the place.
// Owns nothing. Never decides which depth is known (align.h does).
#ifndef SV_PRIOR_SOLVE_H
#define SV_PRIOR_SOLVE_H

#include "src/prior/prior.h"

#ifdef __cplusplus
extern "C" {
#endif

// Pixels between samples, in both directions, so that those that the map knows fit.
int sv_prior_stride(const sv_prior_depth *d);
// What the line is made of: the map's value, or of an aligned map what it is linear in (depth or
// inverse depth).
float sv_prior_line_value(const sv_prior_depth *d, float map);
// Adds a pixel whose depth z is known; returns its place, -1 when there is no room.
int sv_prior_add_sample(sv_prior_samples *s, const sv_prior_depth *d, int x, int y, float z);

// Solves a map from the samples: it becomes SV_PRIOR_ALIGNED, with its trust; d->unit was set
// before. least: smallest inverse depth. false: too few samples or no rising line; the map stays.
bool sv_prior_solve(sv_prior_samples *s, sv_prior_depth *d, float least);
// The map becomes inverse depth in world units by a line of its values.
void sv_prior_apply_line(sv_prior_depth *d, float scale, float shift, float least);

#ifdef __cplusplus
}
#endif
#endif
