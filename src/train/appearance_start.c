// SPDX-License-Identifier: Apache-2.0
#include "src/train/appearance_start.h"

#include <string.h>

#include "src/base/cholesky.h"
#include "src/base/mathx.h"
#include "src/train/appearance_matrix.h"

#define N_ROUNDS    8 // of reweighted least squares
#define CAP_CAMERAS (SV_CAP_APPEARANCE_UNKNOWNS / 3)
#define N_TURNS     4 // of gains and falloff, and matrices
#define MIN_POINTS  64
// What is known of lenses before anything is seen, as standard deviations of f1 and f2: about 0,
// and of each camera about the cameras' mean. Cameras of one device are made alike, and what one
// camera alone sees tells nothing of its falloff.
#define N_FALLOFF 2
static const double falloff_sigma[N_FALLOFF] = {1.0, 0.4}, unlike_sigma[N_FALLOFF] = {0.28, 0.14};

#define RIDGE 1e-7 // of the mean of the diagonal: what nothing tells stays 0
// What lenses leave of the light towards the corners. Where views hardly overlap, or what they see
// is badly placed, the falloff that fits best is none of a lens: then it is not estimated.
#define LEAST_LIGHT 0.15
#define MOST_LIGHT  1.15
// Natural logarithm: residuals from here on count less, in the first round and, halved each round,
// in the end. Small from the start, exposures that differ much would be taken for outliers.
#define FIRST_SPREAD      2.0
#define SPREAD            0.1
#define MIXING            5.0  // standard deviations at which a term off the diagonal is real
#define UNCERTAIN_FALLOFF 0.25 // of the light at the corner: one standard deviation
#define UNKNOWN           0.1  // a gain whose logarithm is that uncertain is not known

// What one view tells of one point: unknowns i with factors h.
typedef struct {
  int i[4];
  double h[4];
  int n;
} row;

typedef struct {
  sv_trainer *t;
  sv_appearance_points points;
  int n; // unknowns of a channel
  int n_cameras, n_exposures;
  double *a, *b, *x; // [n][n], [n], [n]
  double spread, sum_w, sum_we2;
  bool has_falloff;
  bool is_mixed[CAP_CAMERAS];        // mixing was taken out of what the camera's views show:
  double taken[CAP_CAMERAS][9];      // this
  sv_photometry before[CAP_CAMERAS]; // what was measured before
  // Of the point that is being added: the views that see it.
  row rows[SV_APPEARANCE_CAP_VIEWS];
  double w[SV_APPEARANCE_CAP_VIEWS], y[SV_APPEARANCE_CAP_VIEWS];
  double solved[3][SV_CAP_APPEARANCE_UNKNOWNS];
  sv_appearance_view views[SV_APPEARANCE_CAP_VIEWS];
} problem;

static int n_unknowns(const sv_appearance_cfg *c) { return 3 * c->n_cameras + c->n_exposures; }

static bool is_small(const sv_appearance_cfg *c) {
  return c->n_cameras > 0 && n_unknowns(c) <= SV_CAP_APPEARANCE_UNKNOWNS;
}

static size_t system_bytes(int n) { return ((size_t)n * (size_t)n + 2 * (size_t)n) * sizeof(double); }

size_t sv_appearance_start_bytes(const sv_train_cfg *c) {
  if (!is_small(&c->appearance)) return 0;
  return sv_appearance_points_bytes(c) + system_bytes(n_unknowns(&c->appearance)) + sizeof(problem) +
         8 * SV_ARENA_ALIGN;
}

// --- the system of one channel -------------------------------------------------------------------

static row row_of(const problem *p, int k, float r2) {
  const int c = p->t->appearance.camera_of[p->points.view[k]],
            e = p->t->appearance.exposure_of[p->points.view[k]];
  const double q = (double)r2;
  row r = {{c, p->n_cameras + c, 2 * p->n_cameras + c}, {1, q, q * q}, 3};
  if (e >= 0) {
    r.i[3] = 3 * p->n_cameras + e;
    r.h[3] = 1;
    r.n = 4;
  }
  return r;
}

