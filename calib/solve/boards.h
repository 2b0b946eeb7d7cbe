// SPDX-License-Identifier: Apache-2.0
// Calibration of a rig from images of a flat chessboard: seeds by OpenCV, one joint solve of all
// lenses, relative poses, board poses and the board's warp by mrcal (libmrcal: D. Kogan, "mrcal",
// JPL), outliers rejected, covariance from the solver's Jacobian. Tools and tests only: heap, C++.
// Frames: the rig's is camera 0's. The board's has its origin in corner 0, x along columns, y along
// rows.
#ifndef SV_CALIB_SOLVE_BOARDS_H
#define SV_CALIB_SOLVE_BOARDS_H

#include <stdbool.h>
#include <stdint.h>

#include "calib/model.h"
#include "src/base/vec.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_BOARDS_CAP_CAMERAS 256
#define SV_BOARDS_GRID_X      12 // projection uncertainty is told on a grid over the image
#define SV_BOARDS_GRID_Y      9

typedef struct {
  // a frame is one instant: all cameras that see the board see it in one pose
  int n_cameras, n_frames;
  int n_cols, n_rows;       // inner corners
  double spacing_m;         // between neighboring corners
  sv_model_kind model;      // PINHOLE, OPENCV4, OPENCV5, OPENCV8, or of wide lenses SPLINED
  bool has_warp;            // estimate the board's warp (two parabolas, mrcal's calobject_warp)
  const char *const *names; // [n_cameras] for sentences
  const int (*size_px)[2];  // [n_cameras] width, height
  const double *uv_px;      // [n_cameras][n_frames][n_rows][n_cols][2], pixel centers at +0.5
  const uint8_t *is_seen;   // [n_cameras][n_frames]
} sv_boards;

typedef struct {
  // over this camera's corners that are no outliers: sqrt(mean |residual|^2)
  double rms_px;
  // standard deviation of the focal length, from noise as large as the residuals; 0 for SPLINED, of
  // which it is a scale of the spline alone
  double fx_sd_px;
  double rotation_sd_deg;    // of cam_from_rig; 0 for camera 0
  double translation_sd_m;   // the same
  double tilt_deg;           // largest angle between two of the board's normals that it saw
  double coverage;           // share of the image's 5 x 5 cells that hold a corner
  double centre_u, centre_v; // mean corner, as a share of the image's width and height
  double spread_u, spread_v; // largest minus smallest, as a share
  int n_boards, n_outliers;
  // worst direction, at infinity, 1 sigma
  double uncertainty_px[SV_BOARDS_GRID_Y][SV_BOARDS_GRID_X];
} sv_boards_camera;

// Arrays are the result's own, sv_boards_free gives them back.
typedef struct {
  int n_cameras, n_frames, n_corners; // of the problem
  sv_camera_model *models;            // [n_cameras]; with control points of its own
  sv_pose *cam_from_rig;              // [n_cameras], the first is the identity
  sv_pose *rig_from_board;            // [n_frames]; frames that no camera saw: identity
  double warp_m[2];                   // warp along x and y
  double rms_px;
  int n_points, n_outliers;
  // [n_cameras][n_frames][n_corners][2] predicted - measured; 0 where not seen
  double *residual_px;
  uint8_t *is_outlier;       // [n_cameras][n_frames][n_corners]
  double *board_rms_px;      // [n_cameras][n_frames]; 0 where not seen
  sv_boards_camera *cameras; // [n_cameras]
} sv_boards_result;

// E_UNSUPPORTED with a sentence when the build lacks mrcal or OpenCV.
sv_status sv_boards_available(sv_err *err) SV_MUST_USE;

// Refuses with a sentence that says what to do: fewer than three boards for a camera, a camera that
// shares no frame with the others, boards that are all parallel to the image (focal length and
// distance then cannot be told apart), a solve that does not fit. Nothing to free after a failure.
sv_status sv_boards_solve(const sv_boards *b, sv_boards_result *out, sv_err *err) SV_MUST_USE;
void sv_boards_free(sv_boards_result *r);

// The place of corner (i, j) on the bent board, in the board's frame.
void sv_boards_corner(double out[3], const sv_boards *b, const double warp_m[2], int i, int j);

// --- pieces --------------------------------------------------------------------------------------
// First guess for one camera by itself: lens[5] = fx fy cx cy k1 (pixel centers at integers), of
// SPLINED the first four of a stereographic lens, and cam_from_board[n_frames] where seen. False
// when OpenCV found none.
bool sv_boards_seed_camera(const sv_boards *b, int i_camera, double lens[5], sv_pose *cam_from_board);
// What a camera saw of the boards: tilt, coverage, center, spread, n_boards.
void sv_boards_measure(const sv_boards *b, int i_camera, const sv_pose *cam_from_board,
                       sv_boards_camera *out);
// Relative poses from boards seen together, along the tree of most shared frames; then one pose per
// frame. E_FORMAT when a camera is not connected.
sv_status sv_boards_chain(const sv_boards *b, const sv_pose *cam_from_board, sv_pose *cam_from_rig,
                          sv_pose *rig_from_board, sv_err *err) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
