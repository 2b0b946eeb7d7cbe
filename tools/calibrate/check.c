// SPDX-License-Identifier: Apache-2.0
#include "tools/calibrate/check.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

typedef struct {
  const sv_rig *rig;
  const cal_boards *b;
  double spacing_m;
} job;

static size_t at(const cal_boards *b, int camera, int frame) {
  return (size_t)camera * (size_t)b->n_frames + (size_t)frame;
}

// Normal equations of a board pose (6 unknowns: rotation and translation in the rig's frame,
// applied from the left).
typedef struct {
  double a[36], g[6];
} normal_equations;

// Adds one camera's squared residuals for a board pose; with eq also to the normal equations.
// Infinite when a corner does not project.
static double add_camera(const job *j, int camera, int frame, const sv_pose *rig_from_board,
                         normal_equations *eq) {
  const cal_boards *b = j->b;
  const sv_sub_view *v = &j->rig->sub_views[camera];
  const double *uv = b->uv_px + 2 * (size_t)(b->n_cols * b->n_rows) * at(b, camera, frame);
  double sum = 0;
  for (int k = 0; k < b->n_cols * b->n_rows; k++) {
    double x[3] = {k % b->n_cols * j->spacing_m, k / b->n_cols * j->spacing_m, 0}, y[3], q[2], d[6];
    sv_pose_apply(x, rig_from_board, x);
    sv_pose_apply(y, &v->cam_from_rig, x);
    if (!sv_model_project(&v->model, y, q, d, NULL)) return INFINITY;
    for (int c = 0; c < 2; c++) {
      double r = q[c] - uv[2 * k + c], t[3], row[6];
      for (int i = 0; i < 3; i++) {
        t[i] = 0;
        for (int n = 0; n < 3; n++) t[i] += d[3 * c + n] * v->cam_from_rig.r[3 * n + i];
      }
      sv_cross3(row, x, t);
      for (int i = 0; i < 3; i++) row[3 + i] = t[i];
      sum += r * r;
      for (int i = 0; i < 6 && eq; i++) {
        eq->g[i] += row[i] * r;
        for (int n = 0; n < 6; n++) eq->a[6 * i + n] += row[i] * row[n];
      }
    }
  }
  return sum;
}

static double cost(const job *j, int only, int frame, const sv_pose *p, normal_equations *eq, int *n) {
  double sum = 0;
  *n = 0;
  for (int c = 0; c < j->b->n_cameras; c++) {
    if (!j->b->is_seen[at(j->b, c, frame)] || (only >= 0 && c != only)) continue;
    sum += add_camera(j, c, frame, p, eq);
    *n += j->b->n_cols * j->b->n_rows;
  }
  return sum;
}

static bool solve6(double a[36], double x[6]) { // Cholesky; x: right side in, solution out
  for (int i = 0; i < 6; i++)
    for (int k = 0; k <= i; k++) {
      double s = a[6 * i + k];
      for (int n = 0; n < k; n++) s -= a[6 * i + n] * a[6 * k + n];
      if (i == k && !(s > 0)) return false;
      a[6 * i + k] = i == k ? sqrt(s) : s / a[6 * k + k];
    }
  for (int i = 0; i < 6; i++) {
    for (int n = 0; n < i; n++) x[i] -= a[6 * i + n] * x[n];
    x[i] /= a[6 * i + i];
  }
  for (int i = 5; i >= 0; i--) {
    for (int n = i + 1; n < 6; n++) x[i] -= a[6 * n + i] * x[n];
    x[i] /= a[6 * i + i];
  }
  return true;
}

static sv_pose moved(const sv_pose *p, const double d[6]) {
  sv_pose step;
  sv_rodrigues(step.r, d);
  for (int k = 0; k < 3; k++) step.t[k] = d[3 + k];
  return sv_pose_mul(&step, p);
}

// Levenberg and Marquardt on the pose; returns the squared residuals.
static double refine(const job *j, int only, int frame, sv_pose *p, int *n) {
  double lambda = 1e-3, now = cost(j, only, frame, p, NULL, n);
  for (int it = 0; it < 100 && isfinite(now); it++) {
    normal_equations eq = {0};
    cost(j, only, frame, p, &eq, n);
    for (int i = 0; i < 6; i++) {
      eq.a[7 * i] *= 1 + lambda;
      eq.g[i] = -eq.g[i];
    }
    if (!solve6(eq.a, eq.g)) break;
    sv_pose next = moved(p, eq.g);
    double then = cost(j, only, frame, &next, NULL, n);
    if (then < now) {
      bool is_done = now - then < 1e-12 * now;
      *p = next;
      now = then;
      lambda *= 0.2;
      if (is_done) break;
    } else if ((lambda *= 8) > 1e9) break;
  }
  return now;
}

