// SPDX-License-Identifier: Apache-2.0
// Camera models on board: project, unproject and Jacobians without heap. models.inc lists them.
// Pixel centers are at (i+0.5, j+0.5); mrcal and OpenCV put them at integers, so cx, cy are shifted
// by 0.5 where files are read (rig_file.c).
#ifndef SV_CALIB_MODEL_H
#define SV_CALIB_MODEL_H

#include <stdbool.h>

#include "src/base/status.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_CAP_MODEL_PARAMS 16

typedef enum {
#define X(id, name, fn, n_params) SV_MODEL_##id,
#include "calib/models.inc"
#undef X
  SV_N_MODELS
} sv_model_kind;

// Of mrcal's splined stereographic model: B-splines of the given order over a grid of control
// points.
typedef struct {
  int order, nx, ny;     // order 2 or 3; at least order + 1 points a side
  double fov_x_deg;      // what the grid spans, left to right
  const double *control; // [ny][nx][2] shift in the stereographic plane; belongs to whoever made it
} sv_lens_spline;
#define SV_CAP_SPLINE_SIDE 256

typedef struct {
  sv_model_kind kind;
  int width_px, height_px;
  double p[SV_CAP_MODEL_PARAMS]; // fx, fy, cx, cy [px], then the model's distortion terms
  sv_lens_spline spline;         // SPLINED only
} sv_camera_model;

// uv [px] of a point in the camera's frame. Jacobians may be NULL: duv_dx [2][3], duv_dp
// [2][n_params], row-major. False when the point does not project: behind the camera (KB4 and
// SPLINED see there, too, as far as their lens reaches), or outside the range in which the
// distortion is one to one.
bool sv_model_project(const sv_camera_model *m, const double x_cam[3], double uv[2], double *duv_dx,
                      double *duv_dp);
// Unit ray in the camera's frame of a pixel. False when no ray was found (Newton did not converge).
bool sv_model_unproject(const sv_camera_model *m, const double uv[2], double ray[3]);

const char *sv_model_name(sv_model_kind kind); // mrcal's name, e.g. "LENSMODEL_OPENCV8"
int sv_model_n_params(sv_model_kind kind);
bool sv_model_by_name(const char *name, sv_model_kind *out);
// Does it map straight lines to straight lines: PINHOLE, or distortion terms that are all 0?
bool sv_model_is_straight(const sv_camera_model *m);
// Of a SPLINED lens: which control points move the projection of a point, and how much. The (order
// + 1)^2 points from column i0[0] and row i0[1] on; weight[order + 1][order + 1] by row and column:
// duv[k]/dcontrol[j][i][k] = p[k] weight[j][i]. False where the lens does not project.
bool sv_spline_weights(const sv_camera_model *m, const double x_cam[3], int i0[2], double weight[16]);

#ifdef __cplusplus
}
#endif
#endif