static double model(const problem *p, const row *r) {
  double y = 0;
  for (int i = 0; i < r->n; i++) y += r->h[i] * p->x[r->i[i]];
  return y;
}

// Adds a point, its own color eliminated: with weights w, sum w h h^T - (sum w h)(sum w h)^T / sum
// w.
static void add_point(problem *p, const sv_appearance_seen *seen, int channel) {
  row *rows = p->rows;
  double *w = p->w, *y = p->y, sum_w = 0, mean_y = 0, residual = 0;
  int n = 0;
  for (int k = 0; k < p->points.n_views; k++) {
    if (seen[k].r2 < 0) continue;
    rows[n] = row_of(p, k, seen[k].r2);
    y[n] = (double)seen[k].log_value[channel];
    residual += y[n] - model(p, &rows[n]);
    n++;
  }
  if (n < 2) return;
  residual /= n;
  for (int k = 0; k < n; k++) { // Geman and McClure's weights
    const double e = (y[k] - model(p, &rows[k]) - residual) / p->spread;
    w[k] = 1 / ((1 + e * e) * (1 + e * e));
    p->sum_w += w[k];
    p->sum_we2 += w[k] * e * e * p->spread * p->spread;
    sum_w += w[k];
    mean_y += w[k] * y[k];
  }
  mean_y /= sum_w;
  for (int k = 0; k < n; k++)
    for (int i = 0; i < rows[k].n; i++) {
      const int at = rows[k].i[i];
      p->b[at] += w[k] * rows[k].h[i] * (y[k] - mean_y);
      for (int j = 0; j < rows[k].n; j++)
        p->a[at * p->n + rows[k].i[j]] += w[k] * rows[k].h[i] * rows[k].h[j];
      for (int l = 0; l < n; l++)
        for (int j = 0; j < rows[l].n; j++)
          p->a[at * p->n + rows[l].i[j]] -= w[k] * w[l] / sum_w * rows[k].h[i] * rows[l].h[j];
    }
}

// Adds what is known of the falloffs, in observations: SV_APPEARANCE_ALIKE of them count as one,
// each as uncertain as the residuals are.
static void add_falloff_prior(problem *p) {
  const double variance = SV_APPEARANCE_ALIKE * p->sum_we2 / p->sum_w;
  const int n = p->n_cameras;
  for (int k = 0; k < N_FALLOFF; k++) {
    const double about_0 = variance / (falloff_sigma[k] * falloff_sigma[k]),
                 about_mean = variance / (unlike_sigma[k] * unlike_sigma[k]);
    for (int c = 0; c < n; c++) {
      double *at = p->a + ((k + 1) * n + c) * p->n + (k + 1) * n;
      at[c] += about_0 + about_mean;
      for (int d = 0; d < n; d++) at[d] -= about_mean / n;
    }
  }
}

// Adds what is known beforehand, and fixes what the others are compared with.
static void add_prior(problem *p, double mean) {
  const double fixed = 1e6 * mean;
  for (int i = 0; i < p->n; i++) p->a[i * (p->n + 1)] += RIDGE * mean;
  if (p->has_falloff) add_falloff_prior(p);
  for (int i = p->n_cameras; i < 3 * p->n_cameras && !p->has_falloff; i++) p->a[i * (p->n + 1)] += fixed;
  p->a[0] += fixed; // camera 0 and exposure 0
  if (p->n_exposures > 0) p->a[3 * p->n_cameras * (p->n + 1)] += fixed;
}

// Standard deviation of the sum of two unknowns (or of one: i = k), of the system solved last.
static double sigma_of(problem *p, int i, int k) {
  memset(p->b, 0, (size_t)p->n * sizeof *p->b);
  p->b[i] = p->b[k] = 1;
  sv_cholesky_solve(p->a, p->n, p->b);
  const double sum = i == k ? p->b[i] : p->b[i] + p->b[k];
  return sqrt(SV_APPEARANCE_ALIKE * p->sum_we2 / p->sum_w * sum);
}

