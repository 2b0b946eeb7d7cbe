// SPDX-License-Identifier: Apache-2.0
// Absolute pose of a rig by OpenGV: the generalised three-point solver (gp3p, Kneip et al. 2013) in
// a RANSAC, then its non-linear optimization over the inliers. It needs no start, so it finds a rig
// again after any motion; heap and C++ are allowed, so it is for host tools. Built where OpenGV is
// installed.
#ifndef SV_CALIB_SOLVE_RIG_POSE_H
#define SV_CALIB_SOLVE_RIG_POSE_H

#include "src/track/pose.h"

#ifdef __cplusplus
extern "C" {
#endif

bool sv_rig_pose_has_opengv(void);

// The shape of sv_pose_solver.absolute (self is not used): matches may hold outliers, those within
// limit_px (at each camera's own focal length) count. False: fewer than six agree, or there is no
// OpenGV.
bool sv_rig_pose_opengv(void *self, const sv_bundle_camera *cameras, const sv_pose_match *matches, int n,
                        double limit_px, sv_pose *rig_from_world);

#ifdef __cplusplus
}
#endif
#endif
