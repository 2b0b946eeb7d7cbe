// SPDX-License-Identifier: Apache-2.0
// For builds without mrgingham.
#include "calib/solve/corners.h"

bool sv_corners_has_mrgingham(void) { return false; }

bool sv_corners_mrgingham(const sv_corners_job *job, double *uv_px) {
  (void)job;
  (void)uv_px;
  return false;
}
