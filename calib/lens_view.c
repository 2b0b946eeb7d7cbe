// SPDX-License-Identifier: Apache-2.0
#include "calib/lens_view.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

#include "calib/remap.h"
#include "src/base/cholesky.h"
#include "src/base/mathx.h"

#define WIDE_RAD  (0.25 * SV_PI)
#define CAP_RAD   (SV_PI * 120 / 180) // of rays that a fisheye shows
#define N_SIDE    32                  // places of the picture that are looked at
#define N_TERMS   5                   // of the radial function: t, t^3, .. t^9
#define MIN_SHARE 0.25                // of the lens's focal length, in the view

// What a place of the picture sees, if anything.
static bool ray_at(const sv_camera_model *m, double share_x, double share_y, double uv[2], double ray[3]) {
  uv[0] = share_x * m->width_px;
  uv[1] = share_y * m->height_px;
  return sv_model_unproject(m, uv, ray) && sv_acos(ray[2]) < CAP_RAD;
}

static bool is_wide(const sv_camera_model *m) {
  static const double middle[4][2] = {{0, 0.5}, {1, 0.5}, {0.5, 0}, {0.5, 1}};
  double uv[2], ray[3], angle_rad = 0;
  for (int i = 0; i < 4; i++)
    if (ray_at(m, middle[i][0], middle[i][1], uv, ray)) angle_rad = sv_maxd(angle_rad, sv_acos(ray[2]));
  return angle_rad > WIDE_RAD;
}

// KB4's radial function by least squares over the picture. False where the lens sees too little.
static bool fit_radial(const sv_camera_model *m, sv_camera_model *view) {
  double a[N_TERMS * N_TERMS] = {0}, b[N_TERMS] = {0}, uv[2], ray[3];
  int n = 0;
  for (int i = 0; i <= N_SIDE; i++)
    for (int j = 0; j <= N_SIDE; j++) {
      if (!ray_at(m, (double)i / N_SIDE, (double)j / N_SIDE, uv, ray)) continue;
      const double r = sqrt(ray[0] * ray[0] + ray[1] * ray[1]), angle = sv_atan2(r, ray[2]);
      const double x = (uv[0] - m->p[2]) / m->p[0], y = (uv[1] - m->p[3]) / m->p[1];
      double power[N_TERMS] = {angle / CAP_RAD};
      if (!(r > 1e-6)) continue;
      for (int k = 1; k < N_TERMS; k++) power[k] = power[k - 1] * power[0] * power[0];
      for (int k = 0; k < N_TERMS; k++) {
        b[k] += power[k] * (x * ray[0] + y * ray[1]) / r;
        for (int l = 0; l <= k; l++) a[N_TERMS * k + l] += power[k] * power[l];
      }
      n++;
    }
  for (int k = 0; k < N_TERMS; k++) a[N_TERMS * k + k] += 1e-10 * n; // narrow fields hold few terms
  if (n < 4 * N_TERMS || !sv_cholesky(a, N_TERMS)) return false;
  sv_cholesky_solve(a, N_TERMS, b);
  const double focal = b[0] / CAP_RAD;
  if (!(focal > 0)) return false;
  view->p[0] *= focal;
  view->p[1] *= focal;
  double unit = CAP_RAD;
  for (int k = 1; k < N_TERMS; k++) {
    unit *= CAP_RAD * CAP_RAD;
    view->p[3 + k] = b[k] / (unit * focal);
  }
  return true;
}

// By what the view has to shrink about its principal point to hold all that the lens sees.
static double share_that_fits(const sv_camera_model *m, const sv_camera_model *view) {
  double share = 1, uv[2], at[2], ray[3];
  for (int i = 0; i <= N_SIDE; i++)
    for (int j = 0; j <= N_SIDE; j++) {
      if (!ray_at(m, (double)i / N_SIDE, (double)j / N_SIDE, uv, ray)) continue;
      if (!sv_model_project(view, ray, at, NULL, NULL)) return 0;
      const double size[2] = {m->width_px, m->height_px};
      for (int k = 0; k < 2; k++) {
        const double c = view->p[2 + k], off = at[k] - c;
        if (off > 1) share = sv_mind(share, (size[k] - c) / off);
        if (off < -1) share = sv_mind(share, -c / off);
      }
    }
  return share;
}

static bool make_wide(sv_lens_view *out, const sv_camera_model *m) {
  for (int is_plain = 0; is_plain < 2; is_plain++) { // equidistant where the best fit folds
    out->model = (sv_camera_model){.kind = SV_MODEL_KB4, .width_px = m->width_px, .height_px = m->height_px};
    memcpy(out->model.p, m->p, 4 * sizeof *m->p);
    if (!is_plain && !fit_radial(m, &out->model)) continue;
    const double share = share_that_fits(m, &out->model);
    out->model.p[0] *= share;
    out->model.p[1] *= share;
    if (share > MIN_SHARE && sv_fisheye_make(&out->fisheye, &out->model)) return true;
  }
  return false;
}

bool sv_lens_view_make(sv_lens_view *out, const sv_camera_model *m) {
  *out = (sv_lens_view){.model = *m};
  out->is_fisheye = sv_fisheye_make(&out->fisheye, m);
  if (out->is_fisheye) return true;
  if (!(m->p[0] > 0 && m->p[1] > 0)) return false;
  if (sv_model_is_straight(m)) return sv_pinhole_for_model(m, SV_PINHOLE_KEEP_FOCAL, &out->model);
  out->is_remapped = true;
  if (m->kind == SV_MODEL_KB4 || is_wide(m)) out->is_fisheye = make_wide(out, m);
  if (out->is_fisheye || sv_pinhole_for_model(m, SV_PINHOLE_CROP_TO_VALID, &out->model)) return true;
  out->is_fisheye = make_wide(out, m);
  return out->is_fisheye;
}

bool sv_lens_view_is_lit(const sv_lens_view *v, double u_px, double v_px) {
  const double *p = v->model.p;
  const float xy[2] = {(float)((u_px - p[2]) / p[0]), (float)((v_px - p[3]) / p[1])};
  float ray[3];
  return !v->is_fisheye || sv_fisheye_unproject(&v->fisheye, xy, ray);
}

bool sv_lens_view_has_dark(const sv_lens_view *v) {
  const double w = v->model.width_px, h = v->model.height_px;
  if (!v->is_fisheye) return false;
  return v->is_remapped || !(sv_lens_view_is_lit(v, 0, 0) && sv_lens_view_is_lit(v, w, 0) &&
                             sv_lens_view_is_lit(v, 0, h) && sv_lens_view_is_lit(v, w, h));
}
