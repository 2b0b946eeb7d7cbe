// SPDX-License-Identifier: Apache-2.0
// For builds without OpenCV.
#include "calib/solve/boards.h"

bool sv_boards_seed_camera(const sv_boards *b, int i_camera, double lens[5], sv_pose *cam_from_board) {
  (void)b;
  (void)i_camera;
  (void)lens;
  (void)cam_from_board;
  return false;
}
