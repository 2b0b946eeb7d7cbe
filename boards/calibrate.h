// SPDX-License-Identifier: Apache-2.0
// C only: the feed is. Calibration of the rig from the page of `subview run --session`. The cameras
// go to `subview capture`, the chessboard is found and the rig solved by `subview-calibrate live`:
// two processes of their own, the second with a memory limit. Owns both. Never touches a rig before
// its successor is checked.
#ifndef SV_BOARDS_CALIBRATE_H
#define SV_BOARDS_CALIBRATE_H

#include "boards/board_main.h"
#include "boards/preview.h"
#include "boards/run_options.h"

// The rig of an earlier calibration of this output folder, when no other is given: FOLDER-rig.
void calibrate_use_rig(run_options *o, const char *folder);
typedef struct {
  const char *folder; // of --out
  sv_console console;
  sv_heartbeats *beats;
} calibrate_cfg;
// Calibrates as the page asked (preview_board), shows it there, and installs the rig: in the place
// of o->rig, which then lies beside the images, or as FOLDER-rig. E_INTERRUPTED: New, or a stop
// request. No camera may be open.
sv_status calibrate_rig(run_options *o, const calibrate_cfg *cfg, sv_err *err) SV_MUST_USE;

#endif
