// SPDX-License-Identifier: Apache-2.0
// Covariance of the solution from the solver's Jacobian J (mrcal's, in packed units): noise of the
// residuals' size sigma on each coordinate gives cov(b) = sigma^2 (J^T J)^-1, factored by CHOLMOD.
// Projection uncertainty is mrcal's ("mean-frames" of its documentation, at infinity): a direction
// is held fixed in the frame of each board; where it projects then depends on the lens, the
// camera's rotation and the mean of the boards' rotations.
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <suitesparse/cholmod.h>

#include "calib/solve/boards.h"
#include "calib/solve/mrcal_releases.h"
#include "src/base/mathx.h"

typedef struct {
  const sv_mrcal_problem *p;
  sv_boards_result *out;
  cholmod_common common;
  cholmod_factor *factor;
  int n_states;
  double *scale; // [n_states] full units per packed unit
  double sigma2; // px^2 a coordinate
} covariance;

static int state_intrinsics(const covariance *v, int c) {
  const sv_mrcal_problem *p = v->p;
  return mrcal_state_index_intrinsics(c, p->b->n_cameras, p->b->n_cameras - 1, p->n_frames, 0, 0,
                                      p->n_observations, p->sel, &p->lens);
}

static int state_camera(const covariance *v, int c) { // c > 0
  const sv_mrcal_problem *p = v->p;
  return mrcal_state_index_extrinsics(c - 1, p->b->n_cameras, p->b->n_cameras - 1, p->n_frames, 0, 0,
                                      p->n_observations, p->sel, &p->lens);
}

static int state_frame(const covariance *v, int f) {
  const sv_mrcal_problem *p = v->p;
  return mrcal_state_index_frames(f, p->b->n_cameras, p->b->n_cameras - 1, p->n_frames, 0, 0,
                                  p->n_observations, p->sel, &p->lens);
}

static bool factor(covariance *v) {
  const sv_mrcal_problem *p = v->p;
  const sv_boards *b = p->b;
  int n_x = sv_mrcal_n_measurements(p, p->sel), n = v->n_states;
  mrcal_problem_constants_t constants = {.point_min_range = 1e-6, .point_max_range = 1e6};
  int nnz = _mrcal_num_j_nonzero(p->n_observations, 0, b->n_cols, b->n_rows, b->n_cameras, b->n_cameras - 1,
                                 p->n_frames, 0, 0, p->observations, NULL, p->sel, &p->lens);
  cholmod_sparse *jt =
      cholmod_allocate_sparse((size_t)n, (size_t)n_x, (size_t)nnz, 1, 1, 0, CHOLMOD_REAL, &v->common);
  double *packed = calloc((size_t)n, sizeof(double)), *x = calloc((size_t)n_x, sizeof(double));
  bool is_good = jt && packed && x &&
                 mrcal_optimizer_callback(packed, n * (int)sizeof(double), x, n_x * (int)sizeof(double), jt,
                                          p->intrinsics, p->extrinsics, p->frames, NULL, &p->warp,
                                          b->n_cameras, b->n_cameras - 1, p->n_frames, 0, 0, p->observations,
                                          NULL, p->n_observations, 0, p->pool, &p->lens, &b->size_px[0][0],
                                          p->sel, &constants, b->spacing_m, b->n_cols, b->n_rows, false);
  if (is_good) v->factor = cholmod_analyze(jt, &v->common); // stype 0: of J^T J
  is_good =
      is_good && v->factor && cholmod_factorize(jt, v->factor, &v->common) && v->common.status == CHOLMOD_OK;
  cholmod_free_sparse(&jt, &v->common);
  free(packed);
  free(x);
  return is_good;
}

