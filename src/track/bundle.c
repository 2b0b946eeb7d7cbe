// SPDX-License-Identifier: Apache-2.0
#include "src/track/bundle.h"

#include <string.h>

#include "src/base/cholesky.h"
#include "src/base/mathx.h"
#include "src/port/heartbeat.h"
#include "src/rig/shutter.h"

#define NEAR_Z       1e-3  // m; nearer points do not project
#define BEHIND_PX    100.0 // cost of an observation whose point lies behind the camera
#define LAMBDA_START 1e-4
#define LAMBDA_MAX   1e8
#define ENOUGH       1e-6 // relative decrease of the cost that ends the iteration

// --- memory --------------------------------------------------------------------------------------

sv_status sv_bundle_init(sv_bundle *b, const sv_bundle_cfg *cfg, sv_arena *a) {
  memset(b, 0, sizeof *b);
  b->cfg = *cfg;
  size_t n_cameras = (size_t)cfg->cap_cameras, n_blocks = (size_t)cfg->cap_poses + 2 * n_cameras;
  size_t n = 6 * ((size_t)cfg->cap_poses + (cfg->has_extrinsics ? n_cameras : 0) +
                  (cfg->has_lenses ? n_cameras : 0));
  b->pose = SV_TAKE(a, sv_pose, cfg->cap_poses);
  b->pose_kept = SV_TAKE(a, sv_pose, cfg->cap_poses);
  b->beside = sv_arena_take(a, (size_t)cfg->cap_poses, sizeof *b->beside);
  b->slope = sv_arena_take(a, (size_t)cfg->cap_poses, sizeof *b->slope);
  b->motion = sv_arena_take(a, (size_t)cfg->cap_poses, sizeof *b->motion);
  b->is_fixed = SV_TAKE(a, bool, cfg->cap_poses);
  b->camera = SV_TAKE(a, sv_bundle_camera, cfg->cap_cameras);
  b->calibrated = SV_TAKE(a, sv_pose, cfg->cap_cameras);
  b->cam_kept = SV_TAKE(a, sv_bundle_camera, cfg->cap_cameras);
  b->given = SV_TAKE(a, sv_bundle_camera, cfg->cap_cameras);
  b->is_lens_free = SV_TAKE(a, bool, cfg->cap_cameras);
  b->point = sv_arena_take(a, (size_t)cfg->cap_points, sizeof *b->point);
  b->point_kept = sv_arena_take(a, (size_t)cfg->cap_points, sizeof *b->point);
  b->point_step = sv_arena_take(a, (size_t)cfg->cap_points, sizeof *b->point);
  b->first = SV_TAKE(a, int, cfg->cap_points + 1);
  b->obs = SV_TAKE(a, sv_bundle_obs, cfg->cap_obs);
  b->s = SV_TAKE(a, double, n *n);
  b->g = SV_TAKE(a, double, n);
  b->step = SV_TAKE(a, double, n);
  b->block_of = SV_TAKE(a, int, n_blocks);
  b->is_seen = SV_TAKE(a, int, n_blocks);
  b->in_use = SV_TAKE(a, int, n_blocks);
  b->w = sv_arena_take(a, n_blocks, sizeof *b->w);
  for (int i = 0; b->slope && b->beside && i < cfg->cap_poses; i++) {
    b->beside[i][0] = b->beside[i][1] = -1;
    b->slope[i][0] = b->slope[i][1] = 0;
  }
  return a->status;
}

// --- one observation -----------------------------------------------------------------------------

void sv_pose_twist(sv_pose *p, const double twist[6]) {
  double r[9], q[4];
  sv_rodrigues(r, twist);
  sv_mul33(p->r, r, p->r);
  sv_quat_from_mat(q, p->r); // through a quaternion, so that rounding does not accumulate
  sv_quat_to_mat(p->r, q);
  sv_apply33(p->t, r, p->t);
  for (int i = 0; i < 3; i++) p->t[i] += twist[3 + i];
}

// out[2][6] = j[2][3] [-[x]_x | I]: derivative of pixels by a left twist of the frame of x.
static void by_twist(const double j[6], const double x[3], double *out) {
  for (int i = 0; i < 2; i++) {
    const double *a = j + 3 * i;
    out[6 * i] = a[2] * x[1] - a[1] * x[2];
    out[6 * i + 1] = a[0] * x[2] - a[2] * x[0];
    out[6 * i + 2] = a[1] * x[0] - a[0] * x[1];
    for (int k = 0; k < 3; k++) out[6 * i + 3 + k] = a[k];
  }
}

