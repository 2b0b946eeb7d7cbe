// SPDX-License-Identifier: Apache-2.0
#include "src/rig/shutter.h"

#include <string.h>

#include "src/base/cholesky.h"
#include "src/base/mathx.h"
#include "src/base/str.h"

#define GRID    21   // places a side
#define OUTSIDE 0.05 // of the readout, by which places beside the image may be late or early

static const char *const names[SV_N_SHUTTERS] = {"down", "up", "right", "left"};

const char *sv_shutter_name(sv_shutter_direction d) { return names[d]; }

int sv_shutter_by_name(const char *name) {
  for (int i = 0; i < SV_N_SHUTTERS; i++)
    if (sv_str_eq(name, names[i])) return i;
  return -1;
}

static void terms(double x, double y, double out[SV_ROW_TIME_TERMS]) {
  const double all[SV_ROW_TIME_TERMS] = {1,     x,         y,         x * x,     x * y,
                                         y * y, x * x * x, x * x * y, x * y * y, y * y * y};
  memcpy(out, all, sizeof all);
}

// Of a pixel of the sub-view's image.
static double pixel_time(const sv_row_time_cfg *c, const double uv[2]) {
  const sv_shutter_direction d = c->shutter.direction;
  const bool is_across = d == SV_SHUTTER_RIGHT || d == SV_SHUTTER_LEFT;
  const double at =
      is_across ? (uv[0] + c->x0_px) / c->sensor_width_px : (uv[1] + c->y0_px) / c->sensor_height_px;
  const double s = c->shutter.readout_s * (at - 0.5);
  return d == SV_SHUTTER_UP || d == SV_SHUTTER_LEFT ? -s : s;
}

// From a place (x, y, 1) of a fisheye's view to the direction that is seen there; false: none.
static bool to_direction(const sv_fisheye *f, double x[3]) {
  const float place[2] = {(float)x[0], (float)x[1]};
  float ray[3];
  if (!sv_fisheye_unproject(f, place, ray)) return false;
  for (int i = 0; i < 3; i++) x[i] = (double)ray[i];
  return true;
}

sv_status sv_row_time_make(sv_row_time *out, const sv_row_time_cfg *c) {
  double a[SV_ROW_TIME_TERMS * SV_ROW_TIME_TERMS] = {0}, b[SV_ROW_TIME_TERMS] = {0};
  double p[SV_ROW_TIME_TERMS];
  int n = 0;
  memset(out, 0, sizeof *out);
  if (!(c->shutter.readout_s > 0)) return SV_OK;
  // Coordinates of -1 to 1, which keep the system well conditioned.
  for (int i = 0; i < GRID * GRID; i++) {
    const double u = 2.0 * (i % GRID) / (GRID - 1) - 1, v = 2.0 * (i / GRID) / (GRID - 1) - 1;
    double x[3] = {u * c->half_x, v * c->half_y, 1}, uv[2];
    if (c->fisheye && !to_direction(c->fisheye, x)) continue;
    if (!sv_model_project(c->lens, x, uv, NULL, NULL)) continue;
    const double s = pixel_time(c, uv);
    terms(u, v, p);
    for (int k = 0; k < SV_ROW_TIME_TERMS; k++) {
      b[k] += p[k] * s;
      for (int m = 0; m <= k; m++) a[SV_ROW_TIME_TERMS * k + m] += p[k] * p[m];
    }
    n++;
  }
  if (n < 4 * SV_ROW_TIME_TERMS || !sv_cholesky(a, SV_ROW_TIME_TERMS)) return SV_E_RANGE;
  sv_cholesky_solve(a, SV_ROW_TIME_TERMS, b);
  terms(1 / c->half_x, 1 / c->half_y, p);
  for (int k = 0; k < SV_ROW_TIME_TERMS; k++) out->c[k] = b[k] * p[k];
  out->max_s = (0.5 + OUTSIDE) * c->shutter.readout_s;
  return SV_OK;
}

double sv_row_time_at(const sv_row_time *t, double x, double y) {
  double p[SV_ROW_TIME_TERMS], s = 0;
  terms(x, y, p);
  for (int k = 0; k < SV_ROW_TIME_TERMS; k++) s += t->c[k] * p[k];
  return sv_maxd(s < t->max_s ? s : t->max_s, -t->max_s);
}

// --- motion --------------------------------------------------------------------------------------

void sv_motion_apply(double out[3], const double twist[6], double s, const double x[3], double turn[9]) {
  const double w[3] = {s * twist[0], s * twist[1], s * twist[2]};
  sv_rodrigues(turn, w);
  sv_apply33(out, turn, x);
  for (int i = 0; i < 3; i++) out[i] += s * twist[3 + i];
}

void sv_motion_of_camera(double out[6], const double rig[6], const sv_pose *c) {
  // x_cam = R x_rig + t, so x_cam' = R (omega x R^T (x_cam - t) + v).
  double turn[3], w[3], v[3];
  sv_apply33(w, c->r, rig);
  sv_apply33(v, c->r, rig + 3);
  sv_cross3(turn, w, c->t);
  for (int i = 0; i < 3; i++) {
    out[i] = w[i];
    out[3 + i] = v[i] - turn[i];
  }
}

void sv_motion_slopes(double slope[2], double a_s, double b_s) {
  // The parabola through 0 and both.
  const bool is_both = a_s != 0 && b_s != 0;
  slope[0] = is_both ? b_s / (a_s * (b_s - a_s)) : a_s != 0 ? 1 / a_s : 0;
  slope[1] = is_both ? a_s / (b_s * (a_s - b_s)) : b_s != 0 ? 1 / b_s : 0;
}

void sv_motion_from(double out[6], const double slope[2], const sv_pose *at, const sv_pose *a,
                    const sv_pose *b) {
  const sv_pose *const other[2] = {a, b}, back = sv_pose_inv(at);
  for (int i = 0; i < 6; i++) out[i] = 0;
  for (int k = 0; k < 2; k++) {
    if (slope[k] == 0) continue;
    const sv_pose step = sv_pose_mul(other[k], &back);
    double w[3];
    sv_rodrigues_inv(w, step.r);
    for (int i = 0; i < 3; i++) {
      out[i] += slope[k] * w[i];
      out[3 + i] += slope[k] * step.t[i];
    }
  }
}
