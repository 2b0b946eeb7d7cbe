// SPDX-License-Identifier: Apache-2.0
// Starting points drawn from the training pictures, for scenes whose extent is not known: a random
// pixel of a random view, put at a random depth along its ray, in the pixel's colour.
#ifndef SV_TRAIN_SEED_H
#define SV_TRAIN_SEED_H

#include "src/rig/bounds.h"
#include "src/train/train.h"

#ifdef __cplusplus
extern "C" {
#endif

// Fills point[n] from the trainer's views, lenses of shared sensors among them (a lens's pixels
// have the colour of all that fell there). Half of the depths are uniform inside the ball `bounds`,
// as far as
// the ray meets it; the rest are log-uniform from the ball's near side to eight radii behind its
// centre.
void sv_seed_points(const sv_trainer *t, const sv_bounds *bounds, uint64_t seed, sv_point *point, int n);

#ifdef __cplusplus
}
#endif
#endif
