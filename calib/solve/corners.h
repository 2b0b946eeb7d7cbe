// SPDX-License-Identifier: Apache-2.0
// Corners of a chessboard in one image: mrgingham for boards with as many columns as rows (it knows
// no others), OpenCV for the rest and for what mrgingham did not find. Tools and tests only: heap,
// C++.
#ifndef SV_CALIB_SOLVE_CORNERS_H
#define SV_CALIB_SOLVE_CORNERS_H

#include <stdbool.h>
#include <stdint.h>

#include "src/base/status.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_BOARD_CAP_SIDE 64 // inner corners along a side

typedef struct {
  int n_cols, n_rows; // inner corners along x and y of the board, 3..SV_BOARD_CAP_SIDE each
  int width_px, height_px;
  const uint8_t *grey; // [height][width]
} sv_corners_job;

// Fills uv_px[n_rows][n_cols][2], pixel centers at (i+0.5, j+0.5), and returns true when the whole
// board is seen. The order is the board's own: seen from the front, columns turn into rows
// clockwise, and where the colors allow it (n_cols + n_rows odd) the square between the first four
// corners is black, so that two cameras mean the same corner by the same index. Where they do not,
// the first corner is the one that lies towards the image's top left: cameras must then be upright
// alike.
bool sv_corners_find(const sv_corners_job *job, double *uv_px);
// E_UNSUPPORTED with a sentence when the build has no library that finds such boards.
sv_status sv_corners_available(int n_cols, int n_rows, sv_err *err) SV_MUST_USE;

// --- the libraries' parts; each returns false when nothing was found, or it was not built in -----
bool sv_corners_mrgingham(const sv_corners_job *job, double *uv_px); // n_cols = n_rows
bool sv_corners_opencv(const sv_corners_job *job, double *uv_px);
bool sv_corners_has_mrgingham(void);
bool sv_corners_has_opencv(void);

#ifdef __cplusplus
}
#endif
#endif
