// SPDX-License-Identifier: Apache-2.0
#include "calib/solve/lens_array.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/mathx.h"

#define N_CAM     9 // rotation 3, translation 3, log focal length, principal point 2
#define CAP_STEPS 60
#define HUBER     2.0 // deviations
#define OUTLIER   4.0

typedef struct {
  sv_lens_array *b;
  // the unknown that is held to fix the size of everything: a coordinate of a far view
  int i_scale;
  int n;                    // camera unknowns, and one for the common log focal length
  double *s, *g;            // reduced system [n][n], its right side [n]
  double *w;                // [n_views][N_CAM * 3] of the point at hand
  int *first;               // [n_points + 1] observations of each point
  double *vinv;             // [n_points][9]
  double *gp;               // [n_points][3]
  double *step;             // [n]
  double focal0, log_focal; // the common one: focal0 exp(log_focal)
  double *abs_r;            // for medians
  double sigma;
} work;

// --- one observation -----------------------------------------------------------------------------
typedef struct {
  double r[2], jc[2][N_CAM], jp[2][3];
} linear;

static bool residual(const sv_lens_array *b, const sv_array_observation *o, linear *l, bool has_jacobian) {
  const sv_camera_model *m = &b->models[o->view];
  const sv_pose *p = &b->cam_from_rig[o->view];
  double x[3], rx[3], uv[2], dx[6];
  sv_apply33(rx, p->r, b->points[o->point]);
  for (int k = 0; k < 3; k++) x[k] = rx[k] + p->t[k];
  if (!sv_model_project(m, x, uv, has_jacobian ? dx : NULL, NULL)) return false;
  for (int a = 0; a < 2; a++) l->r[a] = uv[a] - o->uv_px[a];
  for (int a = 0; a < 2 && has_jacobian; a++) {
    const double *d = dx + 3 * a;
    sv_cross3(l->jc[a], rx, d); // d(exp(w) Rx)/dw = -[Rx]x
    for (int k = 0; k < 3; k++) {
      l->jc[a][3 + k] = d[k];
      l->jp[a][k] = d[0] * p->r[k] + d[1] * p->r[3 + k] + d[2] * p->r[6 + k];
    }
    l->jc[a][6] = uv[a] - m->p[2 + a];
    l->jc[a][7] = a == 0;
    l->jc[a][8] = a == 1;
  }
  return true;
}

static double huber(double r2, double sigma, double *weight) {
  double k = HUBER * sigma, r = sqrt(r2);
  *weight = r <= k ? 1 : k / r;
  return r <= k ? r2 : 2 * k * r - k * k;
}

// --- priors --------------------------------------------------------------------------------------
static double prior_cost(const work *w) {
  const sv_lens_array *b = w->b;
  double sum = 0, s2 = w->sigma * w->sigma;
  for (int c = 0; c < b->n_views && !b->is_lens_fixed; c++) {
    const sv_camera_model *m = &b->models[c];
    double f = (sv_log(m->p[0] / w->focal0) - w->log_focal) / b->focal_sd;
    double u = (m->p[2] - b->centre_px[c][0]) / b->centre_sd_px,
           v = (m->p[3] - b->centre_px[c][1]) / b->centre_sd_px;
    sum += s2 * (f * f + u * u + v * v);
  }
  return sum;
}

static void add_priors(const work *w) {
  const sv_lens_array *b = w->b;
  double s2 = w->sigma * w->sigma, kf = s2 / (b->focal_sd * b->focal_sd),
         kc = s2 / (b->centre_sd_px * b->centre_sd_px);
  size_t n = (size_t)w->n, last = n - 1;
  for (int c = 0; c < b->n_views; c++) {
    const sv_camera_model *m = &b->models[c];
    size_t at = (size_t)c * N_CAM;
    double f = sv_log(m->p[0] / w->focal0) - w->log_focal;
    w->s[(at + 6) * n + at + 6] += kf;
    w->s[last * n + last] += kf;
    w->s[(at + 6) * n + last] -= kf;
    w->s[last * n + at + 6] -= kf;
    w->g[at + 6] += kf * f;
    w->g[last] -= kf * f;
    for (size_t a = 0; a < 2; a++) {
      w->s[(at + 7 + a) * n + at + 7 + a] += kc;
      w->g[at + 7 + a] += kc * (m->p[2 + a] - b->centre_px[c][a]);
    }
  }
}

