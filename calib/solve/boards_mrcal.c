// SPDX-License-Identifier: Apache-2.0
#include <math.h>
#include <mrcal/mrcal.h>
#include <stdlib.h>
#include <string.h>

#include "calib/solve/boards.h"
#include "calib/solve/boards_mrcal.h"

#define OUTLIER_SIGMAS 4.0 // of the residuals' own deviation
#define CAP_ROUNDS     8   // of rejection
#define MIN_TILT_DEG   12.0
#define MIN_BOARDS     3

sv_status sv_boards_available(sv_err *err) {
  (void)err;
  return SV_OK;
}

static bool is_splined(const sv_boards *b) { return b->model == SV_MODEL_SPLINED; }

static size_t n_corners(const sv_boards *b) { return (size_t)b->n_cols * (size_t)b->n_rows; }

static mrcal_pose_t to_rt(const sv_pose *p) {
  mrcal_pose_t out;
  sv_rodrigues_inv(out.r.xyz, p->r);
  for (int k = 0; k < 3; k++) out.t.xyz[k] = p->t[k];
  return out;
}

static sv_pose from_rt(const mrcal_pose_t *rt) {
  sv_pose p;
  sv_rodrigues(p.r, rt->r.xyz);
  for (int k = 0; k < 3; k++) p.t[k] = rt->t.xyz[k];
  return p;
}

// --- the problem in mrcal's terms ----------------------------------------------------------------
static void problem_free(sv_mrcal_problem *p) {
  free(p->intrinsics);
  free(p->extrinsics);
  free(p->frames);
  free(p->observations);
  free(p->pool);
  free(p->i_frame);
  free(p->x);
}

static sv_status problem_make(sv_mrcal_problem *p, const sv_boards *b, sv_err *err) {
  size_t nc = (size_t)b->n_cameras, nf = (size_t)b->n_frames;
  memset(p, 0, sizeof *p);
  p->b = b;
  mrcal_lensmodel_from_name(&p->lens, is_splined(b) ? "LENSMODEL_STEREOGRAPHIC" : sv_model_name(b->model));
  p->n_params = mrcal_lensmodel_num_params(&p->lens);
  p->intrinsics = calloc(nc * (size_t)p->n_params, sizeof(double));
  p->extrinsics = calloc(nc, sizeof(mrcal_pose_t));
  p->frames = calloc(nf, sizeof(mrcal_pose_t));
  p->observations = calloc(nc * nf, sizeof(mrcal_observation_board_t));
  p->pool = calloc(nc * nf * n_corners(b), sizeof(mrcal_point3_t));
  p->i_frame = calloc(nf, sizeof(int));
  if (!p->intrinsics || !p->extrinsics || !p->frames || !p->observations || !p->pool || !p->i_frame)
    return sv_fail(err, SV_E_NOMEM, "no memory for a calibration of %d cameras and %d frames", b->n_cameras,
                   b->n_frames);
  for (int f = 0; f < b->n_frames; f++) {
    p->i_frame[f] = -1;
    for (int c = 0; c < b->n_cameras; c++) {
      size_t at = (size_t)c * nf + (size_t)f;
      if (!b->is_seen[at]) continue;
      if (p->i_frame[f] < 0) p->i_frame[f] = p->n_frames++;
      p->observations[p->n_observations] =
          (mrcal_observation_board_t){.icam = {c, c - 1}, .iframe = p->i_frame[f]};
      mrcal_point3_t *out = p->pool + (size_t)p->n_observations++ * n_corners(b);
      for (size_t k = 0; k < n_corners(b); k++) // mrcal's pixel centers are at integers
        out[k] = (mrcal_point3_t){.x = b->uv_px[2 * (at * n_corners(b) + k)] - 0.5,
                                  .y = b->uv_px[2 * (at * n_corners(b) + k) + 1] - 0.5,
                                  .z = 1};
    }
  }
  return SV_OK;
}

int sv_mrcal_n_measurements(const sv_mrcal_problem *p, mrcal_problem_selections_t sel) {
  return mrcal_num_measurements(p->n_observations, 0, p->b->n_cols, p->b->n_rows, p->b->n_cameras,
                                p->b->n_cameras - 1, p->n_frames, 0, 0, sel, &p->lens);
}