// rows[n_rows][n_states], derivatives by the state in full units (packed by this call) -> their
// covariance [n_rows][n_rows]. False without memory.
static bool covariance_of(covariance *v, double *rows, int n_rows, double *out) {
  size_t n = (size_t)v->n_states;
  for (int r = 0; r < n_rows; r++)
    for (size_t k = 0; k < n; k++) rows[(size_t)r * n + k] *= v->scale[k];
  cholmod_dense rhs = {.nrow = n,
                       .ncol = (size_t)n_rows,
                       .nzmax = n * (size_t)n_rows,
                       .d = n,
                       .x = rows,
                       .xtype = CHOLMOD_REAL,
                       .dtype = CHOLMOD_DOUBLE};
  cholmod_dense *solved = cholmod_solve(CHOLMOD_A, v->factor, &rhs, &v->common);
  if (!solved) return false;
  const double *s = solved->x;
  for (int i = 0; i < n_rows; i++)
    for (int j = 0; j < n_rows; j++) {
      double sum = 0;
      for (size_t k = 0; k < n; k++) sum += rows[(size_t)i * n + k] * s[(size_t)j * n + k];
      out[i * n_rows + j] = sum * v->sigma2;
    }
  cholmod_free_dense(&solved, &v->common);
  return true;
}

// One coordinate's deviation, as the root of a trace over n states from `first`.
static double deviation(covariance *v, int first, int n, double *rows) {
  double out[9], trace = 0;
  memset(rows, 0, 3 * (size_t)v->n_states * sizeof *rows);
  for (int k = 0; k < n; k++) rows[k * v->n_states + first + k] = 1;
  if (!covariance_of(v, rows, n, out)) return NAN;
  for (int k = 0; k < n; k++) trace += out[k * n + k];
  return sqrt(trace > 0 ? trace : 0);
}

// d(R(w + d) R(w)^-1 v) / dd, by central differences: [3][3]
static void d_rotated(double out[9], const double w_rad[3], const double v[3]) {
  const double h = 1e-6;
  double r0[9], back[9];
  sv_rodrigues(r0, w_rad);
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++) back[3 * i + j] = r0[3 * j + i];
  for (int k = 0; k < 3; k++) {
    double at[2][3], base[3];
    sv_apply33(base, back, v);
    for (int s = 0; s < 2; s++) {
      double w[3] = {w_rad[0], w_rad[1], w_rad[2]}, r[9];
      w[k] += s ? h : -h;
      sv_rodrigues(r, w);
      sv_apply33(at[s], r, base);
    }
    for (int i = 0; i < 3; i++) out[3 * i + k] = (at[1][i] - at[0][i]) / (2 * h);
  }
}

static void add_row_block(double *row, const double dq[3], const double d[9], double weight) {
  for (int k = 0; k < 3; k++)
    for (int i = 0; i < 3; i++) row[k] += weight * dq[i] * d[3 * i + k];
}

// By the control points of a splined lens.
static void add_control_points(const covariance *v, int c, const double ray[3], int axis, double *row) {
  const sv_camera_model *m = &v->out->models[c];
  const int n = m->spline.order + 1;
  double weight[16];
  int i0[2];
  if (!sv_spline_weights(m, ray, i0, weight)) return;
  for (int k = 0; k < n * n; k++)
    row[state_intrinsics(v, c) + 2 * ((i0[1] + k / n) * m->spline.nx + i0[0] + k % n) + axis] =
        m->p[axis] * weight[k];
}

