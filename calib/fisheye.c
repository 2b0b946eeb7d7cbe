// SPDX-License-Identifier: Apache-2.0
#include "calib/fisheye.h"

#include <math.h>
#include <stddef.h>

#include "src/base/mathx.h"

#define N_NODES    32
#define MARGIN_RAD 0.25 // beyond the picture's edge
#define CAP_RAD    2.2  // 252 degrees in all: beyond that the polynomials are not exact
#define EDGE_RAD   0.02 // the same, for the inverse
#define STEP_RAD   0.01
#define MIN_SLOPE  0.3  // of rho by the angle; 1 in the center
#define TOLERANCE  0.02 // px

// rho, the distance from the center over the focal length, at this angle; < 0: not in range.
static double rho_at(const sv_camera_model *m, double angle) {
  double uv[2], x[3] = {sv_sin(angle), 0, sv_cos(angle)};
  if (!sv_model_project(m, x, uv, NULL, NULL)) return -1;
  return (uv[0] - m->p[2]) / m->p[0];
}

// Is it in range, and does rho still grow there? Close to a fold the inverse has no polynomial.
static bool is_usable(const sv_camera_model *m, double angle) {
  const double rho = rho_at(m, angle), next = rho_at(m, angle + STEP_RAD);
  return rho >= 0 && next - rho > MIN_SLOPE * STEP_RAD;
}

// The largest usable angle, at most CAP_RAD.
static double widest(const sv_camera_model *m) {
  double angle = 0;
  while (angle + STEP_RAD < CAP_RAD && is_usable(m, angle + STEP_RAD)) angle += STEP_RAD;
  return angle;
}

// The largest angle of the picture's corners.
static double angle_of_corners(const sv_camera_model *m, double in_range) {
  double widest_rad = 0;
  for (int i = 0; i < 4; i++) {
    const double uv[2] = {i & 1 ? m->width_px : 0, i & 2 ? m->height_px : 0};
    double ray[3];
    if (!sv_model_unproject(m, uv, ray)) return in_range;
    widest_rad = sv_maxd(widest_rad, sv_acos(ray[2]));
  }
  return widest_rad;
}

// Chebyshev interpolation of value(x) on [0, x_max], as powers of 2 x / x_max - 1.
typedef struct {
  const sv_camera_model *m;
  double angle_max, x_max;
  bool is_inverse;
} fit;

// rho / |h| at w = |h|^2, or |h| / rho at rho^2.
static double value(const fit *f, double x) {
  const double root = sqrt(x);
  if (!f->is_inverse) return rho_at(f->m, 2 * sv_atan2(root, 1)) / root;
  double lo = 0, hi = f->angle_max;
  for (int i = 0; i < 60; i++) {
    const double mid = 0.5 * (lo + hi), rho = rho_at(f->m, mid);
    if (rho >= 0 && rho < root) lo = mid;
    else hi = mid;
  }
  return sv_tan(0.25 * (lo + hi)) / root;
}

static void interpolate(const fit *f, float *term) {
  double a[SV_FISHEYE_TERMS] = {0}, power[SV_FISHEYE_TERMS] = {0}, c0[SV_FISHEYE_TERMS] = {1},
         c1[SV_FISHEYE_TERMS] = {0, 1};
  for (int i = 0; i < N_NODES; i++) {
    const double t = SV_PI * (i + 0.5) / N_NODES, v = value(f, 0.5 * f->x_max * (sv_cos(t) + 1));
    for (int k = 0; k < SV_FISHEYE_TERMS; k++) a[k] += (k ? 2.0 : 1.0) / N_NODES * v * sv_cos(k * t);
  }
  for (int k = 0; k < SV_FISHEYE_TERMS; k++) { // c0 is T_k
    for (int i = 0; i < SV_FISHEYE_TERMS; i++) power[i] += a[k] * c0[i];
    for (int i = SV_FISHEYE_TERMS - 1; i >= 0; i--) {
      const double next = (i ? 2 * c1[i - 1] : 0) - c0[i];
      c0[i] = c1[i];
      c1[i] = next;
    }
  }
  for (int i = 0; i < SV_FISHEYE_TERMS; i++) term[i] = (float)power[SV_FISHEYE_TERMS - 1 - i];
}

static float horner(const float *term, float y) {
  float f = term[0];
  for (int k = 1; k < SV_FISHEYE_TERMS; k++) f = f * y + term[k];
  return f;
}

