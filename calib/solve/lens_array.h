// SPDX-License-Identifier: Apache-2.0
// Bundle adjustment of fixed views and free points with unknown pinhole lenses: what calibrates
// lens images of one sensor from images of an unknown textured object. Levenberg and Marquardt,
// points eliminated by the Schur complement (Triggs et al., "Bundle Adjustment - A Modern
// Synthesis", 2000), Huber weights. Tools and tests only. Frames: view 0's pose is held as given;
// the size of everything is not determined and stays near where it began.
#ifndef SV_CALIB_SOLVE_LENS_ARRAY_H
#define SV_CALIB_SOLVE_LENS_ARRAY_H

#include "calib/model.h"
#include "src/base/vec.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  int view, point;
  double uv_px[2];
  bool is_outlier;
  bool is_coarse; // where SIFT found it: good to half a pixel, not to a tenth
} sv_array_observation;

typedef struct {
  int n_views, n_points, n_observations;
  sv_camera_model *models;            // [n_views] PINHOLE, in and out
  sv_pose *cam_from_rig;              // [n_views] in and out
  double (*points)[3];                // [n_points] rig frame, in and out
  sv_array_observation *observations; // by point: all of one point stand together
  bool is_lens_fixed;                 // hold all of them
  bool is_focal_known;                // hold the mean focal length of the lenses as given
  // spread of the lenses' focal lengths about their common one, as a share of it
  double focal_sd;
  double centre_sd_px;    // of principal points about centre_px
  double (*centre_px)[2]; // [n_views] where they are expected; NULL when lenses are fixed
} sv_lens_array;

typedef struct {
  // over what is no outlier: of |residual|; robust deviation of one coordinate
  double rms_px, sigma_px;
  int n_iterations, n_outliers;
  double rotation_sd_deg;           // mean over views but the first, from the normal equations
  double focal_sd_px, centre_sd_px; // the same
} sv_array_stats;

// Marks observations beyond 4 deviations as outliers between rounds. E_FORMAT when it does not
// converge to anything (points behind the cameras), E_NOMEM.
sv_status sv_array_solve(sv_lens_array *b, int n_rounds, sv_array_stats *stats, sv_err *err) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
