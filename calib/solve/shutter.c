// SPDX-License-Identifier: Apache-2.0
#include "calib/solve/shutter.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/cholesky.h"
#include "src/base/mathx.h"

#define MAX_GAP_S    0.25 // between frames that tell each other's motion
#define MIN_FRAMES   8
#define N_BESIDE     4 // frames, two on each side, from whose poses the motion comes
#define ITERATIONS   20
#define OUTLIERS     3.0  // boards that fit so much worse than the median are left out
#define MIN_SIGMAS   5.0  // a readout that is not above so many deviations is none,
#define MIN_S        1e-3 // nor one below: that is what noise of corners looks like
#define MAX_RELATIVE 0.25

typedef struct {
  const sv_shutter_boards *b;
  sv_pose *pose;       // [n_frames]
  bool *is_used;       // [n_frames]
  double *cost;        // [n_frames]
  double readout_s[2]; // down, right
  double a[4], g[2], cost_sum;
} problem;

static int n_corners(const sv_shutter_boards *b) { return b->n_cols * b->n_rows; }

// --- motion --------------------------------------------------------------------------------------

// Derivative at 0 of the polynomial through 0 and values at s[n].
static void slopes(const double *s, int n, double *out) {
  for (int i = 0; i < n; i++) {
    out[i] = 1 / s[i];
    for (int j = 0; j < n; j++)
      if (j != i) out[i] *= s[j] / (s[j] - s[i]);
  }
}

// Frames about f: as many on both sides. Returns how many, 0 at ends and gaps.
static int beside(const sv_shutter_boards *b, int f, int out[N_BESIDE]) {
  int n = 0;
  for (int k = 1; k <= N_BESIDE / 2; k++) {
    if (f - k < 0 || f + k >= b->n_frames || b->time_s[f - k + 1] - b->time_s[f - k] > MAX_GAP_S ||
        b->time_s[f + k] - b->time_s[f + k - 1] > MAX_GAP_S)
      break;
    out[n++] = f - k;
    out[n++] = f + k;
  }
  return n;
}

// Of cam_from_board. False where it is not known.
static bool motion_at(const problem *p, int f, double out[6]) {
  int other[N_BESIDE];
  double s[N_BESIDE], slope[N_BESIDE];
  const int n = beside(p->b, f, other);
  const sv_pose back = sv_pose_inv(&p->pose[f]);
  memset(out, 0, 6 * sizeof *out);
  for (int i = 0; i < n; i++) s[i] = p->b->time_s[other[i]] - p->b->time_s[f];
  slopes(s, n, slope);
  for (int i = 0; i < n; i++) {
    const sv_pose step = sv_pose_mul(&p->pose[other[i]], &back);
    double w[3];
    sv_rodrigues_inv(w, step.r);
    for (int k = 0; k < 3; k++) {
      out[k] += slope[i] * w[k];
      out[3 + k] += slope[i] * step.t[k];
    }
  }
  return n > 0;
}

// --- one board -----------------------------------------------------------------------------------

// Of a frame: by its pose, by the readouts, and both.
typedef struct {
  double pp[36], pr[12], rr[4], gp[6], gr[2];
} normal_equations;

static void add(normal_equations *e, const double jp[6], const double jr[2], double r) {
  for (int i = 0; i < 6; i++) {
    e->gp[i] += jp[i] * r;
    for (int k = 0; k < 6; k++) e->pp[6 * i + k] += jp[i] * jp[k];
    for (int k = 0; k < 2; k++) e->pr[2 * i + k] += jp[i] * jr[k];
  }
  for (int i = 0; i < 2; i++) {
    e->gr[i] += jr[i] * r;
    for (int k = 0; k < 2; k++) e->rr[2 * i + k] += jr[i] * jr[k];
  }
}