static double cost(const work *w) {
  const sv_lens_array *b = w->b;
  double sum = prior_cost(w), weight;
  linear l;
  for (int i = 0; i < b->n_observations; i++) {
    const sv_array_observation *o = &b->observations[i];
    if (o->is_outlier) continue;
    if (!residual(b, o, &l, false)) return INFINITY;
    sum += huber(l.r[0] * l.r[0] + l.r[1] * l.r[1], w->sigma, &weight);
  }
  return sum;
}

// --- the reduced system --------------------------------------------------------------------------
static bool invert3(double out[9], const double a[9]) {
  double c0 = a[4] * a[8] - a[5] * a[7], c1 = a[5] * a[6] - a[3] * a[8], c2 = a[3] * a[7] - a[4] * a[6];
  double det = a[0] * c0 + a[1] * c1 + a[2] * c2;
  if (!(det > 0)) return false;
  const double c[9] = {c0, a[2] * a[7] - a[1] * a[8], a[1] * a[5] - a[2] * a[4],
                       c1, a[0] * a[8] - a[2] * a[6], a[2] * a[3] - a[0] * a[5],
                       c2, a[1] * a[6] - a[0] * a[7], a[0] * a[4] - a[1] * a[3]};
  for (int i = 0; i < 9; i++) out[i] = c[i] / det;
  return true;
}

static void add_camera_block(const work *w, int c, const linear *l, double weight) {
  size_t n = (size_t)w->n, at = (size_t)c * N_CAM;
  for (size_t i = 0; i < N_CAM; i++) {
    for (size_t j = 0; j < N_CAM; j++)
      w->s[(at + i) * n + at + j] += weight * (l->jc[0][i] * l->jc[0][j] + l->jc[1][i] * l->jc[1][j]);
    w->g[at + i] += weight * (l->jc[0][i] * l->r[0] + l->jc[1][i] * l->r[1]);
  }
}

// S -= W V^-1 W^T, g -= W V^-1 gp over the views that see the point.
static void eliminate(const work *w, int p, const int *views, int n_seen) {
  size_t n = (size_t)w->n;
  const double *vi = w->vinv + 9 * p, *gp = w->gp + 3 * p;
  for (int a = 0; a < n_seen; a++) {
    const double *wa = w->w + (size_t)a * N_CAM * 3;
    for (size_t i = 0; i < N_CAM; i++) {
      double y[3];
      for (int k = 0; k < 3; k++)
        y[k] = wa[3 * i] * vi[k] + wa[3 * i + 1] * vi[3 + k] + wa[3 * i + 2] * vi[6 + k];
      size_t row = (size_t)views[a] * N_CAM + i;
      w->g[row] -= y[0] * gp[0] + y[1] * gp[1] + y[2] * gp[2];
      for (int c = 0; c < n_seen; c++) {
        if (views[c] > views[a]) continue; // the lower triangle is all that is looked at
        const double *wc = w->w + (size_t)c * N_CAM * 3;
        double *s = w->s + row * n + (size_t)views[c] * N_CAM;
        for (size_t j = 0; j < N_CAM; j++)
          s[j] -= y[0] * wc[3 * j] + y[1] * wc[3 * j + 1] + y[2] * wc[3 * j + 2];
      }
    }
  }
}

static bool add_point(const work *w, int p, double lambda) {
  const sv_lens_array *b = w->b;
  double v[9] = {0}, gp[3] = {0}, weight;
  int views[256], n_seen = 0;
  linear l;
  for (int i = w->first[p]; i < w->first[p + 1]; i++) {
    const sv_array_observation *o = &b->observations[i];
    if (o->is_outlier || n_seen == 256) continue;
    if (!residual(b, o, &l, true)) return false;
    huber(l.r[0] * l.r[0] + l.r[1] * l.r[1], w->sigma, &weight);
    add_camera_block(w, o->view, &l, weight);
    double *wo = w->w + (size_t)n_seen * N_CAM * 3;
    for (int k = 0; k < 3; k++) {
      for (int j = 0; j < 3; j++)
        v[3 * k + j] += weight * (l.jp[0][k] * l.jp[0][j] + l.jp[1][k] * l.jp[1][j]);
      gp[k] += weight * (l.jp[0][k] * l.r[0] + l.jp[1][k] * l.r[1]);
      for (int i2 = 0; i2 < N_CAM; i2++)
        wo[3 * i2 + k] = weight * (l.jc[0][i2] * l.jp[0][k] + l.jc[1][i2] * l.jp[1][k]);
    }
    views[n_seen++] = o->view;
  }
  for (int k = 0; k < 3; k++) v[4 * k] *= 1 + lambda;
  memcpy(w->gp + 3 * p, gp, sizeof gp);
  memset(w->vinv + 9 * p, 0, 9 * sizeof(double));
  // a point that nothing holds stays where it is
  if (!n_seen || !invert3(w->vinv + 9 * p, v)) return true;
  eliminate(w, p, views, n_seen);
  return true;
}

