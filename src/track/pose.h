// SPDX-License-Identifier: Apache-2.0
// Absolute pose of a rig (a generalised camera) from points with known positions, and the alignment
// of two trajectories.
#ifndef SV_TRACK_POSE_H
#define SV_TRACK_POSE_H

#include <stdbool.h>

#include "src/base/rng.h"
#include "src/track/bundle.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  double x[3]; // world
  int i_camera;
  float uv_px[2];
  float sigma_px; // standard deviation
  float row_s;    // sv_bundle_obs.row_s
  bool is_inlier; // output
} sv_pose_match;

// An external pose solver (host tools): fills rig_from_world from matches that may hold outliers.
// False: none found.
typedef struct {
  void *self;
  bool (*absolute)(void *self, const sv_bundle_camera *cameras, const sv_pose_match *matches, int n,
                   double limit_px, sv_pose *rig_from_world);
} sv_pose_solver;

typedef struct {
  const sv_bundle_camera *cameras;
  sv_pose_match *matches;
  int n;
  double limit_px; // residuals beyond so many pixels (times sigma) are outliers
  int n_samples;   // random samples of four
  sv_rng rng;
  double motion[6];             // of the rig; only matches with a row time look at it
  const sv_pose_solver *solver; // NULL: samples are solved here, each from the initial pose
} sv_pose_problem;

// Improves *rig_from_world from where it is (the last pose, or one predicted): Gauss-Newton on
// random samples of four matches and on all under Huber's loss, the one with most matches within
// the limit is refined on those. Returns their number; below 4 nothing was found and the pose is
// unchanged.
int sv_pose_find(sv_pose_problem *p, sv_pose *rig_from_world);

// The similarity from positions of trajectory a to those of b: x_b = s R x_a + t in the
// least squares sense (Umeyama 1991), where R is that between the rig's orientations, so that a
// straight path is enough. Poses are rig_from_world. n >= 1; s is 1 with has_scale false or when a
// does not move.
typedef struct {
  double s, r[9], t[3];
} sv_similarity;
sv_similarity sv_align_trajectories(const sv_pose *a, const sv_pose *b, int n, bool has_scale);
// rig_from_a -> rig_from_b of the same rig, with distances in b s times as large.
sv_pose sv_similarity_apply(const sv_similarity *b_from_a, const sv_pose *rig_from_a);

#ifdef __cplusplus
}
#endif
#endif