static double solve(sv_mrcal_problem *p, mrcal_problem_selections_t sel) {
  const sv_boards *b = p->b;
  mrcal_problem_constants_t constants = {.point_min_range = 1e-6, .point_max_range = 1e6};
  int n = sv_mrcal_n_measurements(p, sel);
  free(p->x);
  p->x = calloc((size_t)n, sizeof(double));
  if (!p->x) return -1;
  mrcal_stats_t stats = mrcal_optimize(
      NULL, 0, p->x, n * (int)sizeof(double), p->intrinsics, p->extrinsics, p->frames, NULL, &p->warp,
      b->n_cameras, b->n_cameras - 1, p->n_frames, 0, 0, p->observations, NULL, p->n_observations, 0, p->pool,
      &p->lens, &b->size_px[0][0], sel, &constants, b->spacing_m, b->n_cols, b->n_rows, false, false);
  return stats.rms_reproj_error__pixels;
}

// --- outliers ------------------------------------------------------------------------------------
// Marks corners whose residual along an axis is beyond the limit; mrcal's own rule with the
// deviation of what is left in. Returns how many are new.
static int reject(sv_mrcal_problem *p) {
  size_t n = (size_t)p->n_observations * n_corners(p->b), n_in = 0;
  double sum = 0;
  for (size_t k = 0; k < n; k++)
    if (p->pool[k].z > 0) {
      sum += p->x[2 * k] * p->x[2 * k] + p->x[2 * k + 1] * p->x[2 * k + 1];
      n_in += 2;
    }
  double limit = n_in ? OUTLIER_SIGMAS * sqrt(sum / (double)n_in) : 0;
  int n_new = 0;
  for (size_t k = 0; k < n; k++)
    if (p->pool[k].z > 0 && (fabs(p->x[2 * k]) > limit || fabs(p->x[2 * k + 1]) > limit)) {
      p->pool[k].z = -1;
      n_new++;
    }
  return n_new;
}

static sv_status optimise(sv_mrcal_problem *p, sv_err *err) {
  const sv_boards *b = p->b;
  mrcal_problem_selections_t sel = {.do_optimize_extrinsics = b->n_cameras > 1, .do_optimize_frames = true};
  sv_status s = is_splined(b) ? sv_mrcal_make_splined(p, err) : SV_OK;
  if (s != SV_OK) return s;
  // the poses with the seeded lenses, then the lenses, then all they have
  double rms = solve(p, sel);
  // Of a spline, a free principal point could go far off, with the camera's rotation
  sel.do_optimize_intrinsics_core = !is_splined(b);
  if (rms >= 0 && !is_splined(b)) rms = solve(p, sel);
  sel.do_optimize_intrinsics_distortions = p->n_params > 4;
  sel.do_apply_regularization = true;
  if (rms >= 0) rms = solve(p, sel);
  sel.do_optimize_calobject_warp = b->has_warp;
  for (int round = 0; round < CAP_ROUNDS && rms >= 0; round++) {
    rms = solve(p, sel);
    // The tail of good corners is beyond the limit, too: a few new ones do not change the solution.
    if (rms < 0 || reject(p) * 1000 <= p->n_observations * (int)n_corners(b)) break;
  }
  p->sel = sel;
  if (!(rms >= 0)) return sv_fail(err, SV_E_FORMAT, "mrcal could not solve the calibration");
  return SV_OK;
}

// --- the result ----------------------------------------------------------------------------------
static sv_status result_make(sv_boards_result *r, const sv_boards *b, sv_err *err) {
  size_t nc = (size_t)b->n_cameras, nf = (size_t)b->n_frames;
  *r = (sv_boards_result){.n_cameras = b->n_cameras, .n_frames = b->n_frames, .n_corners = (int)n_corners(b)};
  r->models = calloc(nc, sizeof *r->models);
  r->cam_from_rig = calloc(nc, sizeof *r->cam_from_rig);
  r->rig_from_board = calloc(nf, sizeof *r->rig_from_board);
  r->residual_px = calloc(nc * nf * n_corners(b) * 2, sizeof(double));
  r->is_outlier = calloc(nc * nf * n_corners(b), 1);
  r->board_rms_px = calloc(nc * nf, sizeof(double));
  r->cameras = calloc(nc, sizeof *r->cameras);
  if (!r->models || !r->cam_from_rig || !r->rig_from_board || !r->residual_px || !r->is_outlier ||
      !r->board_rms_px || !r->cameras)
    return sv_fail(err, SV_E_NOMEM, "no memory for the result of a calibration");
  return SV_OK;
}

