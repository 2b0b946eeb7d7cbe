// SPDX-License-Identifier: Apache-2.0
// Rigid bodies among what was displaced from one time to another: y = R(q) (x - c) + c + d.
//
// A displacement is known in the pictures, not in space: along the rays of its cameras it is poor
// (two cameras close together), along those of a single camera unknown. So what is fitted is the
// squared distance in pixels, (y - x - u)^T a (y - x - u), by Gauss-Newton over q and d, with Geman
// & McClure's weights against those that followed something else. Bodies are found by sequential
// RANSAC (Fischler & Bolles 1981) with the winners refined (Chum, Matas & Kittler 2003): three
// neighbours propose a motion, those around them and then all that go along with it refine it, and
// what hangs together with the largest body's seed becomes the next body.
#ifndef SV_DYNAMIC_RIGID_H
#define SV_DYNAMIC_RIGID_H

#include "src/deform/bodies.h"
#include "src/dynamic/local_motion.h"

#ifdef __cplusplus
extern "C" {
#endif

// Gaussians whose displacements are fitted, and the center of rotation.
typedef struct {
  const sv_displaced *of; // by Gaussian
  const uint32_t *index;  // [n]
  int n;
  const float *c; // [3]
} sv_rigid_points;

// The rigid motion about c of those points whose displacement is known. start: the expected motion,
// a weak prior (0.15 rad and half the body's radius weigh as one measurement off by the tolerance).
// NULL: start from the mean displacement; undetermined rotations (points on a line, or few) are
// then minimal. tolerance_px: a residual of this size has a weight of a quarter. n_inliers (may be
// NULL): points with a smaller residual. False, and *out unchanged: fewer than three points are
// known, or no motion is found.
bool sv_rigid_fit(const sv_rigid_points *p, float tolerance_px, const sv_rigid *start, sv_rigid *out,
                  int *n_inliers);

typedef struct {
  const sv_displaced *of; // by slot
  const uint32_t *order;  // [n] slots, neighbours mostly side by side (sv_local_motion_find)
  uint8_t *label;         // by slot; 0: of no body yet. In and out
  uint32_t *list;         // [2 n] scratch
  int n;
  int first_label, cap_bodies; // bodies get first_label, first_label + 1, ...; fewer than
                               // SV_CAP_BODIES
  int min_members;
  float min_px;       // a body's members move by more, in the median
  float tolerance_px; // its members are off by less
  uint64_t seed;
} sv_rigid_search;

// Finds bodies among slots of no body, largest first; motion [cap_bodies] and centre
// [cap_bodies][3] (the members' mean place) are theirs. Slots that are not known, or have followed
// something else, join the body they are amid. Returns how many there are. The same for the same
// input on every machine.
int sv_rigid_find(const sv_rigid_search *s, sv_rigid *motion, float centre[][3]);

#ifdef __cplusplus
}
#endif
#endif
