// SPDX-License-Identifier: Apache-2.0
// Wide lenses: mrcal's splined stereographic model. It is seeded as an equidistant lens, whose
// focal length and center then stay, since the spline can express them, too; a free center could
// drift far off together with the camera's rotation.
#include <math.h>
#include <mrcal/mrcal.h>
#include <stdlib.h>
#include <string.h>

#include "calib/solve/boards.h"
#include "calib/solve/boards_mrcal.h"
#include "src/base/cholesky.h"
#include "src/base/mathx.h"

#define ORDER      3
#define SPACING    0.4            // of knots, in the stereographic plane: 23 degrees in the center
#define MARGIN     1.1            // of the grid, in angle, as the seed is not exact at the edge
#define MAX_ANGLE  2.44           // 140 degrees off the axis
#define N_RADIAL   4              // terms of the radial function: t, t^3, t^5, t^7
#define N_TERMS    (N_RADIAL + 2) // and the offset
#define N_UNKNOWNS (N_TERMS + 3)  // and the tilt of the axis, and the aspect ratio
#define N_ROUNDS   8
#define STEP       1e-4 // of differences, rad
#define MIN_SLOPE  0.3

// Distance from the axis in the stereographic plane over the angle.
static double stretch(double angle) { return angle > 0 ? 2 * tan(0.5 * angle) / angle : 1; }

// Half of what the pictures hold in the stereographic plane: their farthest corners, of an
// equidistant lens.
static void extent(const sv_mrcal_problem *p, double half[2]) {
  half[0] = half[1] = SPACING;
  for (int c = 0; c < p->b->n_cameras; c++) {
    const double *core = p->intrinsics + 4 * c;
    double angle[2];
    for (int k = 0; k < 2; k++)
      angle[k] = MARGIN * sv_maxd(core[2 + k], p->b->size_px[c][k] - core[2 + k]) / core[k];
    const double corner = hypot(angle[0], angle[1]), inner = sv_mind(corner, MAX_ANGLE);
    for (int k = 0; k < 2; k++) half[k] = sv_maxd(half[k], angle[k] * inner / corner * stretch(inner));
  }
}

sv_status sv_mrcal_make_splined(sv_mrcal_problem *p, sv_err *err) {
  double half[2];
  extent(p, half);
  mrcal_LENSMODEL_SPLINED_STEREOGRAPHIC__config_t *cfg = &p->lens.LENSMODEL_SPLINED_STEREOGRAPHIC__config;
  const int n_segments = (int)ceil(2 * half[0] / SPACING);
  p->lens = (mrcal_lensmodel_t){.type = MRCAL_LENSMODEL_SPLINED_STEREOGRAPHIC};
  cfg->order = ORDER;
  cfg->Nx = (uint16_t)(n_segments + 3);
  cfg->fov_x_deg = (uint16_t)ceil(4 * atan(0.5 * half[0]) * 180 / SV_PI);
  const double knots_per_u = n_segments / (4 * tan(cfg->fov_x_deg * SV_PI / 720));
  cfg->Ny = (uint16_t)(2 * (int)ceil(half[1] * knots_per_u) + 3);
  const int n = mrcal_lensmodel_num_params(&p->lens);
  double *all = calloc((size_t)p->b->n_cameras * (size_t)n, sizeof *all);
  if (!all) return sv_fail(err, SV_E_NOMEM, "no memory for %d control points a lens", n / 2);
  const double step = 4 * tan(cfg->fov_x_deg * SV_PI / 720) / n_segments;
  for (int c = 0; c < p->b->n_cameras; c++) {
    memcpy(all + c * n, p->intrinsics + 4 * c, 4 * sizeof *all);
    for (int i = 0; i < cfg->Nx * cfg->Ny; i++) {
      const double u = (i % cfg->Nx - 0.5 * (cfg->Nx - 1)) * step,
                   v = (i / cfg->Nx - 0.5 * (cfg->Ny - 1)) * step, r = hypot(u, v);
      const double shift = 1 / stretch(2 * atan(0.5 * r)) - 1; // to an equidistant lens
      all[c * n + 4 + 2 * i] = shift * u;
      all[c * n + 5 + 2 * i] = shift * v;
    }
  }
  free(p->intrinsics);
  p->intrinsics = all;
  p->n_params = n;
  return SV_OK;
}

sv_status sv_mrcal_take_spline(const sv_mrcal_problem *p, int c, sv_camera_model *m, sv_err *err) {
  const mrcal_LENSMODEL_SPLINED_STEREOGRAPHIC__config_t *cfg =
      &p->lens.LENSMODEL_SPLINED_STEREOGRAPHIC__config;
  const size_t n = (size_t)p->n_params - 4;
  double *control = malloc(n * sizeof *control);
  if (!control) return sv_fail(err, SV_E_NOMEM, "no memory for the control points of %s", p->b->names[c]);
  memcpy(control, p->intrinsics + c * p->n_params + 4, n * sizeof *control);
  m->spline = (sv_lens_spline){
      .order = cfg->order, .nx = cfg->Nx, .ny = cfg->Ny, .fov_x_deg = cfg->fov_x_deg, .control = control};
  return SV_OK;
}