static sv_status take_solution(sv_boards_result *r, const sv_mrcal_problem *p, sv_err *err) {
  const sv_boards *b = p->b;
  sv_status s = SV_OK;
  for (int c = 0; c < b->n_cameras; c++) {
    sv_camera_model *m = &r->models[c];
    *m = (sv_camera_model){.kind = b->model, .width_px = b->size_px[c][0], .height_px = b->size_px[c][1]};
    for (int k = 0; k < sv_model_n_params(b->model); k++)
      m->p[k] = p->intrinsics[c * p->n_params + k] + (k == 2 || k == 3 ? 0.5 : 0);
    if (is_splined(b) && s == SV_OK) s = sv_mrcal_take_spline(p, c, m, err);
    r->cam_from_rig[c] = c ? from_rt(&p->extrinsics[c - 1]) : sv_pose_identity();
  }
  for (int f = 0; f < b->n_frames; f++)
    r->rig_from_board[f] = p->i_frame[f] < 0 ? sv_pose_identity() : from_rt(&p->frames[p->i_frame[f]]);
  if (b->has_warp) {
    r->warp_m[0] = p->warp.x2;
    r->warp_m[1] = p->warp.y2;
  }
  return s;
}

static void take_residuals(sv_boards_result *r, const sv_mrcal_problem *p) {
  const sv_boards *b = p->b;
  size_t n = n_corners(b), i = 0;
  double sum = 0;
  for (int f = 0; f < b->n_frames; f++)
    for (int c = 0; c < b->n_cameras; c++) {
      size_t at = (size_t)c * (size_t)b->n_frames + (size_t)f;
      double board = 0;
      int n_in = 0;
      if (!b->is_seen[at]) continue;
      for (size_t k = 0; k < n; k++, i++) {
        double *out = r->residual_px + 2 * (at * n + k), d2 = 0;
        for (int a = 0; a < 2; a++) {
          out[a] = p->x[2 * i + (size_t)a];
          d2 += out[a] * out[a];
        }
        if (p->pool[i].z > 0) {
          board += d2;
          n_in++;
        } else {
          r->is_outlier[at * n + k] = 1;
          r->cameras[c].n_outliers++;
        }
      }
      r->board_rms_px[at] = n_in ? sqrt(board / n_in) : 0;
      r->cameras[c].rms_px += board;
      sum += board;
      r->n_points += n_in;
    }
  for (int c = 0; c < b->n_cameras; c++) {
    sv_boards_camera *q = &r->cameras[c];
    int n_in = q->n_boards * (int)n - q->n_outliers;
    q->rms_px = n_in > 0 ? sqrt(q->rms_px / n_in) : 0;
    r->n_outliers += q->n_outliers;
  }
  r->rms_px = r->n_points ? sqrt(sum / r->n_points) : 0;
}

// An outlier's entry in x is 0: where it would lie is computed here.
static void fill_outliers(sv_boards_result *r, const sv_boards *b) {
  for (int c = 0; c < b->n_cameras; c++)
    for (int f = 0; f < b->n_frames; f++)
      for (size_t k = 0; k < n_corners(b); k++) {
        size_t at = ((size_t)c * (size_t)b->n_frames + (size_t)f) * n_corners(b) + k;
        double x[3], uv[2];
        if (!r->is_outlier[at]) continue;
        sv_boards_corner(x, b, r->warp_m, (int)k % b->n_cols, (int)k / b->n_cols);
        sv_pose_apply(x, &r->rig_from_board[f], x);
        sv_pose_apply(x, &r->cam_from_rig[c], x);
        if (!sv_model_project(&r->models[c], x, uv, NULL, NULL)) continue;
        for (int a = 0; a < 2; a++) r->residual_px[2 * at + (size_t)a] = uv[a] - b->uv_px[2 * at + (size_t)a];
      }
}

// --- what cannot be solved -----------------------------------------------------------------------
static sv_status check_views(const sv_boards *b, sv_boards_camera *cameras, const sv_pose *cam_from_board,
                             int c, sv_err *err) {
  sv_boards_measure(b, c, cam_from_board, &cameras[c]);
  if (cameras[c].tilt_deg < MIN_TILT_DEG)
    return sv_fail(err, SV_E_FORMAT,
                   "%s saw the board from almost a single direction (%.1f degrees between board normals, at "
                   "least %.0f needed): focal length and distance are ambiguous; tilt the board by 20 to 45 "
                   "degrees in all directions",
                   b->names[c], cameras[c].tilt_deg, MIN_TILT_DEG);
  return SV_OK;
}

