// SPDX-License-Identifier: Apache-2.0
// Private to calib/: the prototypes that models.inc names. A model file implements its prefix's
// pair with the contract of sv_model_project and sv_model_unproject (model.h).
#ifndef SV_CALIB_MODEL_FN_H
#define SV_CALIB_MODEL_FN_H

#include "calib/model.h"

#ifdef __cplusplus
extern "C" {
#endif

#define X(id, name, fn, n_params)                                                                            \
  bool fn##_project(const sv_camera_model *m, const double x_cam[3], double uv[2], double *duv_dx,           \
                    double *duv_dp);                                                                         \
  bool fn##_unproject(const sv_camera_model *m, const double uv[2], double ray[3]);
#include "calib/models.inc"
#undef X

#ifdef __cplusplus
}
#endif
#endif