// --- what no corner tells ------------------------------------------------------------------------
// mrcal draws control points that few corners reach to those of a stereographic lens. Here they are
// drawn to the radial lens that fits the corners best, by as much as that one is known to be off:
// with the poses as they are, the rest is linear.

typedef struct {
  const sv_boards *b;
  const sv_boards_result *r;
  int c;
  const sv_camera_model *m;
  double a[N_UNKNOWNS * N_UNKNOWNS], rhs[N_UNKNOWNS]; // of the radial lens
  double radial[N_TERMS], aspect;                     // it, and by what y differs
  double tilt[3], axis[9];                            // the rotation to its axis
  double max_angle;                                   // of the farthest corner
  double sum2;                                        // squared errors, of both axes
  int n;
  double *normal, *control; // [n_knots][n_knots] and [2][n_knots], of the spline
} refit;

// One corner: its direction in the camera's frame, and where it was seen, over the focal lengths.
typedef void (*corner_fn)(refit *f, const double x[3], const double place[2]);

static void each_corner(refit *f, corner_fn fn) {
  const sv_boards *b = f->b;
  const size_t n_corners = (size_t)b->n_cols * (size_t)b->n_rows;
  for (int frame = 0; frame < b->n_frames; frame++) {
    const size_t at = (size_t)f->c * (size_t)b->n_frames + (size_t)frame;
    for (size_t k = 0; b->is_seen[at] && k < n_corners; k++) {
      const double *uv = b->uv_px + 2 * (at * n_corners + k), *p = f->m->p;
      const double place[2] = {(uv[0] - p[2]) / p[0], (uv[1] - p[3]) / p[1]};
      double x[3];
      if (f->r->is_outlier[at * n_corners + k]) continue;
      sv_boards_corner(x, b, f->r->warp_m, (int)k % b->n_cols, (int)k / b->n_cols);
      sv_pose_apply(x, &f->r->rig_from_board[frame], x);
      sv_pose_apply(x, &f->r->cam_from_rig[f->c], x);
      fn(f, x, place);
    }
  }
}

// One coordinate of the place of a direction at this angle; across: its part along the axis.
static void radial_row(const refit *f, double angle, double across, int axis, double *row) {
  row[0] = angle * across * (axis ? f->aspect : 1);
  for (int k = 1; k < N_RADIAL; k++) row[k] = row[k - 1] * angle * angle;
  row[N_RADIAL] = axis == 0;
  row[N_RADIAL + 1] = axis == 1;
}

static double radial_place(const refit *f, double angle, double across, int axis) {
  double row[N_TERMS], sum = 0;
  radial_row(f, angle, across, axis, row);
  for (int k = 0; k < N_TERMS; k++) sum += row[k] * f->radial[k];
  return sum;
}

// Angle off the radial lens's axis, and the direction across it.
static double from_axis(const double turn[9], const double x[3], double across[2]) {
  double y[3];
  sv_apply33(y, turn, x);
  const double r = sqrt(y[0] * y[0] + y[1] * y[1]);
  for (int k = 0; k < 2; k++) across[k] = r > 0 ? y[k] / r : 0;
  return atan2(r, y[2]);
}

static void add_to_radial(refit *f, const double x[3], const double place[2]) {
  double across[2], moved[2][2], row[N_UNKNOWNS], turn[9], moved_angle[2];
  const double angle = from_axis(f->axis, x, across);
  for (int k = 0; k < 2; k++) {
    const double tilt[3] = {f->tilt[0] + (k == 0) * STEP, f->tilt[1] + (k == 1) * STEP, 0};
    sv_rodrigues(turn, tilt);
    moved_angle[k] = from_axis(turn, x, moved[k]);
  }
  for (int axis = 0; axis < 2; axis++) {
    const double at = radial_place(f, angle, across[axis], axis);
    radial_row(f, angle, across[axis], axis, row);
    for (int k = 0; k < 2; k++)
      row[N_TERMS + k] = (radial_place(f, moved_angle[k], moved[k][axis], axis) - at) / STEP;
    row[N_TERMS + 2] = axis ? (at - f->radial[N_RADIAL + 1]) / f->aspect : 0;
    for (int i = 0; i < N_UNKNOWNS; i++) {
      f->rhs[i] += row[i] * place[axis];
      for (int j = 0; j <= i; j++) f->a[N_UNKNOWNS * i + j] += row[i] * row[j];
    }
  }
  f->max_angle = sv_maxd(f->max_angle, angle);
}

static void add_to_error(refit *f, const double x[3], const double place[2]) {
  double across[2];
  const double angle = from_axis(f->axis, x, across);
  for (int axis = 0; axis < 2; axis++) {
    const double off = f->m->p[axis] * (radial_place(f, angle, across[axis], axis) - place[axis]);
    f->sum2 += off * off;
    f->n++;
  }
}

