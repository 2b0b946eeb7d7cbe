// SPDX-License-Identifier: Apache-2.0
#include "calib/solve/project_mrcal.h"

#include <mrcal/mrcal.h>
#include <stdlib.h>
#include <string.h>

bool sv_project_mrcal_available(void) { return true; }

int sv_project_mrcal(const sv_camera_model *m, const double x_cam[3], double uv[2], double duv_dx[6],
                     double *duv_dp, int cap) {
  mrcal_lensmodel_t lens = {.type = MRCAL_LENSMODEL_SPLINED_STEREOGRAPHIC};
  const sv_lens_spline *s = &m->spline;
  if (m->kind == SV_MODEL_SPLINED) {
    lens.LENSMODEL_SPLINED_STEREOGRAPHIC__config.order = (uint16_t)s->order;
    lens.LENSMODEL_SPLINED_STEREOGRAPHIC__config.Nx = (uint16_t)s->nx;
    lens.LENSMODEL_SPLINED_STEREOGRAPHIC__config.Ny = (uint16_t)s->ny;
    lens.LENSMODEL_SPLINED_STEREOGRAPHIC__config.fov_x_deg = (uint16_t)s->fov_x_deg;
  } else if (!mrcal_lensmodel_from_name(&lens, sv_model_name(m->kind))) return 0;
  int n = mrcal_lensmodel_num_params(&lens);
  double *p = n > 0 && n <= cap ? malloc((size_t)n * sizeof *p) : NULL;
  mrcal_point2_t q;
  mrcal_point3_t x = {.x = x_cam[0], .y = x_cam[1], .z = x_cam[2]}, dq_dp[2];
  if (!p) return 0;
  for (int i = 0; i < n; i++)
    p[i] = i < 4 || m->kind != SV_MODEL_SPLINED ? m->p[i] - (i == 2 || i == 3 ? 0.5 : 0) : s->control[i - 4];
  bool is_good = mrcal_project(&q, dq_dp, duv_dp, &x, 1, &lens, p);
  free(p);
  for (int a = 0; a < 2 && is_good; a++) {
    uv[a] = q.xy[a] + 0.5; // mrcal's pixel centers are at integers
    for (int k = 0; k < 3; k++) duv_dx[3 * a + k] = dq_dp[a].xyz[k];
  }
  return is_good ? n : 0;
}

bool sv_project_mrcal_reads(const char *text) {
  mrcal_cameramodel_t *m = mrcal_read_cameramodel_string(text, (int)strlen(text));
  if (!m) return false;
  mrcal_free_cameramodel(&m);
  return true;
}