static void mul23(const double j[6], const double r[9], double out[6]) {
  for (int i = 0; i < 2; i++)
    for (int k = 0; k < 3; k++)
      out[3 * i + k] = j[3 * i] * r[k] + j[3 * i + 1] * r[3 + k] + j[3 * i + 2] * r[6 + k];
}

bool sv_bundle_residual(const sv_bundle *b, const sv_bundle_obs *obs, const double x[3], double r[2],
                        sv_bundle_jacobian *j) {
  const sv_pose *rig = &b->pose[obs->i_pose];
  const sv_bundle_camera *c = &b->camera[obs->i_camera];
  double x_rig[3], at[3], q[3], turn[9];
  sv_pose_apply(x_rig, rig, x);
  memcpy(at, x_rig, sizeof at);
  if (obs->row_s != 0) sv_motion_apply(at, b->motion[obs->i_pose], (double)obs->row_s, x_rig, turn);
  sv_pose_apply(q, &c->cam_from_rig, at);
  if (!(q[2] > NEAR_Z)) return false;
  double iz = 1 / q[2], u = q[0] * iz, v = q[1] * iz;
  r[0] = c->fx * u + c->cx - (double)obs->uv_px[0];
  r[1] = c->fy * v + c->cy - (double)obs->uv_px[1];
  if (!j) return true;
  double j_cam[6] = {c->fx * iz, 0, -c->fx * u * iz, 0, c->fy * iz, -c->fy * v * iz}, j_rig[6], j_row[6];
  by_twist(j_cam, q, j->camera);
  memset(j->lens, 0, sizeof j->lens);
  j->lens[0] = c->fx * u;
  j->lens[6 + 1] = c->fy * v;
  j->lens[2] = j->lens[6 + 3] = 1;
  mul23(j_cam, c->cam_from_rig.r, j_rig);
  if (obs->row_s != 0) mul23(j_rig, turn, j_row);
  else memcpy(j_row, j_rig, sizeof j_row);
  by_twist(j_row, x_rig, j->pose);
  mul23(j_row, rig->r, j->point);
  return true;
}

// Huber's weight of a residual of so many standard deviations, and its loss.
static double huber(double r2, double k, double *loss) {
  if (r2 <= k * k) {
    *loss = 0.5 * r2;
    return 1;
  }
  double r = sqrt(r2);
  *loss = k * (r - 0.5 * k);
  return k / r;
}

// --- cost ----------------------------------------------------------------------------------------

// Deviation of a camera from its calibration, as a twist in standard deviations.
static void off_calibration(const sv_bundle *b, const sv_bundle_options *o, int i, double e[6]) {
  sv_pose inv = sv_pose_inv(&b->calibrated[i]), d = sv_pose_mul(&b->camera[i].cam_from_rig, &inv);
  sv_rodrigues_inv(e, d.r);
  for (int k = 0; k < 3; k++) {
    e[k] /= o->sigma_rot_rad;
    e[3 + k] = d.t[k] / o->sigma_trans_m;
  }
}

// Deviation of a lens from what was given, in standard deviations.
static void off_lens(const sv_bundle *b, const sv_bundle_options *o, int i, double e[4]) {
  const sv_bundle_camera *c = &b->camera[i], *g = &b->given[i];
  e[0] = sv_log(c->fx / g->fx) / o->sigma_focal;
  e[1] = sv_log(c->fy / g->fy) / o->sigma_focal;
  e[2] = (c->cx - g->cx) / (o->sigma_centre * g->fx);
  e[3] = (c->cy - g->cy) / (o->sigma_centre * g->fy);
}

double sv_bundle_cost(const sv_bundle *b, const sv_bundle_options *o) {
  double sum = 0, e[6];
  for (int i = 0; i < b->n_points; i++)
    for (int k = b->first[i]; k < b->first[i + 1]; k++) {
      const sv_bundle_obs *obs = &b->obs[k];
      double r[2], loss, w2 = (double)obs->weight * (double)obs->weight;
      if (w2 == 0) continue;
      double r2 = sv_bundle_residual(b, obs, b->point[i], r, NULL) ? w2 * (r[0] * r[0] + r[1] * r[1])
                                                                   : BEHIND_PX * BEHIND_PX;
      (void)huber(r2, o->huber_px, &loss);
      sum += loss;
    }
  for (int i = 1; o->is_extrinsics && i < b->n_cameras; i++) {
    off_calibration(b, o, i, e);
    for (int k = 0; k < 6; k++) sum += 0.5 * e[k] * e[k];
  }
  for (int i = 0; o->is_lenses && i < b->n_cameras; i++) {
    if (!b->is_lens_free[i]) continue;
    off_lens(b, o, i, e);
    for (int k = 0; k < 4; k++) sum += 0.5 * e[k] * e[k];
  }
  return sum;
}

