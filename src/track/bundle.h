// SPDX-License-Identifier: Apache-2.0
// Bundle adjustment of a rig: one pose per exposure, points and, on request, small corrections of
// the cameras' poses on the rig. Levenberg-Marquardt with Huber's loss; points are eliminated by
// the Schur complement (Triggs et al. 2000, "Bundle adjustment - a modern synthesis", section 6),
// and the rest is solved densely by Cholesky. Fixed size, no heap, sums in index order.
//
// Steps are left twists (omega, v):  R <- exp(omega) R, t <- exp(omega) t + v,  of rig_from_world
// and of cam_from_rig. Residuals are predicted - observed, in pixels of undistorted (pinhole)
// images.
#ifndef SV_TRACK_BUNDLE_H
#define SV_TRACK_BUNDLE_H

#include <stdbool.h>
#include <stdint.h>

#include "src/base/arena.h"
#include "src/base/vec.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  int16_t i_pose, i_camera;
  float uv_px[2];
  float weight; // 1 / standard deviation [px]; 0: not used
  float row_s;  // how long after the pose it was read; 0 with a global shutter
} sv_bundle_obs;

typedef struct {
  sv_pose cam_from_rig;
  double fx, fy, cx, cy; // px, centre of the first pixel at 0.5
} sv_bundle_camera;

typedef struct {
  int cap_poses, cap_cameras, cap_points, cap_obs;
  bool has_extrinsics; // room for corrections of cam_from_rig
  bool has_lenses;     // room for corrections of focal lengths and principal points
} sv_bundle_cfg;

typedef struct {
  int max_iterations;
  double huber_px;      // residuals (times weight) beyond count linearly
  bool is_extrinsics;   // also correct cam_from_rig; camera 0 is fixed (it defines the rig's frame)
  double sigma_rot_rad; // prior of the calibration: standard deviation of rotation
  double sigma_trans_m; // and of position of a camera
  bool is_lenses;       // also correct the lenses of cameras with is_lens_free
  double sigma_focal;   // prior of the lenses as given: standard deviation of a focal length, as a
                        // share of it
  double sigma_centre;  // and of a principal point, as a share of the focal length
  struct sv_heartbeats *heartbeats; // each iteration is progress; may be NULL
} sv_bundle_options;

typedef struct {
  sv_bundle_cfg cfg;
  // The problem, filled in by the caller.
  int n_poses, n_cameras, n_points;
  sv_pose *pose; // [n_poses] rig_from_world; improved
  // [n_poses] Where observations have a row time: two poses from which the motion at each comes
  // (-1: none), and how (sv_motion_slopes).
  int (*beside)[2];
  double (*slope)[2];
  bool *is_fixed;           // [n_poses]; at least one must be
  sv_bundle_camera *camera; // [n_cameras]
  sv_pose *calibrated;      // [n_cameras] cam_from_rig by calibration; only looked at with
                            // is_extrinsics
  bool *is_lens_free;       // [n_cameras] only looked at with is_lenses
  double (*point)[3];       // [n_points] world; improved
  int *first;               // [n_points + 1] observations of point i: [first[i], first[i + 1])
  sv_bundle_obs *obs;       // [first[n_points]]
  // Private to the solver.
  // [n_poses] at the present poses, for observations with a row time
  double (*motion)[6];
  sv_pose *pose_kept;                 // before a step
  sv_bundle_camera *cam_kept, *given; // [n_cameras] before a step; as sv_bundle_solve got them
  double (*point_kept)[3], (*point_step)[3];
  double *s, *g, *step; // [n n] reduced system, lower triangle; [n]
  // [cap_poses + 2 cap_cameras] of poses, cameras and lenses:
  int *block_of;   // block in s, -1: fixed
  int *is_seen;    // which poses have observations, for the scale
  int *in_use;     // those of the current point
  double (*w)[18]; // 6x3 blocks of the current point
  int n_params;
  double lambda;
} sv_bundle;

sv_status sv_bundle_init(sv_bundle *b, const sv_bundle_cfg *cfg, sv_arena *arena) SV_MUST_USE;

typedef struct {
  int n_iterations, n_obs;  // observations in use
  double cost_before, cost; // sum of Huber's losses, px^2 / 2
  double rms_px;            // of the residuals in use, one axis, not weighted
} sv_bundle_result;

// Improves poses, points and, with is_extrinsics, cameras. E_ARG: no fixed pose, or nothing to
// solve.
sv_status sv_bundle_solve(sv_bundle *b, const sv_bundle_options *o, sv_bundle_result *out) SV_MUST_USE;

// Relative standard deviation of the trajectory's size at the solution, from the inverse of the
// reduced system, scaled by the residuals. Size: root mean square distance of the rig's positions
// from their mean, over poses with observations. It measures how well the rig's baseline determines
// scale. -1 (infinite) without a baseline or with fewer than two positions.
double sv_bundle_scale_sigma(sv_bundle *b, const sv_bundle_options *o);

// --- pieces, for tests ---------------------------------------------------------------------------
// Derivatives of a residual by the twists of pose and camera, [2][6], by the lens (logarithms of fx
// and fy, cx and cy, and twice nothing, so that all blocks have six), and by the point, [2][3].
typedef struct {
  double pose[12], camera[12], lens[12], point[6];
} sv_bundle_jacobian;
// Residual of an observation of x (world), not weighted, and its derivatives (j may be NULL), with
// the motion as it is. False behind the camera.
bool sv_bundle_residual(const sv_bundle *b, const sv_bundle_obs *obs, const double x[3], double r[2],
                        sv_bundle_jacobian *j);
// One damped step at the present values into b->step (blocks of six in the order of free poses,
// then cameras, then lenses) and b->point_step: (H + lambda diag H) d = -gradient. False when the
// system is singular.
bool sv_bundle_linear_step(sv_bundle *b, const sv_bundle_options *o, double lambda);
double sv_bundle_cost(const sv_bundle *b, const sv_bundle_options *o);
// Applies a twist to a pose.
void sv_pose_twist(sv_pose *p, const double twist[6]);

#ifdef __cplusplus
}
#endif
#endif