// Logarithms' standard deviations are those of shares of the light.
static void keep_sigma(problem *p, int channel) {
  for (int c = 0; c < p->n_cameras; c++) {
    sv_photometry *m = &p->t->appearance.measured[c];
    m->color_sigma[channel] = c > 0 ? sigma_of(p, c, c) : 0;
    const double corner =
        p->has_falloff ? sigma_of(p, p->n_cameras + c, 2 * p->n_cameras + c) : SV_APPEARANCE_UNKNOWN;
    m->falloff_sigma = channel > 0 ? sv_maxd(m->falloff_sigma, corner) : corner;
  }
}

static bool solve_channel(problem *p, int channel) {
  const sv_appearance_points *points = &p->points;
  memset(p->x, 0, (size_t)p->n * sizeof *p->x);
  for (int round = 0; round < N_ROUNDS; round++) {
    double mean = 0;
    p->spread = round > 0 ? (double)sv_maxf((float)(0.5 * p->spread), (float)SPREAD) : FIRST_SPREAD;
    p->sum_w = p->sum_we2 = 0;
    memset(p->a, 0, (size_t)p->n * (size_t)p->n * sizeof *p->a);
    memset(p->b, 0, (size_t)p->n * sizeof *p->b);
    for (int i = 0; i < points->n_points; i++) add_point(p, points->seen + i * points->n_views, channel);
    for (int i = 0; i < p->n; i++) mean += p->a[i * (p->n + 1)] / p->n;
    if (!(mean > 0)) return false;
    add_prior(p, mean);
    if (!sv_cholesky(p->a, p->n)) return false;
    memcpy(p->x, p->b, (size_t)p->n * sizeof *p->x);
    sv_cholesky_solve(p->a, p->n, p->x);
  }
  memcpy(p->solved[channel], p->x, (size_t)p->n * sizeof *p->x);
  keep_sigma(p, channel);
  return true;
}

// --- from logarithms to groups -------------------------------------------------------------------

// Of logarithms f1 q + f2 q^2.
static void falloff_of(const double f[2], double k[3]) {
  double light[3];
  for (int i = 0; i < 3; i++) {
    const double q = (i + 1) / 3.0;
    light[i] = sv_exp(q * (f[0] + q * f[1]));
  }
  sv_photometry_fit(light, k);
}

// Adam goes on from here.
static void keep_start(sv_appearance_group *g, int n) {
  for (int i = 0; i < n; i++) {
    memcpy(g[i].start, g[i].p, sizeof g[i].start);
    memset(g[i].m, 0, sizeof g[i].m);
    memset(g[i].v, 0, sizeof g[i].v);
    g[i].n_steps = 0;
  }
}

// Of a camera, the mean of the channels.
static void solved_falloff(const problem *p, int c, double f[2]) {
  for (int j = 0; j < 2; j++) {
    f[j] = 0;
    for (int k = 0; k < 3; k++) f[j] += p->solved[k][(j + 1) * p->n_cameras + c] / 3;
  }
}

static bool is_of_lenses(const problem *p) {
  for (int c = 0; c < p->n_cameras; c++)
    for (int i = 1; i <= 4; i++) {
      double f[2];
      solved_falloff(p, c, f);
      const double q = i / 4.0, light = sv_exp(f[0] * q + f[1] * q * q);
      if (!(light >= LEAST_LIGHT && light <= MOST_LIGHT)) return false;
    }
  return true;
}

static bool solve(problem *p, bool has_falloff) {
  p->has_falloff = has_falloff;
  return solve_channel(p, 0) && solve_channel(p, 1) && solve_channel(p, 2);
}