// --- the reduced system --------------------------------------------------------------------------

static void number_blocks(sv_bundle *b, const sv_bundle_options *o) {
  int n = 0;
  for (int i = 0; i < b->n_poses; i++) b->block_of[i] = b->is_fixed[i] ? -1 : n++;
  for (int i = 0; i < b->n_cameras; i++)
    b->block_of[b->n_poses + i] = o->is_extrinsics && b->cfg.has_extrinsics && i > 0 ? n++ : -1;
  for (int i = 0; i < b->n_cameras; i++)
    b->block_of[b->n_poses + b->n_cameras + i] =
        o->is_lenses && b->cfg.has_lenses && b->is_lens_free[i] ? n++ : -1;
  b->n_params = 6 * n;
}

// s[bi][bj] += k a^T c for 2x6 a, c; only the lower triangle is kept.
static void add_pair(sv_bundle *b, int bi, int bj, double k, const double *a, const double *c) {
  if (bi < bj) {
    int t = bi;
    const double *p = a;
    bi = bj;
    bj = t;
    a = c;
    c = p;
  }
  for (int i = 0; i < 6; i++) {
    double *row = b->s + (size_t)(6 * bi + i) * (size_t)b->n_params + 6 * bj;
    for (int j = 0; j < 6; j++) row[j] += k * (a[i] * c[j] + a[6 + i] * c[6 + j]);
  }
}

typedef struct {
  double v[6], gx[3]; // xx xy xz yy yz zz of the point's block; its gradient
  int n_local;        // blocks the point is seen from
} point_sums;

// A residual of the point with its weight.
typedef struct {
  double k, r[2];
  sv_bundle_jacobian j;
} weighted_residual;

// Adds a residual to the block of a pose or a camera, by which its derivatives are j.
static void add_block(sv_bundle *b, point_sums *p, int block, const weighted_residual *o, const double *j,
                      bool is_full) {
  const double k = o->k, *jx = o->j.point, *r = o->r;
  int at = -1;
  for (int i = 0; i < p->n_local && at < 0; i++)
    if (b->in_use[i] == block) at = i;
  if (at < 0) {
    at = p->n_local++;
    b->in_use[at] = block;
    memset(b->w[at], 0, sizeof b->w[at]);
  }
  for (int i = 0; i < 6; i++)
    for (int c = 0; c < 3; c++) b->w[at][3 * i + c] += k * (j[i] * jx[c] + j[6 + i] * jx[3 + c]);
  if (!is_full) return;
  for (int i = 0; i < 6; i++) b->g[6 * block + i] += k * (j[i] * r[0] + j[6 + i] * r[1]);
  add_pair(b, block, block, k, j, j);
}

// The free blocks that an observation depends on, and the derivatives by each: poses (a row is seen
// from between its pose and those from which the motion comes), the camera and its lens.
typedef struct {
  int n, block[5];
  double j[5][12];
} free_blocks;

// at: index in block_of, below 0: none.
static void add_free(const sv_bundle *b, int at, double share, const double j[12], free_blocks *out) {
  const int block = at < 0 ? -1 : b->block_of[at];
  if (block < 0 || share == 0) return;
  out->block[out->n] = block;
  for (int i = 0; i < 12; i++) out->j[out->n][i] = share * j[i];
  out->n++;
}

static void find_free(const sv_bundle *b, const sv_bundle_obs *obs, const sv_bundle_jacobian *j,
                      free_blocks *out) {
  const double s = (double)obs->row_s;
  const int i = obs->i_pose;
  out->n = 0;
  add_free(b, i, s != 0 ? 1 - s * (b->slope[i][0] + b->slope[i][1]) : 1, j->pose, out);
  for (int k = 0; k < 2 && s != 0; k++) add_free(b, b->beside[i][k], s * b->slope[i][k], j->pose, out);
  add_free(b, b->n_poses + obs->i_camera, 1, j->camera, out);
  add_free(b, b->n_poses + b->n_cameras + obs->i_camera, 1, j->lens, out);
}