// Squared residuals of a frame, infinite when a corner does not project; e may be NULL.
static double sum_frame(const problem *p, int f, const double motion[6], normal_equations *e) {
  const sv_shutter_boards *b = p->b;
  const double *uv = b->uv_px + 2 * (size_t)n_corners(b) * (size_t)f;
  double sum = 0;
  for (int k = 0; k < n_corners(b); k++, uv += 2) {
    const double board[3] = {k % b->n_cols * b->spacing_m, k / b->n_cols * b->spacing_m, 0};
    const double line[2] = {uv[1] / b->lens->height_px - 0.5, uv[0] / b->lens->width_px - 0.5};
    const double s = p->readout_s[0] * line[0] + p->readout_s[1] * line[1];
    double start[3], x[3], turn[9], speed[3], q[2], d[6];
    sv_pose_apply(start, &p->pose[f], board);
    sv_motion_apply(x, motion, s, start, turn);
    if (!sv_model_project(b->lens, x, q, d, NULL)) return INFINITY;
    sv_cross3(speed, motion, x);
    for (int i = 0; i < 3; i++) speed[i] += motion[3 + i];
    for (int c = 0; c < 2; c++) {
      const double *dx = d + 3 * c, r = q[c] - uv[c];
      double t[3], jp[6];
      for (int i = 0; i < 3; i++) t[i] = dx[0] * turn[i] + dx[1] * turn[3 + i] + dx[2] * turn[6 + i];
      sv_cross3(jp, start, t);
      memcpy(jp + 3, t, sizeof t);
      const double along = sv_dot3(dx, speed), jr[2] = {along * line[0], along * line[1]};
      if (e) add(e, jp, jr, r);
      sum += r * r;
    }
  }
  return sum;
}

static void move(sv_pose *p, const double twist[6]) {
  sv_pose step;
  sv_rodrigues(step.r, twist);
  memcpy(step.t, twist + 3, sizeof step.t);
  *p = sv_pose_mul(&step, p);
}

// --- all of them ---------------------------------------------------------------------------------

// Sums up the readouts' equations, poses eliminated; with step, moves the poses as the readouts'
// step asks, and sums up before that.
static void pass(problem *p, const double step[2], sv_pose *moved) {
  memset(p->a, 0, sizeof p->a);
  memset(p->g, 0, sizeof p->g);
  p->cost_sum = 0;
  for (int f = 0; f < p->b->n_frames; f++) {
    double motion[6], y[12], z[6];
    normal_equations e = {0};
    if (moved) moved[f] = p->pose[f];
    const bool has_motion = motion_at(p, f, motion);
    p->cost[f] = sum_frame(p, f, motion, &e);
    for (int i = 0; i < 6; i++) e.pp[7 * i] *= 1 + 1e-9;
    if (!isfinite(p->cost[f]) || !sv_cholesky(e.pp, 6)) continue;
    for (int c = 0; c < 2; c++) {
      for (int i = 0; i < 6; i++) z[i] = e.pr[2 * i + c];
      sv_cholesky_solve(e.pp, 6, z);
      for (int i = 0; i < 6; i++) y[2 * i + c] = z[i];
    }
    memcpy(z, e.gp, sizeof z);
    sv_cholesky_solve(e.pp, 6, z);
    if (moved) {
      double twist[6];
      for (int i = 0; i < 6; i++)
        twist[i] = -z[i] - (has_motion ? y[2 * i] * step[0] + y[2 * i + 1] * step[1] : 0);
      move(&moved[f], twist);
    }
    if (!has_motion || !p->is_used[f]) continue;
    p->cost_sum += p->cost[f];
    for (int c = 0; c < 2; c++) {
      for (int m = 0; m < 2; m++) {
        p->a[2 * c + m] += e.rr[2 * c + m];
        for (int i = 0; i < 6; i++) p->a[2 * c + m] -= e.pr[2 * i + c] * y[2 * i + m];
      }
      p->g[c] += e.gr[c];
      for (int i = 0; i < 6; i++) p->g[c] -= e.pr[2 * i + c] * z[i];
    }
  }
}

// Inverse of the readouts' equations. False when the motion does not tell them.
static bool invert(const problem *p, double out[4]) {
  const double *a = p->a, det = a[0] * a[3] - a[1] * a[2];
  if (!(det > 1e-9 * a[0] * a[3])) return false;
  out[0] = a[3] / det;
  out[1] = out[2] = -a[1] / det;
  out[3] = a[0] / det;
  return true;
}

static int by_value(const void *a, const void *b) {
  const double x = *(const double *)a, y = *(const double *)b;
  return (x > y) - (x < y);
}

static double median_cost(const problem *p, double *work) {
  int n = 0;
  for (int f = 0; f < p->b->n_frames; f++)
    if (p->is_used[f]) work[n++] = p->cost[f];
  qsort(work, (size_t)n, sizeof *work, by_value);
  return n ? work[n / 2] : 0;
}

