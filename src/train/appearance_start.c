// SPDX-License-Identifier: Apache-2.0
#include "src/train/appearance_start.h"

#include <string.h>

#include "src/base/cholesky.h"
#include "src/base/mathx.h"
#include "src/train/step.h"

#define MAX_POINTS  4096
#define MAX_VIEWS   64   // of those that are looked at
#define N_ROUNDS    8    // of reweighted least squares
#define DEPTH_SHARE 0.03 // of the depth: a point so near to what a view shows is what it shows
#define MIN_POINTS  64
#define DARK        16 // of 255; below, noise and black level count more than gains
#define BRIGHT      245
#define RIDGE       1e-3 // of the mean of the diagonal
// Of exposures: more would pull all of them towards the first one's brightness, as few views of
// many are its.
#define EXPOSURE_RIDGE 1e-7
// What lenses leave of the light towards the corners. Where views hardly overlap, or what they see
// is badly placed, the falloff that fits best is none of a lens: then it is not estimated.
#define LEAST_LIGHT 0.15
#define MOST_LIGHT  1.15
// Natural logarithm: residuals from here on count less, in the first round and, halved each round,
// in the end. Small from the start, exposures that differ much would be taken for outliers.
#define FIRST_SPREAD 2.0
#define SPREAD       0.1

typedef struct {
  float log_value[3], r2; // r2 < 0: not seen
} observation;

// What one view tells of one point: unknowns i with factors h.
typedef struct {
  int i[4];
  double h[4];
  int n;
} row;

typedef struct {
  sv_trainer *t;
  int n_points, n_views, stride, n; // of points one of so many Gaussians; n: unknowns of a channel
  int n_cameras, n_exposures;
  int view[MAX_VIEWS];
  observation *seen; // [n_points][n_views]
  double *a, *b, *x; // [n][n], [n], [n]
  double spread;
  bool has_falloff;
  // Of the point that is being added: the views that see it.
  row rows[MAX_VIEWS];
  double w[MAX_VIEWS], y[MAX_VIEWS];
  double solved[3][SV_CAP_APPEARANCE_UNKNOWNS];
} problem;

static int n_unknowns(const sv_appearance_cfg *c) { return 3 * c->n_cameras + c->n_exposures; }

static bool is_small(const sv_appearance_cfg *c) {
  return c->n_cameras > 0 && n_unknowns(c) <= SV_CAP_APPEARANCE_UNKNOWNS;
}

static size_t system_bytes(int n) { return ((size_t)n * (size_t)n + 2 * (size_t)n) * sizeof(double); }

size_t sv_appearance_start_bytes(const sv_train_cfg *c) {
  if (!is_small(&c->appearance)) return 0;
  const size_t points = (size_t)sv_mini(c->n_gaussians, MAX_POINTS),
               views = (size_t)sv_mini(c->cap_views, MAX_VIEWS);
  return points * views * sizeof(observation) + system_bytes(n_unknowns(&c->appearance)) + sizeof(problem) +
         8 * SV_ARENA_ALIGN;
}

// --- what is seen
// ----------------------------------------------------------------------------------

static double linear_of(double v) { return v <= 0.04045 ? v / 12.92 : sv_pow((v + 0.055) / 1.055, 2.4); }

// Logarithm of the light, mean over 3 x 3 pixels; false at the border, and where one is too dark or
// saturated.
static bool value_at(const sv_image_u8 *im, int x, int y, float out[3]) {
  int sum[3] = {0};
  if (im->n_channels < 3 || x < 1 || y < 1 || x + 1 >= im->width_px || y + 1 >= im->height_px) return false;
  for (int j = y - 1; j <= y + 1; j++)
    for (int i = x - 1; i <= x + 1; i++) {
      const uint8_t *p = im->px + (size_t)j * (size_t)im->stride_bytes + (size_t)(i * im->n_channels);
      if ((im->n_channels == 4 && p[3] < 255) || !sv_image_counts(im, 1, i, j)) return false;
      for (int k = 0; k < 3; k++) {
        if (p[k] < DARK || p[k] > BRIGHT) return false;
        sum[k] += p[k];
      }
    }
  for (int k = 0; k < 3; k++) out[k] = (float)sv_log(linear_of(sum[k] / (9.0 * 255.0)));
  return true;
}