// Adds up the blocks of one point; with is_full those of poses and cameras go into s and g.
static void sum_point(sv_bundle *b, const sv_bundle_options *o, int i, point_sums *p, bool is_full) {
  memset(p, 0, sizeof *p);
  for (int n = b->first[i]; n < b->first[i + 1]; n++) {
    const sv_bundle_obs *obs = &b->obs[n];
    weighted_residual w;
    const double *r = w.r, *jx = w.j.point;
    double loss, w2 = (double)obs->weight * (double)obs->weight;
    if (w2 == 0 || !sv_bundle_residual(b, obs, b->point[i], w.r, &w.j)) continue;
    w.k = w2 * huber(w2 * (r[0] * r[0] + r[1] * r[1]), o->huber_px, &loss);
    free_blocks f;
    find_free(b, obs, &w.j, &f);
    int at = 0;
    for (int c = 0; c < 3; c++) {
      p->gx[c] += w.k * (jx[c] * r[0] + jx[3 + c] * r[1]);
      for (int d = c; d < 3; d++) p->v[at++] += w.k * (jx[c] * jx[d] + jx[3 + c] * jx[3 + d]);
    }
    for (int m = 0; m < f.n; m++) add_block(b, p, f.block[m], &w, f.j[m], is_full);
    for (int m = 0; m < f.n && is_full; m++)
      for (int other = 0; other < m; other++)
        add_pair(b, f.block[m], f.block[other], w.k, f.j[m], f.j[other]);
  }
}

// Inverse of the damped symmetric 3x3 block. False when it is nearly singular: the point then stays
// fixed.
static bool invert(const double v[6], double lambda, double out[6]) {
  double a = v[0] * (1 + lambda), b = v[1], c = v[2], d = v[3] * (1 + lambda), e = v[4],
         f = v[5] * (1 + lambda);
  double c0 = d * f - e * e, c1 = c * e - b * f, c2 = b * e - c * d, det = a * c0 + b * c1 + c * c2;
  if (!(det > 1e-12 * a * d * f) || !(a > 0)) return false;
  out[0] = c0 / det;
  out[1] = c1 / det;
  out[2] = c2 / det;
  out[3] = (a * f - c * c) / det;
  out[4] = (b * c - a * e) / det;
  out[5] = (a * d - b * b) / det;
  return true;
}

static void mul_sym(const double s[6], const double x[3], double out[3]) {
  out[0] = s[0] * x[0] + s[1] * x[1] + s[2] * x[2];
  out[1] = s[1] * x[0] + s[3] * x[1] + s[4] * x[2];
  out[2] = s[2] * x[0] + s[4] * x[1] + s[5] * x[2];
}

// Eliminates the point: s -= w v^-1 w^T, g -= w v^-1 gx.
static void eliminate(sv_bundle *b, const point_sums *p, const double vi[6]) {
  double y[18], z[3];
  mul_sym(vi, p->gx, z);
  for (int m = 0; m < p->n_local; m++) {
    int bi = b->in_use[m];
    for (int i = 0; i < 6; i++) {
      mul_sym(vi, &b->w[m][3 * i], &y[3 * i]);
      b->g[6 * bi + i] -= sv_dot3(&b->w[m][3 * i], z);
    }
    for (int n = 0; n < p->n_local; n++) {
      int bj = b->in_use[n];
      if (bj > bi) continue;
      for (int i = 0; i < 6; i++) {
        double *row = b->s + (size_t)(6 * bi + i) * (size_t)b->n_params + 6 * bj;
        for (int j = 0; j < 6; j++) row[j] -= sv_dot3(&y[3 * i], &b->w[n][3 * j]);
      }
    }
  }
}

static void add_priors(sv_bundle *b, const sv_bundle_options *o) {
  for (int i = 1; i < b->n_cameras; i++) {
    int block = b->block_of[b->n_poses + i];
    double e[6];
    if (block < 0) continue;
    off_calibration(b, o, i, e);
    for (int k = 0; k < 6; k++) {
      double sigma = k < 3 ? o->sigma_rot_rad : o->sigma_trans_m;
      size_t at = (size_t)(6 * block + k);
      b->s[at * (size_t)b->n_params + at] += 1 / (sigma * sigma);
      b->g[at] += e[k] / sigma;
    }
  }
  for (int i = 0; i < b->n_cameras; i++) {
    int block = b->block_of[b->n_poses + b->n_cameras + i];
    double e[4];
    if (block < 0) continue;
    off_lens(b, o, i, e);
    for (int k = 0; k < 4; k++) {
      double sigma = k < 2 ? o->sigma_focal : o->sigma_centre * (k < 3 ? b->given[i].fx : b->given[i].fy);
      size_t at = (size_t)(6 * block + k);
      b->s[at * (size_t)b->n_params + at] += 1 / (sigma * sigma);
      b->g[at] += e[k] / sigma;
    }
  }
}

