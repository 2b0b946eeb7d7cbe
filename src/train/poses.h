// SPDX-License-Identifier: Apache-2.0
// The rig's poses, refined along with the Gaussians: the loss of a sub-view moves its whole
// exposure, as the cameras sit on the rig where calibration says. Adam in small steps on twists
// (omega, v) of rig_from_world: R <- exp(omega) R, t <- exp(omega) t + v. The renderer gives
// dL/d(twist) of cam_from_world (kernels/project/project.h). It is for poses that are off by more
// than pictures forgive: a rotation and a shift that together leave the scene in its place are
// hardly seen, and along those even true poses wander a little.
#ifndef SV_TRAIN_POSES_H
#define SV_TRAIN_POSES_H

#include "src/rig/rig.h"
#include "src/train/hooks.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  int cap_poses;     // exposures whose pose is refined; 0: none
  float rot_rad;     // Adam's step at the start: of the rotation
  float place;       // and of the place, of the scene's radius
  float decay;       // what is left of both at the end, log-linear
  float from, until; // progress between which poses move
} sv_train_poses_cfg;

// Rates from trials on poses that were off by a quarter of a degree; cap_poses is the caller's.
sv_train_poses_cfg sv_train_poses_defaults(void);

typedef struct {
  sv_pose rig_from_world, start;
  double m[6], v[6]; // Adam's moments
  uint32_t n_steps;
  bool is_held; // one at least must be: the others may all move together without the pictures
                // noticing
} sv_train_pose;

typedef struct {
  sv_train_pose *pose;   // [cap_poses]
  int32_t *pose_of;      // [cap_views] of a view, -1: not refined
  sv_pose *cam_from_rig; // [cap_views]
  float (*sum)[6];       // [tasks of an optimiser's step] dL/d(twist) of cam_from_world of the last
                         // picture
} sv_train_poses;

// dL/d(twist) of rig_from_world from that of cam_from_world = cam_from_rig rig_from_world: the
// adjoint's transpose.
void sv_pose_twist_bwd(const sv_pose *cam_from_rig, const double dl_dcam[6], double dl_drig[6]);
// One step of Adam; rates in radians and world units.
void sv_train_pose_step(sv_train_pose *p, const double dl_drig[6], double rot_rad, double place);
void sv_view_set_pose(sv_view *v, const sv_pose *cam_from_world);

// View i_view, added before, is one of exposure i_pose, whose pose training refines. Of each
// exposure all views; of one the pose is held. Kept apart from the view's own pose: cam_from_rig
// and rig_from_world as they are now.
void sv_train_refine_view(sv_trainer *t, int i_view, int i_pose, const sv_pose *cam_from_rig,
                          const sv_pose *rig_from_world, bool is_held);
// Moves the pose of the view that was the last rendering, by the first n_sums of poses.sum.
void sv_train_move_pose(sv_trainer *t, int i_view, float progress, int n_sums);

#ifdef __cplusplus
}
#endif
#endif
