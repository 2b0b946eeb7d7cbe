// SPDX-License-Identifier: Apache-2.0
// mrcal's own projection, for comparison with the models on board.
#ifndef SV_CALIB_SOLVE_PROJECT_MRCAL_H
#define SV_CALIB_SOLVE_PROJECT_MRCAL_H

#include "calib/model.h"

#ifdef __cplusplus
extern "C" {
#endif

bool sv_project_mrcal_available(void);
// As sv_model_project, through mrcal_project. duv_dp: [2][n] with all n parameters of the model
// (control points of a spline included). Returns n; 0 when mrcal has no such model, or n is above
// cap.
int sv_project_mrcal(const sv_camera_model *m, const double x_cam[3], double uv[2], double duv_dx[6],
                     double *duv_dp, int cap);
// Does mrcal read this .cameramodel?
bool sv_project_mrcal_reads(const char *text);

#ifdef __cplusplus
}
#endif
#endif