// The whole reduced system, damped. Points that cannot be eliminated are skipped.
static void build(sv_bundle *b, const sv_bundle_options *o, double lambda) {
  size_t n = (size_t)b->n_params;
  point_sums p;
  double vi[6];
  memset(b->s, 0, n * n * sizeof *b->s);
  memset(b->g, 0, n * sizeof *b->g);
  for (int i = 0; i < b->n_points; i++) sum_point(b, o, i, &p, true);
  add_priors(b, o);
  for (size_t i = 0; i < n; i++) b->s[i * n + i] += lambda * b->s[i * n + i] + 1e-9;
  for (int i = 0; i < b->n_points; i++) {
    sum_point(b, o, i, &p, false);
    if (invert(p.v, lambda, vi)) eliminate(b, &p, vi);
  }
}

// --- solving -------------------------------------------------------------------------------------

static void step_points(sv_bundle *b, const sv_bundle_options *o, double lambda) {
  point_sums p;
  double vi[6];
  for (int i = 0; i < b->n_points; i++) {
    sum_point(b, o, i, &p, false);
    memset(b->point_step[i], 0, sizeof b->point_step[i]);
    if (!invert(p.v, lambda, vi)) continue;
    double rhs[3] = {-p.gx[0], -p.gx[1], -p.gx[2]};
    for (int m = 0; m < p.n_local; m++)
      for (int k = 0; k < 6; k++)
        for (int c = 0; c < 3; c++) rhs[c] -= b->w[m][3 * k + c] * b->step[6 * b->in_use[m] + k];
    mul_sym(vi, rhs, b->point_step[i]);
  }
}

bool sv_bundle_linear_step(sv_bundle *b, const sv_bundle_options *o, double lambda) {
  number_blocks(b, o);
  build(b, o, lambda);
  if (!sv_cholesky(b->s, b->n_params)) return false;
  for (int i = 0; i < b->n_params; i++) b->step[i] = -b->g[i];
  sv_cholesky_solve(b->s, b->n_params, b->step);
  step_points(b, o, lambda);
  return true;
}

static void find_motion(sv_bundle *b) {
  for (int i = 0; i < b->n_poses; i++) {
    const int *k = b->beside[i];
    sv_motion_from(b->motion[i], b->slope[i], &b->pose[i], &b->pose[k[0] < 0 ? i : k[0]],
                   &b->pose[k[1] < 0 ? i : k[1]]);
  }
}

static void apply_step(sv_bundle *b) {
  for (int i = 0; i < b->n_poses; i++)
    if (b->block_of[i] >= 0) sv_pose_twist(&b->pose[i], b->step + 6 * b->block_of[i]);
  for (int i = 0; i < b->n_cameras; i++)
    if (b->block_of[b->n_poses + i] >= 0)
      sv_pose_twist(&b->camera[i].cam_from_rig, b->step + 6 * b->block_of[b->n_poses + i]);
  for (int i = 0; i < b->n_cameras; i++) {
    int block = b->block_of[b->n_poses + b->n_cameras + i];
    if (block < 0) continue;
    sv_bundle_camera *c = &b->camera[i];
    const double *d = b->step + 6 * block;
    c->fx *= sv_exp(d[0]);
    c->fy *= sv_exp(d[1]);
    c->cx += d[2];
    c->cy += d[3];
  }
  for (int i = 0; i < b->n_points; i++)
    for (int k = 0; k < 3; k++) b->point[i][k] += b->point_step[i][k];
  find_motion(b);
}

static void keep(sv_bundle *b, bool is_back) {
  size_t n_p = (size_t)b->n_poses * sizeof *b->pose, n_x = (size_t)b->n_points * sizeof *b->point;
  memcpy(is_back ? b->pose : b->pose_kept, is_back ? b->pose_kept : b->pose, n_p);
  memcpy(is_back ? b->point : b->point_kept, is_back ? b->point_kept : b->point, n_x);
  memcpy(is_back ? b->camera : b->cam_kept, is_back ? b->cam_kept : b->camera,
         (size_t)b->n_cameras * sizeof *b->camera);
  if (is_back) find_motion(b);
}