// What is held: view 0's pose, the size, lenses when they are fixed.
static bool is_held(const work *w, int i) {
  int c = i / N_CAM, k = i % N_CAM;
  if (i == w->n - 1) return w->b->is_lens_fixed || w->b->is_focal_known;
  return (c == 0 && k < 6) || i == w->i_scale || (k >= 6 && w->b->is_lens_fixed);
}

static bool build(const work *w, double lambda) {
  size_t n = (size_t)w->n;
  memset(w->s, 0, n * n * sizeof(double));
  memset(w->g, 0, n * sizeof(double));
  if (!w->b->is_lens_fixed) add_priors(w);
  for (int p = 0; p < w->b->n_points; p++)
    if (!add_point(w, p, lambda)) return false;
  for (size_t i = 0; i < n; i++) {
    double *d = &w->s[i * n + i];
    *d += lambda * fabs(*d) + 1e-12;
    if (!is_held(w, (int)i)) continue;
    for (size_t j = 0; j < n; j++) w->s[i * n + j] = w->s[j * n + i] = 0;
    *d = 1;
    w->g[i] = 0;
  }
  return true;
}

// Cholesky in place (lower triangle of s). False when s is not positive definite.
static bool factor(double *s, size_t n) {
  for (size_t j = 0; j < n; j++) {
    double d = s[j * n + j];
    for (size_t k = 0; k < j; k++) d -= s[j * n + k] * s[j * n + k];
    if (!(d > 0)) return false;
    d = sqrt(d);
    s[j * n + j] = d;
    for (size_t i = j + 1; i < n; i++) {
      double v = s[i * n + j];
      for (size_t k = 0; k < j; k++) v -= s[i * n + k] * s[j * n + k];
      s[i * n + j] = v / d;
    }
  }
  return true;
}

static void substitute(const double *s, size_t n, double *x) {
  for (size_t i = 0; i < n; i++) {
    for (size_t k = 0; k < i; k++) x[i] -= s[i * n + k] * x[k];
    x[i] /= s[i * n + i];
  }
  for (size_t i = n; i-- > 0;) {
    for (size_t k = i + 1; k < n; k++) x[i] -= s[k * n + i] * x[k];
    x[i] /= s[i * n + i];
  }
}

// --- a step --------------------------------------------------------------------------------------
// Points follow from the cameras' step: dp = -V^-1 (gp + W^T dc); W is computed again, as it was
// not kept.
static void move_points(const work *w) {
  const sv_lens_array *b = w->b;
  linear l;
  double weight;
  for (int p = 0; p < b->n_points; p++) {
    double e[3];
    const double *vi = w->vinv + 9 * p;
    for (int k = 0; k < 3; k++) e[k] = w->gp[3 * p + k];
    for (int i = w->first[p]; i < w->first[p + 1]; i++) {
      const sv_array_observation *o = &b->observations[i];
      if (o->is_outlier || !residual(b, o, &l, true)) continue;
      huber(l.r[0] * l.r[0] + l.r[1] * l.r[1], w->sigma, &weight);
      for (int a = 0; a < 2; a++) {
        double s = 0;
        for (int j = 0; j < N_CAM; j++) s += l.jc[a][j] * w->step[o->view * N_CAM + j];
        for (int k = 0; k < 3; k++) e[k] += weight * s * l.jp[a][k];
      }
    }
    for (int k = 0; k < 3; k++)
      b->points[p][k] -= vi[3 * k] * e[0] + vi[3 * k + 1] * e[1] + vi[3 * k + 2] * e[2];
  }
}

