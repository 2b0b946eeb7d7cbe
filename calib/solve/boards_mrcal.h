// SPDX-License-Identifier: Apache-2.0
// Not alone: private to boards_*mrcal.c, after <mrcal/mrcal.h>. A calibration as mrcal takes it.
#ifndef SV_CALIB_SOLVE_BOARDS_MRCAL_H
#define SV_CALIB_SOLVE_BOARDS_MRCAL_H

#include "calib/solve/boards.h"

typedef struct {
  const sv_boards *b;
  mrcal_lensmodel_t lens;
  int n_params, n_frames, n_observations; // frames that some camera saw
  double *intrinsics;                     // [n_cameras][n_params]
  mrcal_pose_t *extrinsics;               // [n_cameras - 1] camera c is at c - 1, from the rig
  mrcal_pose_t *frames;                   // [n_frames] board to rig
  mrcal_observation_board_t *observations;
  mrcal_point3_t *pool; // [n_observations][n_rows][n_cols]; z: weight, below 0 for outliers
  int *i_frame;         // [b->n_frames] place in frames, or -1
  double *x;            // residuals of the last solve
  mrcal_calobject_warp_t warp;
  mrcal_problem_selections_t sel; // of the last solve
} sv_mrcal_problem;

// Of SPLINED: the stereographic lenses of a solved problem become splined ones without a shift; the
// control points of a solved lens, which belong to it; and the same with those that few corners
// reach as the lens goes on.
sv_status sv_mrcal_make_splined(sv_mrcal_problem *p, sv_err *err) SV_MUST_USE;
sv_status sv_mrcal_take_spline(const sv_mrcal_problem *p, int i_camera, sv_camera_model *m,
                               sv_err *err) SV_MUST_USE;
sv_status sv_mrcal_refit_spline(const sv_boards *b, const sv_boards_result *r, int i_camera,
                                sv_err *err) SV_MUST_USE;

int sv_mrcal_n_measurements(const sv_mrcal_problem *p, mrcal_problem_selections_t sel);
// Fills the deviations and the projection uncertainty of out->cameras. out holds the solution.
sv_status sv_boards_uncertainty(sv_boards_result *out, const sv_mrcal_problem *p, sv_err *err) SV_MUST_USE;

#endif