static void measure(const sv_bundle *b, sv_bundle_result *out) {
  double sum = 0;
  out->n_obs = 0;
  for (int i = 0; i < b->n_points; i++)
    for (int k = b->first[i]; k < b->first[i + 1]; k++) {
      double r[2];
      if (b->obs[k].weight == 0 || !sv_bundle_residual(b, &b->obs[k], b->point[i], r, NULL)) continue;
      sum += r[0] * r[0] + r[1] * r[1];
      out->n_obs++;
    }
  out->rms_px = out->n_obs ? sqrt(sum / (2.0 * out->n_obs)) : 0;
}

sv_status sv_bundle_solve(sv_bundle *b, const sv_bundle_options *o, sv_bundle_result *out) {
  bool has_fixed = false;
  memset(out, 0, sizeof *out);
  for (int i = 0; i < b->n_poses; i++) has_fixed |= b->is_fixed[i];
  memcpy(b->given, b->camera, (size_t)b->n_cameras * sizeof *b->given);
  number_blocks(b, o);
  if (!has_fixed || (!b->n_params && !b->n_points)) return SV_E_ARG;
  find_motion(b);
  double cost = out->cost_before = sv_bundle_cost(b, o);
  b->lambda = LAMBDA_START;
  while (out->n_iterations < o->max_iterations && b->lambda < LAMBDA_MAX) {
    out->n_iterations++;
    sv_beat(o->heartbeats, SV_BEAT_MAIN);
    keep(b, false);
    if (!sv_bundle_linear_step(b, o, b->lambda)) {
      b->lambda *= 10;
      continue;
    }
    apply_step(b);
    double after = sv_bundle_cost(b, o);
    if (!(after < cost)) { // also when it is NaN
      keep(b, true);
      b->lambda *= 10;
      continue;
    }
    b->lambda = b->lambda > 1e-9 ? 0.2 * b->lambda : b->lambda;
    bool is_done = cost - after < ENOUGH * cost;
    cost = after;
    if (is_done) break;
  }
  out->cost = cost;
  measure(b, out);
  return SV_OK;
}

double sv_bundle_scale_sigma(sv_bundle *b, const sv_bundle_options *o) {
  sv_bundle_result m;
  double mean[3] = {0}, spread = 0, c[3], e[3], var = 0;
  int *is_seen = b->is_seen, n_seen = 0; // poses without observations do not count
  number_blocks(b, o);
  memset(is_seen, 0, (size_t)b->n_poses * sizeof *is_seen);
  for (int i = 0; i < b->first[b->n_points]; i++)
    if (b->obs[i].weight != 0) is_seen[b->obs[i].i_pose] = 1;
  for (int i = 0; i < b->n_poses; i++) n_seen += is_seen[i];
  for (int i = 0; i < b->n_poses; i++) {
    if (!is_seen[i]) continue;
    sv_pose_centre(c, &b->pose[i]);
    for (int k = 0; k < 3; k++) mean[k] += c[k] / n_seen;
  }
  for (int i = 0; i < b->n_poses; i++) {
    if (!is_seen[i]) continue;
    sv_pose_centre(c, &b->pose[i]);
    sv_sub3(e, c, mean);
    spread += sv_dot3(e, e);
  }
  find_motion(b);
  build(b, o, 0);
  if (!(spread > 0) || !sv_cholesky(b->s, b->n_params)) return -1;
  // d log(size) by the twists: a position moves by -R^T v and is invariant to rotation.
  memset(b->step, 0, (size_t)b->n_params * sizeof *b->step);
  for (int i = 0; i < b->n_poses; i++) {
    if (b->block_of[i] < 0 || !is_seen[i]) continue;
    sv_pose_centre(c, &b->pose[i]);
    sv_sub3(e, c, mean);
    sv_apply33(e, b->pose[i].r, e);
    for (int k = 0; k < 3; k++) b->step[6 * b->block_of[i] + 3 + k] = -e[k] / spread;
  }
  memcpy(b->g, b->step, (size_t)b->n_params * sizeof *b->step);
  sv_cholesky_solve(b->s, b->n_params, b->step);
  for (int i = 0; i < b->n_params; i++) var += b->g[i] * b->step[i];
  measure(b, &m);
  return var >= 0 ? sqrt(var) * m.rms_px : -1;
}
