// SPDX-License-Identifier: Apache-2.0
#include "calib/model.h"

#include <stddef.h>
#include <string.h>

#include "calib/model_fn.h"

typedef bool (*project_fn)(const sv_camera_model *, const double[3], double[2], double *, double *);
typedef bool (*unproject_fn)(const sv_camera_model *, const double[2], double[3]);

static const struct {
  const char *name;
  int n_params;
  project_fn project;
  unproject_fn unproject;
} models[SV_N_MODELS] = {
#define X(id, name, fn, n_params) {name, n_params, fn##_project, fn##_unproject},
#include "calib/models.inc"
#undef X
};

static bool is_known(sv_model_kind kind) { return (unsigned)kind < SV_N_MODELS; }

bool sv_model_project(const sv_camera_model *m, const double x_cam[3], double uv[2], double *duv_dx,
                      double *duv_dp) {
  return is_known(m->kind) && models[m->kind].project(m, x_cam, uv, duv_dx, duv_dp);
}

bool sv_model_unproject(const sv_camera_model *m, const double uv[2], double ray[3]) {
  return is_known(m->kind) && models[m->kind].unproject(m, uv, ray);
}

const char *sv_model_name(sv_model_kind kind) { return is_known(kind) ? models[kind].name : "?"; }

bool sv_model_is_straight(const sv_camera_model *m) {
  if (m->kind == SV_MODEL_KB4 || m->kind == SV_MODEL_SPLINED) return false;
  for (int i = 4; i < sv_model_n_params(m->kind); i++)
    if (m->p[i] != 0) return false;
  return true;
}

int sv_model_n_params(sv_model_kind kind) { return is_known(kind) ? models[kind].n_params : 0; }

bool sv_model_by_name(const char *name, sv_model_kind *out) {
  for (int i = 0; i < SV_N_MODELS; i++)
    if (strcmp(name, models[i].name) == 0) {
      *out = (sv_model_kind)i;
      return true;
    }
  return false;
}
