// SPDX-License-Identifier: Apache-2.0
// How well a given rig explains chessboards that its cameras saw.
#ifndef SV_TOOLS_CALIBRATE_CHECK_H
#define SV_TOOLS_CALIBRATE_CHECK_H

#include "tools/calibrate/calibrate.h"

typedef struct {
  int n_boards;
  double rms_alone_px; // with the pose of each board free for this camera: what the lens leaves
  // with one pose of each board for all cameras: what lens and relative poses leave
  double rms_rig_px;
  double
      // RMS distance of its corners from the epipolar lines of the first camera's; NAN: none shared
      epipolar_px;
  // The light of the boards' white squares, relative to the first camera's, after what the rig's
  // photometric calibration corrects; and of how many squares.
  double light[3];
  int n_squares, n_saturated;
} cal_check_camera;

typedef struct {
  const cal_boards *boards;
  int n_cameras, n_frames; // frames with a board
  double rms_px;           // in the rig
  cal_check_camera *cameras;
  sv_pose *rig_from_board; // [boards->n_frames]
  bool *has_pose;
} cal_check;

// Poses of the boards by Gauss and Newton with lenses and relative poses as the rig has them.
// Sub-view i is camera i of the boards. E_NOT_FOUND when no camera saw a board.
sv_status cal_check_boards(cal_check *c, const sv_rig *rig, const cal_boards *b, double spacing_m,
                           sv_err *err) SV_MUST_USE;
void cal_check_free(cal_check *c);

#endif
