// SPDX-License-Identifier: Apache-2.0
// Readout time and direction of a rolling shutter from a chessboard that moves before a calibrated
// camera: corners are displaced by the board's motion until their line is read. The motion comes
// from the boards before and after each, by the frames' times. Gauss-Newton over the readout in
// both directions and all poses, which are eliminated. Tools and tests only: heap, libm.
#ifndef SV_CALIB_SOLVE_SHUTTER_H
#define SV_CALIB_SOLVE_SHUTTER_H

#include "calib/model.h"
#include "src/rig/shutter.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  const sv_camera_model *lens;
  int n_cols, n_rows; // inner corners
  double spacing_m;
  int n_frames;                  // in the order of time
  const double *time_s;          // [n_frames] of the middle of each frame
  const double *uv_px;           // [n_frames][n_rows][n_cols][2]
  const sv_pose *cam_from_board; // [n_frames] as with a global shutter
} sv_shutter_boards;

typedef struct {
  sv_shutter shutter;           // readout 0: no rolling shutter was seen
  double sigma_s;               // standard deviation of the readout
  double across_s;              // readout found across the direction: about 0
  int n_used;                   // frames with neighbors
  double turn_deg_s;            // root mean square of the board's turning
  double rms_px, rms_global_px; // residuals with it, and with a global shutter
} sv_shutter_result;

// E_RANGE with a sentence: too few frames in a row, or the board hardly moved.
sv_status sv_shutter_solve(const sv_shutter_boards *b, sv_shutter_result *out, sv_err *err) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