static void describe_views(problem *p) {
  const sv_appearance *a = &p->t->appearance;
  for (int k = 0; k < p->points.n_views; k++) {
    const int i_view = p->points.view[k], e = a->exposure_of[i_view];
    double f[2];
    solved_falloff(p, a->camera_of[i_view], f);
    p->views[k] = (sv_appearance_view){.i_camera = a->camera_of[i_view], .f1 = f[0], .f2 = f[1]};
    for (int c = 0; c < 3 && e >= 0; c++) p->views[k].exposure[c] = p->solved[c][3 * p->n_cameras + e];
  }
}

// Whether a camera mixes channels. Where nothing speaks for it, gains alone are more certain.
static bool has_mixing(const sv_appearance_matrix *found) {
  for (int i = 0; i < 9; i++)
    if (i % 4 && fabs(found->m[i]) > MIXING * found->sigma[i]) return true;
  return false;
}

// A camera's matrix from what its pictures show now, row-major, whose gains are g; false: none but
// the gains.
static bool find_matrix(problem *p, int c, const double g[3], double m[9]) {
  sv_photometry *measured = &p->t->appearance.measured[c];
  sv_appearance_matrix found;
  memset(m, 0, 9 * sizeof *m);
  for (int k = 0; k < 3; k++) m[4 * k] = g[k];
  if (c == 0 || !sv_appearance_matrix_solve(&p->points, p->views, c, g, &found)) return false;
  measured->mix_sigma = 0;
  for (int i = 0; i < 9; i++)
    if (i % 4) measured->mix_sigma = sv_maxd(measured->mix_sigma, found.sigma[i] / g[i / 3]);
  if (!p->is_mixed[c] && !has_mixing(&found)) return false;
  for (int k = 0; k < 3; k++)
    measured->color_sigma[k] = sv_maxd(measured->color_sigma[k], found.sigma[4 * k] / g[k]);
  memcpy(m, found.m, sizeof found.m);
  return true;
}

// Takes a camera's mixing out of what its views show, as though it had the gains g alone: points
// of all colors then tell the falloff. Notes what was taken out.
static bool unmix(problem *p, int c, const double g[3], const double m[9]) {
  sv_photometry now = {0};
  double inverse[9], share[9];
  memcpy(now.color, m, sizeof now.color);
  if (!sv_photometry_inverse(&now, inverse)) return false;
  for (int i = 0; i < 9; i++) share[i] = m[i] / g[i % 3];
  sv_mul33(p->taken[c], p->taken[c], share);
  for (int k = 0; k < p->points.n_views; k++) {
    const sv_appearance_view *v = &p->views[k];
    for (int i = 0; i < p->points.n_points && v->i_camera == c; i++) {
      sv_appearance_seen *s = &p->points.seen[i * p->points.n_views + k];
      double light[3], out[3];
      if (s->r2 < 0) continue;
      for (int j = 0; j < 3; j++) light[j] = sv_exp((double)s->log_value[j] - v->exposure[j]);
      sv_apply33(out, inverse, light);
      if (!(out[0] > 0 && out[1] > 0 && out[2] > 0)) s->r2 = -1;
      for (int j = 0; j < 3 && s->r2 >= 0; j++)
        s->log_value[j] = (float)(sv_log(g[j] * out[j]) + v->exposure[j]);
    }
  }
  return true;
}

// Gains and falloff come from logarithms, which mixed channels distort; matrices come from what
// gains and falloff leave. So they take turns while there is mixing. False: not solvable.
static bool estimate(problem *p) {
  bool is_again = true;
  for (int c = 0; c < p->n_cameras; c++)
    for (int i = 0; i < 9; i++) p->taken[c][i] = i % 4 == 0;
  for (int turn = 0; turn < N_TURNS && is_again; turn++) {
    is_again = false;
    if (!solve(p, true) || (!is_of_lenses(p) && !solve(p, false))) return false;
    describe_views(p);
    for (int c = 0; c < p->n_cameras; c++) {
      double g[3] = {1, 1, 1}, m[9];
      for (int k = 0; k < 3 && c > 0; k++) g[k] = sv_exp(p->solved[k][c]);
      const bool is_mixed = find_matrix(p, c, g, m);
      sv_mul33(p->t->appearance.measured[c].color, p->taken[c], m);
      if (is_mixed && turn < N_TURNS - 1 && unmix(p, c, g, m)) p->is_mixed[c] = is_again = true;
    }
  }
  return true;
}