// Derivatives of the projection of a direction (camera c) by the state: rows[2][n_states].
static bool projection_rows(const covariance *v, int c, const double uv[2], double *rows) {
  const sv_mrcal_problem *p = v->p;
  const sv_camera_model *m = &v->out->models[c];
  double ray[3], q[2], dx[6], dp[2 * SV_CAP_MODEL_PARAMS], d[9], in_rig[3];
  if (!sv_model_unproject(m, uv, ray) || !sv_model_project(m, ray, q, dx, dp)) return false;
  size_t n = (size_t)v->n_states;
  memset(rows, 0, 3 * n * sizeof *rows);
  const double *rc = v->out->cam_from_rig[c].r;
  for (int i = 0; i < 3; i++) in_rig[i] = rc[i] * ray[0] + rc[3 + i] * ray[1] + rc[6 + i] * ray[2];
  for (int a = 0; a < 2; a++) {
    double *row = rows + (size_t)a * n;
    if (m->kind == SV_MODEL_SPLINED) add_control_points(v, c, ray, a, row);
    else
      for (int k = 0; k < p->n_params; k++) row[state_intrinsics(v, c) + k] = dp[a * p->n_params + k];
    if (c > 0) {
      d_rotated(d, p->extrinsics[c - 1].r.xyz, ray);
      add_row_block(row + state_camera(v, c), dx + 3 * a, d, 1);
    }
    double in_dx[3] = {0}; // the derivative by the direction in the rig's frame
    for (int i = 0; i < 3; i++)
      for (int j = 0; j < 3; j++) in_dx[j] += dx[3 * a + i] * rc[3 * i + j];
    for (int f = 0; f < p->n_frames; f++) {
      d_rotated(d, p->frames[f].r.xyz, in_rig);
      add_row_block(row + state_frame(v, f), in_dx, d, 1.0 / p->n_frames);
    }
  }
  return true;
}

static void fill_grid(covariance *v, int c, double *rows) {
  const sv_camera_model *m = &v->out->models[c];
  for (int j = 0; j < SV_BOARDS_GRID_Y; j++)
    for (int i = 0; i < SV_BOARDS_GRID_X; i++) {
      double uv[2] = {m->width_px * (i + 0.5) / SV_BOARDS_GRID_X,
                      m->height_px * (j + 0.5) / SV_BOARDS_GRID_Y};
      double s[4], *out = &v->out->cameras[c].uncertainty_px[j][i];
      *out = NAN;
      if (!projection_rows(v, c, uv, rows) || !covariance_of(v, rows, 2, s)) continue;
      double mean = 0.5 * (s[0] + s[3]), half = 0.5 * (s[0] - s[3]);
      *out = sqrt(mean + sqrt(half * half + s[1] * s[2])); // the larger eigenvalue
    }
}

sv_status sv_boards_uncertainty(sv_boards_result *out, const sv_mrcal_problem *p, sv_err *err) {
  const sv_boards *b = p->b;
  covariance v = {.p = p, .out = out};
  v.n_states = mrcal_num_states(b->n_cameras, b->n_cameras - 1, p->n_frames, 0, 0, p->n_observations, p->sel,
                                &p->lens);
  double dof = 2.0 * out->n_points - v.n_states;
  v.sigma2 = dof > 1 ? out->rms_px * out->rms_px * out->n_points / dof : out->rms_px * out->rms_px;
  v.scale = malloc((size_t)v.n_states * sizeof(double));
  double *rows = malloc(3 * (size_t)v.n_states * sizeof(double));
  cholmod_start(&v.common);
  v.common.print = 0;
  bool is_good = v.scale && rows;
  for (int k = 0; k < v.n_states && is_good; k++) v.scale[k] = 1;
  if (is_good) sv_mrcal_unpack(p, v.scale);
  is_good = is_good && factor(&v);
  for (int c = 0; c < b->n_cameras && is_good; c++) {
    sv_boards_camera *q = &out->cameras[c];
    if (b->model != SV_MODEL_SPLINED) q->fx_sd_px = deviation(&v, state_intrinsics(&v, c), 1, rows);
    if (c) {
      q->rotation_sd_deg = deviation(&v, state_camera(&v, c), 3, rows) * 180 / SV_PI;
      q->translation_sd_m = deviation(&v, state_camera(&v, c) + 3, 3, rows);
    }
    fill_grid(&v, c, rows);
  }
  if (v.factor) cholmod_free_factor(&v.factor, &v.common);
  cholmod_finish(&v.common);
  free(v.scale);
  free(rows);
  return is_good ? SV_OK
                 : sv_fail(err, SV_E_FORMAT,
                           "these images do not constrain the calibration (its normal equations are "
                           "singular): take more, with the board tilted and in all parts of the image");
}