static sv_status seed(const sv_boards *b, sv_mrcal_problem *p, sv_boards_result *r, sv_err *err) {
  sv_pose *poses = calloc((size_t)b->n_cameras * (size_t)b->n_frames, sizeof *poses);
  if (!poses) return sv_fail(err, SV_E_NOMEM, "no memory for board poses");
  sv_status s = SV_OK;
  for (int c = 0; c < b->n_cameras && s == SV_OK; c++) {
    double lens[5];
    int n = 0;
    for (int f = 0; f < b->n_frames; f++) n += b->is_seen[c * b->n_frames + f];
    if (n < MIN_BOARDS)
      s = sv_fail(err, SV_E_FORMAT,
                  "%s saw the whole board in %d images; at least %d are needed, 20 are good", b->names[c], n,
                  MIN_BOARDS);
    else if (!sv_boards_seed_camera(b, c, lens, poses + (size_t)c * (size_t)b->n_frames))
      s = sv_fail(
          err, SV_E_FORMAT,
          "%s: no lens model fits its corners: does the board have %dx%d inner corners, and is it flat?",
          b->names[c], b->n_cols, b->n_rows);
    else s = check_views(b, r->cameras, poses + (size_t)c * (size_t)b->n_frames, c, err);
    for (int k = 0; k < 5 && k < p->n_params && s == SV_OK; k++) p->intrinsics[c * p->n_params + k] = lens[k];
  }
  if (s == SV_OK) s = sv_boards_chain(b, poses, r->cam_from_rig, r->rig_from_board, err);
  free(poses);
  for (int c = 1; c < b->n_cameras && s == SV_OK; c++) p->extrinsics[c - 1] = to_rt(&r->cam_from_rig[c]);
  for (int f = 0; f < b->n_frames && s == SV_OK; f++)
    if (p->i_frame[f] >= 0) p->frames[p->i_frame[f]] = to_rt(&r->rig_from_board[f]);
  return s;
}

static sv_status check_fit(const sv_boards *b, const sv_boards_result *r, sv_err *err) {
  for (int c = 0; c < b->n_cameras; c++) {
    const double *p = r->models[c].p, *size = (double[2]){b->size_px[c][0], b->size_px[c][1]};
    bool is_sane = p[0] > 0 && p[1] > 0 && p[0] < 1e3 * size[0] && p[2] > -size[0] && p[2] < 2 * size[0] &&
                   p[3] > -size[1] && p[3] < 2 * size[1] && fabs(p[0] / p[1] - 1) < 0.5;
    if (!is_sane || !(r->cameras[c].rms_px < 0.02 * size[0]))
      return sv_fail(err, SV_E_FORMAT,
                     "%s does not fit: %.2f px RMS with focal length %.0f px; check that images with the "
                     "same number were taken at the same time and that the cameras are rigidly mounted",
                     b->names[c], r->cameras[c].rms_px, p[0]);
  }
  if (r->n_outliers > 3 * r->n_points / 10)
    return sv_fail(err, SV_E_FORMAT, "%d of %d corners were rejected as outliers: no calibration",
                   r->n_outliers, r->n_outliers + r->n_points);
  return SV_OK;
}

sv_status sv_boards_solve(const sv_boards *b, sv_boards_result *out, sv_err *err) {
  sv_mrcal_problem p;
  if (b->n_cameras < 1 || b->n_cameras > SV_BOARDS_CAP_CAMERAS || b->n_frames < 1 || b->n_cols < 3 ||
      b->n_rows < 3 || !(b->spacing_m > 0) || ((int)b->model > SV_MODEL_OPENCV8 && !is_splined(b)))
    return sv_fail(err, SV_E_ARG,
                   "not a calibration that can be solved: %d cameras, %d frames, %dx%d corners, %s",
                   b->n_cameras, b->n_frames, b->n_cols, b->n_rows, sv_model_name(b->model));
  sv_status s = problem_make(&p, b, err);
  if (s == SV_OK) s = result_make(out, b, err);
  else memset(out, 0, sizeof *out);
  if (s == SV_OK) s = seed(b, &p, out, err);
  if (s == SV_OK) s = optimise(&p, err);
  if (s == SV_OK) {
    s = take_solution(out, &p, err);
    take_residuals(out, &p);
    fill_outliers(out, b);
  }
  if (s == SV_OK) s = check_fit(b, out, err);
  if (s == SV_OK) s = sv_boards_uncertainty(out, &p, err);
  for (int c = 0; is_splined(b) && c < b->n_cameras && s == SV_OK; c++)
    s = sv_mrcal_refit_spline(b, out, c, err);
  problem_free(&p);
  if (s != SV_OK) sv_boards_free(out);
  return s;
}