// Gauss-Newton; boards that fit badly are left out half-way. False when it does not settle.
static bool solve(problem *p, sv_pose *moved, double *work, double inverse[4]) {
  for (int it = 0; it < ITERATIONS; it++) {
    pass(p, NULL, NULL);
    if (it == ITERATIONS / 2) {
      const double limit = OUTLIERS * OUTLIERS * median_cost(p, work);
      for (int f = 0; f < p->b->n_frames; f++) p->is_used[f] = p->is_used[f] && p->cost[f] <= limit;
      pass(p, NULL, NULL);
    }
    if (!invert(p, inverse)) return false;
    const double step[2] = {-inverse[0] * p->g[0] - inverse[1] * p->g[1],
                            -inverse[2] * p->g[0] - inverse[3] * p->g[1]};
    pass(p, step, moved);
    memcpy(p->pose, moved, (size_t)p->b->n_frames * sizeof *moved);
    for (int i = 0; i < 2; i++) p->readout_s[i] += step[i];
    if (!(fabs(p->readout_s[0]) < 1 && fabs(p->readout_s[1]) < 1)) return false;
  }
  pass(p, NULL, NULL);
  return invert(p, inverse);
}

static int count(const problem *p) {
  int n = 0;
  for (int f = 0; f < p->b->n_frames; f++) n += p->is_used[f];
  return n;
}

static double rms(const problem *p) { return sqrt(p->cost_sum / (count(p) * n_corners(p->b) + 1e-30)); }

static void summarize(problem *p, const double inverse[4], sv_shutter_result *out) {
  const int down = fabs(p->readout_s[0]) >= fabs(p->readout_s[1]) ? 0 : 1;
  const double noise2 = p->cost_sum / (2.0 * count(p) * n_corners(p->b) - 6.0 * count(p) - 2);
  const double s = p->readout_s[down];
  double turn2 = 0, motion[6];
  for (int f = 0; f < p->b->n_frames; f++)
    if (p->is_used[f] && motion_at(p, f, motion)) turn2 += sv_dot3(motion, motion) / count(p);
  out->n_used = count(p);
  out->turn_deg_s = sqrt(turn2) * 180 / SV_PI;
  out->rms_px = rms(p);
  out->sigma_s = sqrt(noise2 * inverse[3 * down]);
  out->across_s = p->readout_s[1 - down];
  out->shutter.readout_s = fabs(s) > MIN_SIGMAS * out->sigma_s && fabs(s) > MIN_S ? fabs(s) : 0;
  out->shutter.direction = down == 0 ? s > 0 ? SV_SHUTTER_DOWN : SV_SHUTTER_UP
                           : s > 0   ? SV_SHUTTER_RIGHT
                                     : SV_SHUTTER_LEFT;
}

static sv_status solve_all(problem *p, sv_pose *moved, double *work, sv_shutter_result *out, sv_err *err) {
  const sv_shutter_boards *b = p->b;
  double inverse[4];
  int other[N_BESIDE];
  memcpy(p->pose, b->cam_from_board, (size_t)b->n_frames * sizeof *p->pose);
  for (int f = 0; f < b->n_frames; f++) p->is_used[f] = beside(b, f, other) > 0;
  if (count(p) < MIN_FRAMES)
    return sv_fail(
        err, SV_E_RANGE,
        "%d frames with the board in the frames before and after them, expected at least %d: record a "
        "video of the moving board, not single pictures",
        count(p), MIN_FRAMES);
  pass(p, NULL, NULL);
  out->rms_global_px = rms(p);
  bool is_solved = solve(p, moved, work, inverse);
  if (is_solved) summarize(p, inverse, out);
  if (!is_solved || !(out->sigma_s < MAX_RELATIVE * fabs(out->shutter.readout_s) || out->sigma_s < 1e-3))
    return sv_fail(
        err, SV_E_RANGE,
        "the board hardly moves: move it fast and in all directions, up and down, too, near the camera");
  return SV_OK;
}

sv_status sv_shutter_solve(const sv_shutter_boards *b, sv_shutter_result *out, sv_err *err) {
  problem p = {.b = b};
  const size_t n = (size_t)b->n_frames + 1;
  sv_pose *moved = calloc(n, sizeof *moved);
  double *work = calloc(n, sizeof *work);
  memset(out, 0, sizeof *out);
  p.pose = calloc(n, sizeof *p.pose);
  p.is_used = calloc(n, sizeof *p.is_used);
  p.cost = calloc(n, sizeof *p.cost);
  sv_status s = moved && work && p.pose && p.is_used && p.cost
                    ? solve_all(&p, moved, work, out, err)
                    : sv_fail(err, SV_E_NOMEM, "no memory for %d boards", b->n_frames);
  free(moved);
  free(work);
  free(p.pose);
  free(p.is_used);
  free(p.cost);
  return s;
}
