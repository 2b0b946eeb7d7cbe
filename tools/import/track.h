// SPDX-License-Identifier: Apache-2.0
// Odometry of captures without poses: the rig's pose at each exposure, tracked over the pictures on
// disk as 'subview run' does. Owns its memory during the call. Never writes files.
#ifndef SV_TOOLS_IMPORT_TRACK_H
#define SV_TOOLS_IMPORT_TRACK_H

#include "platform/replay/capture.h"
#include "src/rig/rig.h"
#include "tools/lab/lab.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  const char *dir; // of the capture
  const sv_capture *capture;
  const sv_rig *rig; // its models have the size of the pictures
  int n_exposures;
  const int *frame; // [n_exposures][n_cameras] index of the camera's frame; -1: missing
} lab_track_job;

typedef struct {
  bool is_moving;     // false: the rig stood still, or nothing tells; all poses are the identity
  double scale_sigma; // of the path, relative; 0: stood still, -1: unknown
} lab_tracked;

// Fills pose and is_placed [n_exposures]. An exposure that lacks a camera's frame, or that the
// tracker cannot locate, is not placed when the rig moved. The console says what was found.
sv_status lab_track(const lab_track_job *job, lab_session *se, sv_pose *rig_from_world, bool *is_placed,
                    lab_tracked *out, sv_err *err) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