static observation observe(const problem *p, const sv_train_view *tv, const float *mean) {
  const sv_view *v = &tv->view;
  const sv_renderer *r = &p->t->render;
  observation o = {.r2 = -1};
  float x[3];
  for (int i = 0; i < 3; i++)
    x[i] = v->r[3 * i] * mean[0] + v->r[3 * i + 1] * mean[16] + v->r[3 * i + 2] * mean[32] + v->t[i];
  float uv[2], z;
  if (!sv_view_project(v, x, uv, &z)) return o;
  const float u = uv[0], w = uv[1];
  if (!(u >= 1 && w >= 1 && u < (float)v->width_px - 1 && w < (float)v->height_px - 1)) return o;
  const size_t at = (size_t)w * (size_t)r->rgb.stride + (size_t)u;
  const float alpha = 1 - r->trans[at], depth = alpha > 0.5f ? r->depth[at] / alpha : 0;
  if (!(fabsf(depth - z) < (float)DEPTH_SHARE * z)) return o;
  if (!value_at(&tv->image, (int)u, (int)w, o.log_value)) return o;
  const float far_x = sv_maxf(v->cx, (float)v->width_px - v->cx),
              far_y = sv_maxf(v->cy, (float)v->height_px - v->cy), dx = u - v->cx, dy = w - v->cy;
  o.r2 = (dx * dx + dy * dy) / (far_x * far_x + far_y * far_y);
  return o;
}

static sv_status look(problem *p) {
  sv_trainer *t = p->t;
  sv_render_options o = sv_train_render_options(t, 1.0f, true);
  for (int k = 0; k < p->n_views; k++) {
    const sv_train_view *tv = &t->views[p->view[k]];
    sv_train_set_time(t, tv->view.time);
    sv_status s = sv_render(&t->render, &t->g, &tv->view, &o);
    if (s < 0) return s;
    for (int i = 0; i < p->n_points; i++)
      p->seen[i * p->n_views + k] = observe(p, tv, sv_gaussians_at(&t->g, i * p->stride, SV_ROW_MEAN));
  }
  return SV_OK;
}

// --- the system of one channel
// ---------------------------------------------------------------------