static void move_views(work *w) {
  sv_lens_array *b = w->b;
  for (int c = 0; c < b->n_views; c++) {
    const double *d = w->step + c * N_CAM;
    double r[9], scale = sv_exp(sv_minf(0.5f, sv_maxf(-0.5f, (float)d[6])));
    sv_rodrigues(r, d);
    sv_mul33(b->cam_from_rig[c].r, r, b->cam_from_rig[c].r);
    for (int k = 0; k < 3; k++) b->cam_from_rig[c].t[k] += d[3 + k];
    for (int a = 0; a < 2; a++) {
      b->models[c].p[a] *= scale;
      b->models[c].p[2 + a] += d[7 + a];
    }
  }
  w->log_focal += w->step[w->n - 1];
}

typedef struct {
  sv_camera_model *models;
  sv_pose *poses;
  double (*points)[3];
  double log_focal;
} state;

static void keep(const work *w, state *s, bool is_back) {
  sv_lens_array *b = w->b;
  size_t nv = (size_t)b->n_views, np = (size_t)b->n_points;
  if (is_back) {
    memcpy(b->models, s->models, nv * sizeof *s->models);
    memcpy(b->cam_from_rig, s->poses, nv * sizeof *s->poses);
    memcpy(b->points, s->points, np * sizeof *s->points);
  } else {
    memcpy(s->models, b->models, nv * sizeof *s->models);
    memcpy(s->poses, b->cam_from_rig, nv * sizeof *s->poses);
    memcpy(s->points, b->points, np * sizeof *s->points);
  }
}

static int minimise(work *w, state *old) {
  double lambda = 1e-3, now = cost(w);
  int it = 0;
  for (; it < CAP_STEPS && isfinite(now); it++) {
    if (!build(w, lambda) || !factor(w->s, (size_t)w->n)) {
      lambda *= 10;
      if (lambda > 1e12) break;
      continue;
    }
    for (int i = 0; i < w->n; i++) w->step[i] = -w->g[i];
    substitute(w->s, (size_t)w->n, w->step);
    keep(w, old, false);
    old->log_focal = w->log_focal;
    move_points(w);
    move_views(w);
    double next = cost(w);
    if (next < now) {
      bool is_done = now - next < 1e-7 * now;
      now = next;
      lambda = lambda > 1e-9 ? 0.2 * lambda : lambda;
      if (is_done) break;
    } else {
      keep(w, old, true);
      w->log_focal = old->log_focal;
      lambda *= 8;
      if (lambda > 1e12) break;
    }
  }
  return it;
}

// --- rounds --------------------------------------------------------------------------------------
static int compare(const void *a, const void *b) {
  double x = *(const double *)a, y = *(const double *)b;
  return (x > y) - (x < y);
}

// Deviation of a coordinate by the median of |r|: 1.1774 sigma for two normal coordinates.
static void measure(work *w, sv_array_stats *st, bool is_marking) {
  sv_lens_array *b = w->b;
  linear l;
  int n = 0;
  for (int i = 0; i < b->n_observations; i++)
    if (residual(b, &b->observations[i], &l, false)) w->abs_r[n++] = sqrt(l.r[0] * l.r[0] + l.r[1] * l.r[1]);
  qsort(w->abs_r, (size_t)n, sizeof *w->abs_r, compare);
  w->sigma = n ? fmax(w->abs_r[n / 2] / 1.1774, 1e-4) : 1;
  double sum = 0;
  st->n_outliers = n = 0;
  for (int i = 0; i < b->n_observations; i++) {
    sv_array_observation *o = &b->observations[i];
    bool is_good = residual(b, o, &l, false);
    double r = is_good ? sqrt(l.r[0] * l.r[0] + l.r[1] * l.r[1]) : INFINITY;
    if (is_marking) o->is_outlier = !(r < OUTLIER * 1.1774 * w->sigma);
    if (o->is_outlier) st->n_outliers++;
    else {
      sum += r * r;
      n++;
    }
  }
  st->sigma_px = w->sigma;
  st->rms_px = n ? sqrt(sum / n) : INFINITY;
}

