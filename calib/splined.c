// SPDX-License-Identifier: Apache-2.0
// mrcal's splined stereographic model (D. Kogan, mrcal documentation, "Lens models"): the
// stereographic projection
//   u = 2 (X, Y) / (|x| + Z)
// shifted by a B-spline surface over a grid of control points c, then scaled:
//   uv = f (u + sum_ji B_j(y) B_i(x) c_ji) + (cx, cy)
// with knots at equal distances in u, so that the field of view across fits between the outermost
// usable ones. Rays outside the grid are refused: there mrcal extrapolates the outer polynomial.
#include <math.h>
#include <stddef.h>

#include "calib/model_fn.h"
#include "src/base/mathx.h"

#define CAP_ORDER 3

typedef struct {
  int i0; // first control point
  // weights, and their derivatives by the knot coordinate
  double w[CAP_ORDER + 1], dw[CAP_ORDER + 1];
} basis;

static double knots_per_u(const sv_lens_spline *s) {
  double edge = 2 * sv_tan(s->fov_x_deg * SV_PI / 720); // u at half the field of view
  return (s->nx - 1 - (s->order == 2 ? 1 : 2)) / (2 * edge);
}

static bool is_usable(const sv_lens_spline *s) {
  return (s->order == 2 || s->order == 3) && s->nx > s->order && s->ny > s->order &&
         s->nx <= SV_CAP_SPLINE_SIDE && s->ny <= SV_CAP_SPLINE_SIDE && s->fov_x_deg > 0 &&
         s->fov_x_deg < 360 && s->control;
}

// The uniform B-spline's polynomials on the segment that holds coordinate x in knots. False outside
// the grid.
static bool basis_at(basis *b, int order, int n, double x) {
  if (order == 3) {
    if (!(x >= 1 && x <= n - 2)) return false;
    int i = sv_mini((int)floor(x), n - 3);
    double t = x - i, t2 = t * t, t3 = t2 * t;
    b->i0 = i - 1;
    b->w[0] = (1 - 3 * t + 3 * t2 - t3) / 6;
    b->dw[0] = (-1 + 2 * t - t2) / 2;
    b->w[1] = (4 - 6 * t2 + 3 * t3) / 6;
    b->dw[1] = (-4 * t + 3 * t2) / 2;
    b->w[2] = (1 + 3 * t + 3 * t2 - 3 * t3) / 6;
    b->dw[2] = (1 + 2 * t - 3 * t2) / 2;
    b->w[3] = t3 / 6;
    b->dw[3] = t2 / 2;
  } else {
    if (!(x >= 0.5 && x <= n - 1.5)) return false;
    int i = sv_clampi((int)floor(x + 0.5), 1, n - 2);
    double t = x - i;
    b->i0 = i - 1;
    b->w[0] = (4 * t * t - 4 * t + 1) / 8;
    b->dw[0] = t - 0.5;
    b->w[1] = (3 - 4 * t * t) / 4;
    b->dw[1] = -2 * t;
    b->w[2] = (4 * t * t + 4 * t + 1) / 8;
    b->dw[2] = t + 0.5;
    b->w[3] = b->dw[3] = 0;
  }
  return true;
}

typedef struct {
  basis x, y;
  double q[2], dq[4]; // u + shift, and its Jacobian by u, row-major
} shifted;

static bool shift_at(const sv_lens_spline *s, const double u[2], shifted *o) {
  double k = knots_per_u(s), sum[2] = {0}, dx[2] = {0}, dy[2] = {0};
  if (!basis_at(&o->x, s->order, s->nx, u[0] * k + 0.5 * (s->nx - 1)) ||
      !basis_at(&o->y, s->order, s->ny, u[1] * k + 0.5 * (s->ny - 1)))
    return false;
  for (int j = 0; j <= s->order; j++)
    for (int i = 0; i <= s->order; i++) {
      const double *c = s->control + 2 * ((size_t)(o->y.i0 + j) * (size_t)s->nx + (size_t)(o->x.i0 + i));
      for (int a = 0; a < 2; a++) {
        sum[a] += o->y.w[j] * o->x.w[i] * c[a];
        dx[a] += o->y.w[j] * o->x.dw[i] * c[a];
        dy[a] += o->y.dw[j] * o->x.w[i] * c[a];
      }
    }
  for (int a = 0; a < 2; a++) {
    o->q[a] = u[a] + sum[a];
    o->dq[2 * a] = (a == 0) + dx[a] * k;
    o->dq[2 * a + 1] = (a == 1) + dy[a] * k;
  }
  return o->dq[0] * o->dq[3] - o->dq[1] * o->dq[2] > 0; // not folded
}

