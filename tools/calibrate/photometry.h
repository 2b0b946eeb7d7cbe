// SPDX-License-Identifier: Apache-2.0
// Photometric calibration of a rig (src/rig/photometry.h) from white pictures, from the white
// squares of a chessboard and from scenes. The first sub-view is the reference.
#ifndef SV_TOOLS_CALIBRATE_PHOTOMETRY_H
#define SV_TOOLS_CALIBRATE_PHOTOMETRY_H

#include "tools/calibrate/calibrate.h"
#include "tools/common/imageio.h"

// Display values between which the light is well known.
#define CAL_DARK   16
#define CAL_BRIGHT 250

typedef struct {
  sv_photometry found;
  int n_pictures;
  double rms; // of what is left, as a share of the light
} cal_photometry;

double cal_linear_of(double display); // 0 to 1, sRGB
// A picture as 8-bit RGB.
sv_status cal_picture_read(const char *path, sv_bitmap *out, sv_err *err) SV_MUST_USE;
// Picture of camera c in frame f; NULL: there is none.
const char *cal_picture_of(const cal_boards *b, int c, int f);

// Pictures of an evenly lit white surface: camera c of b is camera c of the rig.
// out: [n_sub_views].
sv_status cal_white_solve(const sv_rig *rig, const cal_boards *b, cal_photometry *out,
                          sv_err *err) SV_MUST_USE;

// What a run in a folder measured on its scene; n_pictures: its exposures.
sv_status cal_scene_read(const char *run, const sv_rig *rig, cal_photometry *out, sv_err *err) SV_MUST_USE;

// The light of a white square, in one picture of a board.
typedef struct {
  int i_sub, i_frame, i_square;
  double board[2]; // place on the board, -1 to 1
  double uv_px[2]; // and in the picture
  double light[3];
} cal_square;

typedef struct {
  int n, cap;
  cal_square *all;
  int n_saturated[SV_CAP_SUB_VIEWS]; // squares that were left out for that
} cal_squares;

// White squares that are neither dark nor saturated, in order of frames, squares and sub-views.
// Sub-view i is camera i of b.
sv_status cal_squares_read(cal_squares *s, const sv_rig *rig, const cal_boards *b, sv_err *err) SV_MUST_USE;
sv_status cal_squares_solve(const cal_squares *s, const sv_rig *rig, cal_photometry *out,
                            sv_err *err) SV_MUST_USE;
// By how much a sub-view shows the squares brighter than the first one, after what the rig's
// calibration corrects: median, per channel. Returns the number of squares that both show.
int cal_squares_compare(const cal_squares *s, const sv_rig *rig, int i_sub, double ratio[3]);
void cal_squares_free(cal_squares *s);

#endif
