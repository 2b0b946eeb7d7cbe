// SPDX-License-Identifier: Apache-2.0
// For builds without mrcal.
#include "calib/solve/project_mrcal.h"

bool sv_project_mrcal_available(void) { return false; }

int sv_project_mrcal(const sv_camera_model *m, const double x_cam[3], double uv[2], double duv_dx[6],
                     double *duv_dp, int cap) {
  (void)m;
  (void)x_cam;
  (void)uv;
  (void)duv_dx;
  (void)duv_dp;
  (void)cap;
  return 0;
}

bool sv_project_mrcal_reads(const char *text) {
  (void)text;
  return false;
}
