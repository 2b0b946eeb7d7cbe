// SPDX-License-Identifier: Apache-2.0
// Rigid bodies from displacements between two times: y = R(q) (x - c) + c + d.
//
// A displacement is measured in images: it is uncertain along the rays of nearby cameras, and
// undetermined along the ray of a single one. The residual is therefore a squared distance in
// pixels, (y - x - u)^T a (y - x - u), minimized by Gauss-Newton over q and d with Geman &
// McClure's weights against wrong matches. Bodies are found by sequential RANSAC (Fischler & Bolles
// 1981) with local optimization (Chum, Matas & Kittler 2003): three neighbors propose a motion,
// their neighborhood and then all inliers refine it, and the largest connected set becomes a body.
//
// Owns nothing. Never changes a Gaussian.
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
  const sv_displaced *of; // by Gaussian
  const uint32_t *order;  // [n] Gaussians along a Morton curve (sv_local_motion_find)
  uint8_t *label;         // by Gaussian, in and out; 0: in no body
  uint32_t *list;         // [2 n] scratch
  int n;
  int first_label, cap_bodies; // bodies get first_label, first_label + 1, ...; fewer than
                               // SV_CAP_BODIES
  int min_members;
  float min_px;       // smallest median displacement of a body
  float tolerance_px; // largest residual of a member
  uint64_t seed;
} sv_rigid_search;

// Finds bodies among Gaussians without a body, largest first; motion [cap_bodies] and centre
// [cap_bodies][3] (the members' mean position) are theirs. Gaussians with an unknown displacement
// or a wrong match join the body that surrounds them. Returns the number of bodies. Deterministic.
int sv_rigid_find(const sv_rigid_search *s, sv_rigid *motion, float centre[][3]);

#ifdef __cplusplus
}
#endif
#endif
