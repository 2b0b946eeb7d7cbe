// SPDX-License-Identifier: Apache-2.0
// How the rig moved while the cameras of a rolling shutter read their lines: what the exposures of
// a pool tell of it.
// Owns nothing. Never finds motion: the source (src/sync/capture_queue.c) or odometry does.
#ifndef SV_CAPTURE_MOTION_H
#define SV_CAPTURE_MOTION_H

#include "src/capture/exposures.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  int n;                   // exposures whose motion is known
  double turn_rad_s, move; // root mean square over them; world units a second
} sv_motion_summary;

sv_motion_summary sv_exposures_motion(const sv_exposures *e);
// When the images of a sub-view are read, and how its camera moved in exposure i (cam_from_world).
// False without a rolling shutter or motion.
bool sv_exposures_rolling(const sv_exposures *e, int i, int i_sub, sv_row_time *time, double motion[6]);

#ifdef __cplusplus
}
#endif
#endif