// Gauss-Newton on the tilt and the aspect ratio; all else is linear.
static bool fit_radial(refit *f) {
  f->radial[0] = f->aspect = 1;
  for (int round = 0; round < N_ROUNDS; round++) {
    memset(f->a, 0, sizeof f->a);
    memset(f->rhs, 0, sizeof f->rhs);
    f->max_angle = 0;
    sv_rodrigues(f->axis, f->tilt);
    each_corner(f, add_to_radial);
    if (!sv_cholesky(f->a, N_UNKNOWNS)) return false;
    sv_cholesky_solve(f->a, N_UNKNOWNS, f->rhs);
    memcpy(f->radial, f->rhs, sizeof f->radial);
    for (int k = 0; k < 2; k++) f->tilt[k] += f->rhs[N_TERMS + k];
    f->aspect += f->rhs[N_TERMS + 2];
  }
  sv_rodrigues(f->axis, f->tilt);
  each_corner(f, add_to_error);
  return f->n > 0;
}

static void add_to_spline(refit *f, const double x[3], const double place[2]) {
  const sv_lens_spline *s = &f->m->spline;
  const int n = s->order + 1, n_knots = s->nx * s->ny;
  const double to_plane = 2 / (sv_norm3(x) + x[2]);
  double weight[16];
  int i0[2];
  if (!sv_spline_weights(f->m, x, i0, weight)) return;
  for (int k = 0; k < n * n; k++) {
    const int i = (i0[1] + k / n) * s->nx + i0[0] + k % n;
    for (int axis = 0; axis < 2; axis++)
      f->control[axis * n_knots + i] += weight[k] * (place[axis] - to_plane * x[axis]);
    for (int l = 0; l <= k; l++) {
      const int j = (i0[1] + l / n) * s->nx + i0[0] + l % n;
      f->normal[(size_t)i * (size_t)n_knots + (size_t)j] += weight[k] * weight[l];
    }
  }
}

// The radial lens's shift at a place of the stereographic plane. Beyond the farthest corner it goes
// on straight.
static double radial_shift(const refit *f, const double u[2], int axis) {
  const double s = 0.25 * (u[0] * u[0] + u[1] * u[1]), x[3] = {u[0], u[1], 1 - s};
  double across[2];
  const double angle = from_axis(f->axis, x, across), inner = sv_mind(angle, f->max_angle);
  const double slope = (radial_place(f, inner, 1, 0) - radial_place(f, inner - STEP, 1, 0)) / STEP;
  return radial_place(f, inner, across[axis], axis) +
         sv_maxd(slope, MIN_SLOPE) * (angle - inner) * across[axis] - u[axis];
}

// Control points of the cubic spline that runs through it (quasi-interpolation).
static double radial_control(const refit *f, int i, int axis) {
  const sv_lens_spline *s = &f->m->spline;
  const double step = 4 * tan(s->fov_x_deg * SV_PI / 720) / (s->nx - 3);
  const double u[2] = {(i % s->nx - 0.5 * (s->nx - 1)) * step, (i / s->nx - 0.5 * (s->ny - 1)) * step};
  double sum = 10 * radial_shift(f, u, axis);
  for (int k = 0; k < 4; k++) {
    const double beside[2] = {u[0] + (k < 2 ? step * (2 * k - 1) : 0),
                              u[1] + (k < 2 ? 0 : step * (2 * k - 5))};
    sum -= radial_shift(f, beside, axis);
  }
  return sum / 6;
}

static void solve_spline(refit *f, double *control) {
  const int n = f->m->spline.nx * f->m->spline.ny;
  const double noise = f->r->cameras[f->c].rms_px * sqrt(0.5), off = sqrt(f->sum2 / f->n);
  const double trust = noise / sv_maxd(off, 2 * noise);
  each_corner(f, add_to_spline);
  for (int i = 0; i < n; i++) {
    f->normal[(size_t)i * (size_t)n + (size_t)i] += trust * trust;
    for (int axis = 0; axis < 2; axis++)
      f->control[axis * n + i] += trust * trust * radial_control(f, i, axis);
  }
  if (!sv_cholesky(f->normal, n)) return;
  for (int axis = 0; axis < 2; axis++) {
    sv_cholesky_solve(f->normal, n, f->control + axis * n);
    for (int i = 0; i < n; i++) control[2 * i + axis] = f->control[axis * n + i];
  }
}

sv_status sv_mrcal_refit_spline(const sv_boards *b, const sv_boards_result *r, int c, sv_err *err) {
  const size_t n = (size_t)r->models[c].spline.nx * (size_t)r->models[c].spline.ny;
  refit f = {.b = b, .r = r, .c = c, .m = &r->models[c]};
  f.normal = calloc(n * n, sizeof *f.normal);
  f.control = calloc(2 * n, sizeof *f.control);
  const bool is_good = f.normal && f.control;
  if (is_good && fit_radial(&f)) solve_spline(&f, (double *)r->models[c].spline.control); // its own
  free(f.normal);
  free(f.control);
  return is_good ? SV_OK : sv_fail(err, SV_E_NOMEM, "no memory for the control points of %s", b->names[c]);
}
