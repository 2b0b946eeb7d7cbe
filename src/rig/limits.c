// SPDX-License-Identifier: Apache-2.0
#include "src/rig/limits.h"

#include <math.h>

typedef enum {
#define X(id, what, unit, min, max, why) LIMIT_##id,
#include "src/rig/limits.inc"
#undef X
} limit_id;

static const struct {
  const char *what, *unit, *why;
  double min, max;
} limits[] = {
#define X(id, what, unit, min, max, why) {what, unit, why, min, max},
#include "src/rig/limits.inc"
#undef X
};

static sv_status check(limit_id id, double v, const char *where, sv_err *err) {
  if (v >= limits[id].min && v <= limits[id].max) return SV_OK;
  return sv_fail(err, SV_E_RANGE, "%s: %s is %g%s%s; expected %g to %g: %s", where, limits[id].what, v,
                 limits[id].unit[0] ? " " : "", limits[id].unit, limits[id].min, limits[id].max,
                 limits[id].why);
}

sv_status sv_limits_check_camera(const sv_camera_model *m, const char *where, sv_err *err) {
  const int n = sv_model_n_params(m->kind);
  if (m->width_px < 1 || m->height_px < 1 || m->width_px > SV_CAP_IMAGE_SIDE_PX ||
      m->height_px > SV_CAP_IMAGE_SIDE_PX)
    return sv_fail(err, SV_E_RANGE, "%s: the image is %dx%d; expected 1 to %d px a side", where, m->width_px,
                   m->height_px, SV_CAP_IMAGE_SIDE_PX);
  const double side_px = m->width_px > m->height_px ? m->width_px : m->height_px;
  for (int i = 0; i < n; i++) {
    sv_status s = i < 2   ? check(LIMIT_FOCAL, m->p[i] / side_px, where, err)
                  : i < 4 ? check(LIMIT_PRINCIPAL, m->p[i] / side_px, where, err)
                          : check(LIMIT_DISTORTION, m->p[i], where, err);
    if (s < 0) return s;
  }
  return SV_OK;
}

sv_status sv_limits_check_pose(const sv_pose *cam_from_world, const char *where, sv_err *err) {
  double centre[3];
  sv_pose_centre(centre, cam_from_world);
  sv_status s = SV_OK;
  for (int i = 0; i < 3 && s == SV_OK; i++) s = check(LIMIT_POSITION, centre[i], where, err);
  return s;
}

sv_status sv_limits_check_scene(const double centre[3], double radius, const char *where, sv_err *err) {
  sv_status s = check(LIMIT_SCENE_RADIUS, radius, where, err);
  return s < 0 ? s : check(LIMIT_SCENE_CENTRE, sv_norm3(centre) / radius, where, err);
}