// A start from four corners: the board's axes from the rays through its outer corners, as if it
// stood across the line of sight, tilted several ways; the best after refinement holds.
static bool start(const job *j, int camera, int frame, sv_pose *rig_from_board) {
  const cal_boards *b = j->b;
  const sv_sub_view *v = &j->rig->sub_views[camera];
  const double *uv = b->uv_px + 2 * (size_t)(b->n_cols * b->n_rows) * at(b, camera, frame);
  const double *first = uv, *across = uv + 2 * (b->n_cols - 1), *last = uv + 2 * (b->n_cols * b->n_rows - 1);
  double r0[3], r1[3], r2[3], best = INFINITY;
  if (!sv_model_unproject(&v->model, first, r0) || !sv_model_unproject(&v->model, across, r1) ||
      !sv_model_unproject(&v->model, last, r2))
    return false;
  double diagonal = j->spacing_m * hypot(b->n_cols - 1, b->n_rows - 1), angle = sv_angle_between(r0, r2);
  double depth = diagonal / (2 * tan(0.5 * angle)), roll = atan2(r1[1] - r0[1], r1[0] - r0[0]);
  sv_pose rig_from_cam = sv_pose_inv(&v->cam_from_rig);
  for (int k = 0; k < 9; k++) {
    double tilt[3] = {0.6 * (k % 3 - 1), 0.6 * (k / 3 - 1), 0}, spin[3] = {0, 0, roll}, a[9], c[9];
    sv_pose p;
    int n;
    sv_rodrigues(a, tilt);
    sv_rodrigues(c, spin);
    sv_mul33(p.r, a, c);
    double middle[3] = {0.5 * (b->n_cols - 1) * j->spacing_m, 0.5 * (b->n_rows - 1) * j->spacing_m, 0},
           off[3];
    sv_apply33(off, p.r, middle);
    for (int i = 0; i < 3; i++) p.t[i] = depth * 0.5 * (r0[i] + r2[i]) - off[i];
    p = sv_pose_mul(&rig_from_cam, &p);
    double left = refine(j, camera, frame, &p, &n);
    if (left < best) {
      best = left;
      *rig_from_board = p;
    }
  }
  return isfinite(best);
}

// Distance of the camera's corners from the epipolar lines of the first camera's, in pixels of an
// undistorted view: of the true ray to the plane through both centers and the first camera's ray.
static double epipolar2(const job *j, int camera, int frame, int *n) {
  const cal_boards *b = j->b;
  size_t corners = (size_t)(b->n_cols * b->n_rows);
  const sv_sub_view *v = &j->rig->sub_views[camera], *first = &j->rig->sub_views[0];
  sv_pose back = sv_pose_inv(&first->cam_from_rig), p = sv_pose_mul(&v->cam_from_rig, &back);
  double sum = 0;
  for (size_t k = 0; k < corners; k++) {
    double ray0[3], ray[3], normal[3];
    if (!sv_model_unproject(&first->model, b->uv_px + 2 * (corners * at(b, 0, frame) + k), ray0) ||
        !sv_model_unproject(&v->model, b->uv_px + 2 * (corners * at(b, camera, frame) + k), ray))
      continue;
    sv_apply33(ray0, p.r, ray0);
    sv_cross3(normal, p.t, ray0);
    double size = sv_norm3(normal), d = size > 0 ? sv_dot3(normal, ray) / size * v->model.p[0] : 0;
    sum += d * d;
    (*n)++;
  }
  return sum;
}

static void measure_camera(cal_check *c, const job *j, int i) {
  const cal_boards *b = j->b;
  double alone = 0, rig = 0, lines = 0;
  int n = 0, n_rig = 0, n_lines = 0, k;
  for (int f = 0; f < b->n_frames; f++) {
    if (!b->is_seen[at(b, i, f)] || !c->has_pose[f]) continue;
    sv_pose p = c->rig_from_board[f];
    c->cameras[i].n_boards++;
    alone += refine(j, i, f, &p, &k);
    n += k;
    rig += cost(j, i, f, &c->rig_from_board[f], NULL, &k);
    n_rig += k;
    if (i && b->is_seen[at(b, 0, f)]) lines += epipolar2(j, i, f, &n_lines);
  }
  c->cameras[i].rms_alone_px = n ? sqrt(alone / n) : NAN;
  c->cameras[i].rms_rig_px = n_rig ? sqrt(rig / n_rig) : NAN;
  c->cameras[i].epipolar_px = n_lines ? sqrt(lines / n_lines) : i ? NAN : 0;
}

sv_status cal_check_boards(cal_check *c, const sv_rig *rig, const cal_boards *b, double spacing_m,
                           sv_err *err) {
  job j = {rig, b, spacing_m};
  double sum = 0;
  int n_all = 0;
  *c = (cal_check){.boards = b, .n_cameras = b->n_cameras};
  c->cameras = calloc((size_t)b->n_cameras, sizeof *c->cameras);
  c->rig_from_board = calloc((size_t)b->n_frames, sizeof *c->rig_from_board);
  c->has_pose = calloc((size_t)b->n_frames, sizeof *c->has_pose);
  if (!c->cameras || !c->rig_from_board || !c->has_pose)
    return sv_fail(err, SV_E_NOMEM, "no memory for the check");
  for (int f = 0; f < b->n_frames; f++)
    for (int i = 0; i < b->n_cameras && !c->has_pose[f]; i++) {
      int n;
      if (!b->is_seen[at(b, i, f)] || !start(&j, i, f, &c->rig_from_board[f])) continue;
      double left = refine(&j, -1, f, &c->rig_from_board[f], &n);
      c->has_pose[f] = isfinite(left);
      if (c->has_pose[f]) {
        sum += left;
        n_all += n;
        c->n_frames++;
      }
    }
  if (!c->n_frames)
    return sv_fail(err, SV_E_NOT_FOUND, "no board of %dx%d inner corners fits the rig's lenses in any image",
                   b->n_cols, b->n_rows);
  c->rms_px = sqrt(sum / n_all);
  for (int i = 0; i < b->n_cameras; i++) measure_camera(c, &j, i);
  return SV_OK;
}

void cal_check_free(cal_check *c) {
  free(c->cameras);
  free(c->rig_from_board);
  free(c->has_pose);
  memset(c, 0, sizeof *c);
}