static void set_camera(problem *p, int c) {
  sv_appearance_group *g = &p->t->appearance.camera[c];
  sv_photometry *measured = &p->t->appearance.measured[c];
  double f[2];
  solved_falloff(p, c, f);
  falloff_of(f, measured->falloff);
  measured->falloff_sigma *= sv_exp(f[0] + f[1]);
  measured->is_known = true;
  for (int k = 0; k < 3; k++) measured->is_known &= measured->color_sigma[k] < UNKNOWN;
  if (!measured->is_known) return; // training finds it from no difference
  memcpy(g->p, measured->color, sizeof measured->color);
  memcpy(g->p + 12, measured->falloff, sizeof measured->falloff);
}

// Where no two cameras could be compared, the points are no surfaces, and tell nothing at all.
static bool is_certain(const problem *p) {
  int n = 0;
  for (int c = 1; c < p->n_cameras; c++) {
    const double *sigma = p->t->appearance.measured[c].color_sigma;
    n += sigma[0] < UNKNOWN && sigma[1] < UNKNOWN && sigma[2] < UNKNOWN;
  }
  return n > 0 || p->n_cameras == 1;
}

static void set_groups(problem *p) {
  sv_appearance *a = &p->t->appearance;
  for (int c = 0; c < p->n_cameras; c++) set_camera(p, c);
  for (int e = 1; e < p->n_exposures; e++) {
    memset(a->exposure[e].p, 0, 9 * sizeof *a->exposure[e].p);
    for (int k = 0; k < 3; k++) a->exposure[e].p[4 * k] = sv_exp(p->solved[k][3 * p->n_cameras + e]);
  }
  keep_start(a->camera, p->n_cameras);
  keep_start(a->exposure, p->n_exposures);
}

bool sv_appearance_is_uncertain(const sv_trainer *t) {
  const sv_photometry *m = t->appearance.measured;
  const bool is_alone = t->n_views <= t->cfg.appearance.n_cameras; // one exposure
  for (int c = 0; c < t->cfg.appearance.n_cameras; c++)
    if (!m[c].is_known || (is_alone && m[c].falloff_sigma > UNCERTAIN_FALLOFF)) return true;
  return false;
}

sv_status sv_appearance_start(sv_trainer *t, sv_arena *scratch, int *n_points) {
  const sv_appearance_cfg *c = &t->cfg.appearance;
  *n_points = 0;
  if (!is_small(c) || t->n_views < 2) return SV_OK;
  const size_t mark = sv_arena_mark(scratch);
  problem *p = SV_TAKE(scratch, problem, 1);
  sv_status s = scratch->status;
  if (s >= 0) {
    *p = (problem){.t = t, .n_cameras = c->n_cameras, .n_exposures = c->n_exposures, .n = n_unknowns(c)};
    p->a = SV_TAKE(scratch, double, (size_t)p->n *(size_t)p->n);
    p->b = SV_TAKE(scratch, double, p->n);
    p->x = SV_TAKE(scratch, double, p->n);
    if ((s = scratch->status) >= 0) s = sv_appearance_points_find(&p->points, t, scratch);
  }
  if (s >= 0 && (*n_points = p->points.n_shared) >= MIN_POINTS) {
    const size_t bytes = (size_t)c->n_cameras * sizeof *p->before;
    memcpy(p->before, t->appearance.measured, bytes);
    if (estimate(p) && is_certain(p)) set_groups(p);
    else memcpy(t->appearance.measured, p->before, bytes);
  }
  sv_arena_reset(scratch, mark);
  return s;
}