static row row_of(const problem *p, int k, float r2) {
  const int c = p->t->appearance.camera_of[p->view[k]], e = p->t->appearance.exposure_of[p->view[k]];
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
static void add_point(problem *p, const observation *seen, int channel) {
  row *rows = p->rows;
  double *w = p->w, *y = p->y, sum_w = 0, mean_y = 0, residual = 0;
  int n = 0;
  for (int k = 0; k < p->n_views; k++) {
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

static bool solve_channel(problem *p, int channel) {
  memset(p->x, 0, (size_t)p->n * sizeof *p->x);
  for (int round = 0; round < N_ROUNDS; round++) {
    double mean = 0;
    p->spread = round > 0 ? (double)sv_maxf((float)(0.5 * p->spread), (float)SPREAD) : FIRST_SPREAD;
    memset(p->a, 0, (size_t)p->n * (size_t)p->n * sizeof *p->a);
    memset(p->b, 0, (size_t)p->n * sizeof *p->b);
    for (int i = 0; i < p->n_points; i++) add_point(p, p->seen + i * p->n_views, channel);
    for (int i = 0; i < p->n; i++) mean += p->a[i * p->n + i] / p->n;
    if (!(mean > 0)) return false;
    for (int i = 0; i < p->n; i++)
      p->a[i * p->n + i] += (i < 3 * p->n_cameras ? RIDGE : EXPOSURE_RIDGE) * mean;
    for (int i = p->n_cameras; i < 3 * p->n_cameras && !p->has_falloff; i++) p->a[i * p->n + i] += 1e6 * mean;
    p->a[0] += 1e6 * mean; // camera 0 and exposure 0 are what the others are compared with
    if (p->n_exposures > 0) p->a[3 * p->n_cameras * (p->n + 1)] += 1e6 * mean;
    if (!sv_cholesky(p->a, p->n)) return false;
    memcpy(p->x, p->b, (size_t)p->n * sizeof *p->x);
    sv_cholesky_solve(p->a, p->n, p->x);
  }
  memcpy(p->solved[channel], p->x, (size_t)p->n * sizeof *p->x);
  return true;
}

// --- from logarithms to groups
// ---------------------------------------------------------------------

// k1, k2, k3 so that 1 + k1 q + k2 q^2 + k3 q^3 is exp(f1 q + f2 q^2) at q = 1/3, 2/3 and 1.
static void falloff_of(double f1, double f2, double k[3]) {
  double d[3];
  for (int i = 0; i < 3; i++) {
    const double q = (i + 1) / 3.0;
    d[i] = (sv_exp(f1 * q + f2 * q * q) - 1) / q;
  }
  // a parabola through three points one third apart, about the first
  const double second = 4.5 * (d[2] - 2 * d[1] + d[0]), first = 3 * (d[1] - d[0]) - second / 3;
  k[2] = second;
  k[1] = first - 2 * second / 3;
  k[0] = d[0] - first / 3 + second / 9;
}

static void keep_start(sv_appearance_group *g, int n) {
  for (int i = 0; i < n; i++) memcpy(g[i].start, g[i].p, sizeof g[i].start);
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

static void set_groups(problem *p) {
  sv_appearance *a = &p->t->appearance;
  for (int c = 0; c < p->n_cameras; c++) {
    double f[2];
    for (int k = 0; k < 3; k++) a->camera[c].p[4 * k] = c > 0 ? sv_exp(p->solved[k][c]) : 1;
    solved_falloff(p, c, f);
    falloff_of(f[0], f[1], a->camera[c].p + 12);
  }
  for (int e = 1; e < p->n_exposures; e++)
    for (int k = 0; k < 3; k++) a->exposure[e].p[4 * k] = sv_exp(p->solved[k][3 * p->n_cameras + e]);
  keep_start(a->camera, p->n_cameras);
  keep_start(a->exposure, p->n_exposures);
}

static int count_points(const problem *p) {
  int n = 0;
  for (int i = 0; i < p->n_points; i++) {
    int n_seen = 0;
    for (int k = 0; k < p->n_views; k++) n_seen += p->seen[i * p->n_views + k].r2 >= 0;
    n += n_seen > 1;
  }
  return n;
}

static void choose_views(problem *p) {
  const int n = p->t->n_views;
  p->n_views = sv_mini(n, MAX_VIEWS);
  for (int i = 0; i < p->n_views; i++) p->view[i] = (int)((long)i * n / p->n_views);
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
    choose_views(p);
    p->stride = (t->g.n + MAX_POINTS - 1) / MAX_POINTS;
    p->n_points = t->g.n / p->stride;
    p->seen = SV_TAKE(scratch, observation, (size_t)p->n_points * (size_t)p->n_views);
    p->a = SV_TAKE(scratch, double, (size_t)p->n *(size_t)p->n);
    p->b = SV_TAKE(scratch, double, p->n);
    p->x = SV_TAKE(scratch, double, p->n);
    if ((s = scratch->status) >= 0) s = look(p);
  }
  if (s >= 0 && (*n_points = count_points(p)) >= MIN_POINTS)
    if (solve(p, true) && (is_of_lenses(p) || solve(p, false))) set_groups(p);
  sv_arena_reset(scratch, mark);
  return s;
}