static bool stereographic(const double x[3], double u[2], double *du_dx) {
  double n = sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]), d = n + x[2];
  if (!(n > 0 && n < 1e150 && d > 1e-12 * n)) return false;
  double s = 2 / d;
  u[0] = s * x[0];
  u[1] = s * x[1];
  for (int a = 0; a < 2 && du_dx; a++)
    for (int k = 0; k < 3; k++) du_dx[3 * a + k] = (a == k) * s - u[a] / d * (x[k] / n + (k == 2));
  return true;
}

bool sv_splined_project(const sv_camera_model *m, const double x_cam[3], double uv[2], double *duv_dx,
                        double *duv_dp) {
  double u[2], du[6];
  shifted o;
  if (!is_usable(&m->spline) || !stereographic(x_cam, u, du) || !shift_at(&m->spline, u, &o)) return false;
  for (int a = 0; a < 2; a++) uv[a] = m->p[a] * o.q[a] + m->p[2 + a];
  if (!(fabs(uv[0]) < 1e300 && fabs(uv[1]) < 1e300)) return false;
  for (int a = 0; a < 2 && duv_dx; a++)
    for (int k = 0; k < 3; k++)
      duv_dx[3 * a + k] = m->p[a] * (o.dq[2 * a] * du[k] + o.dq[2 * a + 1] * du[3 + k]);
  if (duv_dp) {
    duv_dp[0] = o.q[0];
    duv_dp[1] = 0;
    duv_dp[2] = 1;
    duv_dp[3] = 0;
    duv_dp[4] = 0;
    duv_dp[5] = o.q[1];
    duv_dp[6] = 0;
    duv_dp[7] = 1;
  }
  return true;
}

bool sv_spline_weights(const sv_camera_model *m, const double x_cam[3], int i0[2], double weight[16]) {
  double u[2];
  shifted o;
  if (m->kind != SV_MODEL_SPLINED || !is_usable(&m->spline) || !stereographic(x_cam, u, NULL) ||
      !shift_at(&m->spline, u, &o))
    return false;
  int n = m->spline.order + 1;
  i0[0] = o.x.i0;
  i0[1] = o.y.i0;
  for (int j = 0; j < n; j++)
    for (int i = 0; i < n; i++) weight[j * n + i] = o.y.w[j] * o.x.w[i];
  return true;
}

// Newton on u, with the step halved until it stays on the grid and comes nearer.
bool sv_splined_unproject(const sv_camera_model *m, const double uv[2], double ray[3]) {
  double f = fabs(m->p[0]) > fabs(m->p[1]) ? fabs(m->p[0]) : fabs(m->p[1]), t[2], u[2];
  shifted o;
  if (!is_usable(&m->spline)) return false;
  for (int a = 0; a < 2; a++) u[a] = t[a] = (uv[a] - m->p[2 + a]) / m->p[a];
  if (!(fabs(t[0]) < 1e6 && fabs(t[1]) < 1e6)) return false;
  for (int i = 0; i < 60 && !shift_at(&m->spline, u, &o); i++) {
    u[0] *= 0.75;
    u[1] *= 0.75;
  }
  if (!shift_at(&m->spline, u, &o)) return false;
  double e[2] = {o.q[0] - t[0], o.q[1] - t[1]}, err = e[0] * e[0] + e[1] * e[1];
  for (int it = 0; it < 100 && err > 0; it++) {
    double det = o.dq[0] * o.dq[3] - o.dq[1] * o.dq[2], step = 1;
    double d[2] = {(o.dq[3] * e[0] - o.dq[1] * e[1]) / det, (o.dq[0] * e[1] - o.dq[2] * e[0]) / det};
    bool is_better = false;
    for (int half = 0; half < 40 && !is_better; half++, step *= 0.5) {
      double v[2] = {u[0] - step * d[0], u[1] - step * d[1]};
      shifted o2;
      if (!shift_at(&m->spline, v, &o2)) continue;
      double e2[2] = {o2.q[0] - t[0], o2.q[1] - t[1]}, err2 = e2[0] * e2[0] + e2[1] * e2[1];
      if (!(err2 < err)) continue;
      for (int a = 0; a < 2; a++) {
        u[a] = v[a];
        e[a] = e2[a];
      }
      o = o2;
      err = err2;
      is_better = true;
    }
    if (!is_better) break;
  }
  if (!(sqrt(err) * f < 1e-8)) return false;
  double s = 0.25 * (u[0] * u[0] + u[1] * u[1]), n = 1 / (1 + s); // |x| = 1: u = 2 tan(t / 2)
  ray[0] = u[0] * n;
  ray[1] = u[1] * n;
  ray[2] = (1 - s) * n;
  return true;
}