bool sv_fisheye_project(const sv_fisheye *f, const float x[3], float xy[2]) {
  const float n = sqrtf(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]), s = n + x[2];
  const float h[2] = {x[0] / s, x[1] / s}, w = h[0] * h[0] + h[1] * h[1];
  if (!(w <= f->max_w)) return false;
  const float k = horner(f->term, f->scale * w - 1.0f);
  xy[0] = h[0] * k;
  xy[1] = h[1] * k;
  return true;
}

// F and its derivative by w.
static void radial(const sv_fisheye *f, float w, float *value_at_w, float *slope) {
  const float y = f->scale * w - 1.0f;
  float f0 = f->term[0], f1 = 0;
  for (int k = 1; k < SV_FISHEYE_TERMS; k++) {
    f1 = f1 * y + f0;
    f0 = f0 * y + f->term[k];
  }
  *value_at_w = f0;
  *slope = f1 * f->scale;
}

// Rows of d(h F)/dx = F dh/dx + 2 F' h (h . dh/dx), dh/dx = (e - h g) / s, with g = ds/dx.
void sv_fisheye_jacobian(const sv_fisheye *f, const float x[3], float j[6]) {
  const float n = sqrtf(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]), s = n + x[2];
  const float h[2] = {x[0] / s, x[1] / s}, g[3] = {x[0] / n, x[1] / n, s / n}, w = h[0] * h[0] + h[1] * h[1];
  float at, slope;
  radial(f, w, &at, &slope);
  for (int i = 0; i < 2; i++) {
    for (int k = 0; k < 3; k++) {
      const float along = (k < 2 ? h[k] : 0) - w * g[k]; // s (h . dh/dx)
      j[3 * i + k] = (2 * slope * h[i] * along - at * h[i] * g[k]) / s;
    }
    j[4 * i] += at / s;
  }
}

bool sv_fisheye_unproject(const sv_fisheye *f, const float xy[2], float ray[3]) {
  const float rho2 = xy[0] * xy[0] + xy[1] * xy[1];
  if (!(rho2 <= f->max_rho2)) return false;
  float k = horner(f->inverse_term, f->inverse_scale * rho2 - 1.0f);
  for (int i = 0; i < 2; i++) { // Newton: where the lens compresses much, the inverse is not exact
    const float w = k * k * rho2;
    float at, slope;
    radial(f, w, &at, &slope);
    k -= (k * at - 1) / (at + 2 * w * slope);
  }
  const float h[2] = {xy[0] * k, xy[1] * k}, w = h[0] * h[0] + h[1] * h[1], c = 2.0f / (1.0f + w);
  ray[0] = h[0] * c;
  ray[1] = h[1] * c;
  ray[2] = c - 1.0f;
  return true;
}

// Both ways, at angles across the picture.
static bool is_exact(const sv_fisheye *f, const sv_camera_model *m, double angle_max) {
  for (int i = 1; i <= 200; i++) {
    const double a = angle_max * i / 200, rho = rho_at(m, a);
    const float at[2] = {(float)rho, 0}, x[3] = {(float)sv_sin(a), 0, (float)sv_cos(a)};
    float xy[2], ray[3];
    if (!sv_fisheye_project(f, x, xy) || !sv_fisheye_unproject(f, at, ray)) return false;
    const double back = rho_at(m, sv_atan2((double)ray[0], (double)ray[2]));
    if (!(fabs((double)xy[0] - rho) * m->p[0] < TOLERANCE && fabs(back - rho) * m->p[0] < TOLERANCE))
      return false;
  }
  return true;
}

bool sv_fisheye_make(sv_fisheye *f, const sv_camera_model *m) {
  if (m->kind != SV_MODEL_KB4 || !(m->p[0] > 0 && m->p[1] > 0)) return false;
  const double in_range = widest(m), seen = sv_mind(angle_of_corners(m, in_range), in_range);
  const double angle = sv_mind(in_range, seen + MARGIN_RAD), inner = sv_mind(in_range, seen + EDGE_RAD);
  const double h = sv_tan(0.5 * angle), rho = rho_at(m, inner);
  if (!(h > 0.01 && rho > 0)) return false;
  const fit forward = {m, angle, h * h, false}, inverse = {m, inner, rho * rho, true};
  *f = (sv_fisheye){.scale = (float)(2 / forward.x_max),
                    .max_w = (float)(forward.x_max * (1 - 1e-6)),
                    .inverse_scale = (float)(2 / inverse.x_max),
                    .max_rho2 = (float)(inverse.x_max * (1 - 1e-6))};
  interpolate(&forward, f->term);
  interpolate(&inverse, f->inverse_term);
  return is_exact(f, m, sv_mind(seen, inner * (1 - 1e-5)));
}
