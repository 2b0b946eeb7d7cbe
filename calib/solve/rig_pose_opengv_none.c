// SPDX-License-Identifier: Apache-2.0
// For builds without OpenGV.
#include "calib/solve/rig_pose.h"

bool sv_rig_pose_has_opengv(void) { return false; }

bool sv_rig_pose_opengv(void *self, const sv_bundle_camera *cameras, const sv_pose_match *matches, int n,
                        double limit_px, sv_pose *rig_from_world) {
  (void)self;
  (void)cameras;
  (void)matches;
  (void)n;
  (void)limit_px;
  (void)rig_from_world;
  return false;
}
