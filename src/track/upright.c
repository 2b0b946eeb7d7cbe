// SPDX-License-Identifier: Apache-2.0
// Which way is up in the world of a handheld rig. People hold cameras without roll, so the cameras'
// rows lie flat in the world; a main plane of the points nearly square to that is a floor or a
// table, and tells it better.
#include <string.h>

#include "src/base/cholesky.h"
#include "src/track/tracker.h"

#define PITCH_WEIGHT 0.003 // of the cameras' own up, for what their rows do not tell
#define N_SAMPLES    300   // of three points
#define MIN_COS      0.819 // a plane's normal is within 35 degrees of the cameras' up
#define TOLERANCE    0.01  // of the points' spread
#define MIN_SUPPORT  0.15  // of the points lie in the plane
#define N_ROUNDS     3     // of least squares

static bool unit(double x[3]) {
  const double n = sv_norm3(x);
  for (int k = 0; n > 0 && k < 3; k++) x[k] /= n;
  return n > 1e-9;
}

// Minimizes the mean of (row . up)^2 + PITCH_WEIGHT |up - mean up|^2.
static bool up_of_cameras(const sv_tracker *t, double up[3]) {
  double s[9] = {0}, mean[3] = {0};
  int n = 0;
  for (int e = 0; e < t->n_exposures; e++)
    for (int v = 0; t->is_placed[e] && v < t->n_views; v++, n++) {
      const sv_pose cam = sv_pose_mul(&t->cfg.rig->sub_views[t->sub_view[v]].cam_from_rig, &t->pose[e]);
      for (int i = 0; i < 3; i++) {
        mean[i] -= cam.r[3 + i];
        for (int k = 0; k < 3; k++) s[3 * i + k] += cam.r[i] * cam.r[k];
      }
    }
  if (!n || !unit(mean)) return false;
  for (int i = 0; i < 9; i++) s[i] = s[i] / n + (i % 4 == 0 ? PITCH_WEIGHT : 0);
  memcpy(up, mean, sizeof mean);
  if (!sv_cholesky(s, 3)) return false;
  sv_cholesky_solve(s, 3, up);
  return unit(up);
}

typedef struct {
  double normal[3], offset; // normal . x = offset
  int support;
} plane;

static double height(const plane *p, const double x[3]) { return sv_dot3(p->normal, x) - p->offset; }

static bool is_in(const plane *p, const sv_track_point *x, double tolerance) {
  return x->has_depth && fabs(height(p, x->x)) < tolerance;
}

static void count_support(const sv_tracker *t, plane *p, double tolerance) {
  p->support = 0;
  for (int i = 0; i < t->n_points; i++) p->support += is_in(p, &t->point[i], tolerance);
}

// Least squares over what lies in the plane: height over it = a u + b v + c along two of its axes.
static bool fit(const sv_tracker *t, plane *p, double tolerance) {
  double u[3] = {0}, v[3], s[9] = {0}, x[3] = {0};
  int least = 0;
  for (int k = 1; k < 3; k++)
    if (fabs(p->normal[k]) < fabs(p->normal[least])) least = k;
  u[least] = 1;
  sv_cross3(u, p->normal, u);
  unit(u);
  sv_cross3(v, p->normal, u);
  for (int i = 0; i < t->n_points; i++) {
    if (!is_in(p, &t->point[i], tolerance)) continue;
    const double row[3] = {sv_dot3(u, t->point[i].x), sv_dot3(v, t->point[i].x), 1};
    for (int j = 0; j < 3; j++) {
      x[j] += row[j] * height(p, t->point[i].x);
      for (int k = 0; k < 3; k++) s[3 * j + k] += row[j] * row[k];
    }
  }
  if (!sv_cholesky(s, 3)) return false;
  sv_cholesky_solve(s, 3, x);
  double middle[3];
  for (int k = 0; k < 3; k++) middle[k] = (p->offset + x[2]) * p->normal[k];
  for (int k = 0; k < 3; k++) p->normal[k] -= x[0] * u[k] + x[1] * v[k];
  if (!unit(p->normal)) return false;
  p->offset = sv_dot3(p->normal, middle);
  return true;
}

// Three points with depth; false: they tell no plane that is square to up.
static bool sample(const sv_tracker *t, const double up[3], sv_rng *rng, plane *p) {
  const double *x[3];
  double a[3], b[3];
  for (int k = 0; k < 3; k++) {
    const sv_track_point *point = &t->point[sv_rng_below(rng, (uint32_t)t->n_points)];
    if (!point->has_depth) return false;
    x[k] = point->x;
  }
  sv_sub3(a, x[1], x[0]);
  sv_sub3(b, x[2], x[0]);
  sv_cross3(p->normal, a, b);
  if (!unit(p->normal)) return false;
  const double c = sv_dot3(p->normal, up);
  for (int k = 0; c < 0 && k < 3; k++) p->normal[k] = -p->normal[k];
  p->offset = sv_dot3(p->normal, x[0]);
  return fabs(c) > MIN_COS;
}

// Mean distance of the points from their middle.
static double spread(const sv_tracker *t, int *n) {
  double middle[3] = {0}, sum = 0;
  *n = 0;
  for (int i = 0; i < t->n_points; i++) {
    if (!t->point[i].has_depth) continue;
    for (int k = 0; k < 3; k++) middle[k] += t->point[i].x[k];
    ++*n;
  }
  for (int k = 0; *n && k < 3; k++) middle[k] /= *n;
  for (int i = 0; i < t->n_points; i++) {
    double d[3];
    sv_sub3(d, t->point[i].x, middle);
    if (t->point[i].has_depth) sum += sv_norm3(d);
  }
  return *n ? sum / *n : 0;
}

bool sv_track_up(const sv_tracker *t, double up[3]) {
  plane best = {.support = 0};
  int n;
  const double tolerance = TOLERANCE * spread(t, &n);
  sv_rng rng = sv_rng_make(t->cfg.seed, 7);
  if (!up_of_cameras(t, up)) return false;
  for (int i = 0; n >= 3 && i < N_SAMPLES; i++) {
    plane p;
    if (!sample(t, up, &rng, &p)) continue;
    count_support(t, &p, tolerance);
    if (p.support > best.support) best = p;
  }
  if (best.support < MIN_SUPPORT * n) return true;
  for (int i = 0; i < N_ROUNDS; i++)
    if (!fit(t, &best, tolerance)) return true;
  if (sv_dot3(best.normal, up) > MIN_COS) memcpy(up, best.normal, sizeof best.normal);
  return true;
}

// The smallest rotation that takes up to -y: I + [w] + [w]^2 / (1 + cos), w = up x -y.
void sv_track_turn_upright(sv_tracker *t, const double up[3]) {
  const double w[3] = {up[2], 0, -up[0]}, c = -up[1];
  const double k[9] = {0, -w[2], w[1], w[2], 0, -w[0], -w[1], w[0], 0};
  double r[9], back[9];
  if (c < -0.99) return; // upside down: no smallest one
  sv_mul33(r, k, k);
  for (int i = 0; i < 9; i++) r[i] = r[i] / (1 + c) + k[i] + (i % 4 == 0 ? 1 : 0);
  for (int i = 0; i < 9; i++) back[i] = r[3 * (i % 3) + i / 3];
  for (int e = 0; e < t->n_exposures; e++) sv_mul33(t->pose[e].r, t->pose[e].r, back);
  for (int i = 0; i < t->n_points; i++) sv_apply33(t->point[i].x, r, t->point[i].x);
}