static bool uncertainty(work *w, sv_array_stats *st) {
  double rot = 0, focal = 0, centre = 0;
  size_t n = (size_t)w->n;
  if (!build(w, 1e-9) || !factor(w->s, n)) return false;
  for (int c = 1; c < w->b->n_views; c++)
    for (int k = 0; k < N_CAM; k++) {
      if (k >= 3 && k < 6) continue;
      memset(w->step, 0, n * sizeof(double));
      w->step[c * N_CAM + k] = 1;
      substitute(w->s, n, w->step);
      double var = w->step[c * N_CAM + k] * w->sigma * w->sigma;
      if (k < 3) rot += var;
      else if (k == 6) focal += var * w->b->models[c].p[0] * w->b->models[c].p[0];
      else centre += var;
    }
  double m = w->b->n_views > 1 ? w->b->n_views - 1 : 1;
  st->rotation_sd_deg = sqrt(rot / m) * 180 / SV_PI;
  st->focal_sd_px = w->b->is_lens_fixed ? 0 : sqrt(focal / m);
  st->centre_sd_px = w->b->is_lens_fixed ? 0 : sqrt(centre / (2 * m));
  return true;
}

// Without a held size the normal equations are singular and steps wander along it.
static void choose_scale(work *w) {
  double most = 0;
  w->i_scale = -1;
  for (int c = 1; c < w->b->n_views; c++)
    for (int k = 0; k < 3; k++)
      if (fabs(w->b->cam_from_rig[c].t[k]) > most) {
        most = fabs(w->b->cam_from_rig[c].t[k]);
        w->i_scale = c * N_CAM + 3 + k;
      }
}

static sv_status run(work *w, state *old, int n_rounds, sv_array_stats *st, sv_err *err) {
  sv_lens_array *b = w->b;
  double sum = 0;
  for (int c = 0; c < b->n_views; c++) sum += b->models[c].p[0];
  w->focal0 = sum / b->n_views;
  w->log_focal = 0;
  memset(st, 0, sizeof *st);
  choose_scale(w);
  measure(w, st, true);
  for (int round = 0; round < n_rounds; round++) {
    st->n_iterations += minimise(w, old);
    measure(w, st, true);
  }
  if (!isfinite(st->rms_px) || st->n_outliers * 2 > b->n_observations || !uncertainty(w, st))
    return sv_fail(err, SV_E_FORMAT,
                   "bundle adjustment found no solution that fits most of the %d observations",
                   b->n_observations);
  return SV_OK;
}

sv_status sv_array_solve(sv_lens_array *b, int n_rounds, sv_array_stats *stats, sv_err *err) {
  work w = {.b = b, .n = b->n_views * N_CAM + 1, .sigma = 1};
  size_t n = (size_t)w.n, np = (size_t)b->n_points, nv = (size_t)b->n_views;
  state old = {malloc(nv * sizeof *old.models), malloc(nv * sizeof *old.poses),
               malloc(np * sizeof *old.points), 0};
  w.s = malloc(n * n * sizeof(double));
  w.g = malloc(n * sizeof(double));
  w.step = malloc(n * sizeof(double));
  w.w = malloc(256 * N_CAM * 3 * sizeof(double));
  w.first = calloc(np + 1, sizeof(int));
  w.vinv = calloc(np * 9, sizeof(double));
  w.gp = calloc(np * 3, sizeof(double));
  w.abs_r = malloc((size_t)b->n_observations * sizeof(double) + 8);
  sv_status s = SV_OK;
  if (!old.models || !old.poses || !old.points || !w.s || !w.g || !w.step || !w.w || !w.first || !w.vinv ||
      !w.gp || !w.abs_r)
    s = sv_fail(err, SV_E_NOMEM, "no memory for a bundle adjustment of %d views and %d points", b->n_views,
                b->n_points);
  if (s == SV_OK) {
    for (int i = 0; i < b->n_observations; i++) w.first[b->observations[i].point + 1]++;
    for (size_t p = 0; p < np; p++) w.first[p + 1] += w.first[p];
    s = run(&w, &old, n_rounds, stats, err);
  }
  free(old.models);
  free(old.poses);
  free(old.points);
  free(w.s);
  free(w.g);
  free(w.step);
  free(w.w);
  free(w.first);
  free(w.vinv);
  free(w.gp);
  free(w.abs_r);
  return s;
}
