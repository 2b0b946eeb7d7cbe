// SPDX-License-Identifier: Apache-2.0
// What one unit of a monocular camera's poses is in meters. A point x is triangulated from the
// stream's own poses, in their unit. At each exposure the stream sees it at R x + t; so the camera
// beside it, at cam_from_stream, sees it at cam_from_stream (s (R x + t)): one unknown for all.
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "tools/import/refine.h"

#define N_ENOUGH     20
#define N_ITERATIONS 30
#define CAP_VIEWS    64 // of a point
#define GOOD_PX      2.0

typedef struct {
  double in_stream[3]; // where the stream sees the point, in its unit
  sv_pose cam_from_stream;
  double ray[2], f_px; // the other camera's observation
} pair_seen;

typedef struct {
  pair_seen *at;
  int n, cap;
} pair_list;

static int by_value(const void *a, const void *b) {
  double x = *(const double *)a, y = *(const double *)b;
  return x < y ? -1 : x > y;
}

// The residual at scale s in pixels, and its derivative by log s. False behind the camera.
static bool residual(const pair_seen *p, double s, double r[2], double d[2]) {
  double x[3] = {s * p->in_stream[0], s * p->in_stream[1], s * p->in_stream[2]}, c[3], g[3];
  sv_pose_apply(c, &p->cam_from_stream, x);
  sv_apply33(g, p->cam_from_stream.r, x); // d c / d log s
  if (!(c[2] > 0)) return false;
  for (int k = 0; k < 2; k++) {
    r[k] = p->f_px * (c[k] / c[2] - p->ray[k]);
    d[k] = p->f_px * (g[k] - c[k] / c[2] * g[2]) / c[2];
  }
  return true;
}

// The scale that one pair tells by itself: where along the line the residual is least. 0: none.
static double scale_of(const pair_seen *p) {
  // cam = s g + t: cross product with the ray, least squares in s.
  double g[3], up = 0, down = 0;
  const double *t = p->cam_from_stream.t;
  sv_apply33(g, p->cam_from_stream.r, p->in_stream);
  for (int k = 0; k < 2; k++) {
    double a = g[k] - p->ray[k] * g[2], b = t[k] - p->ray[k] * t[2];
    up -= a * b;
    down += a * a;
  }
  return down > 0 && up > 0 ? up / down : 0;
}

static bool ray_of(const lab_import_view *v, const sv_array_observation *o, double ray[2]) {
  double d[3];
  if (!sv_model_unproject(&v->model, o->uv_px, d) || !(d[2] > 0.05)) return false;
  ray[0] = d[0] / d[2];
  ray[1] = d[1] / d[2];
  return true;
}

static bool add_pair(pair_list *l, const pair_seen *p) {
  if (l->n == l->cap) {
    int cap = l->cap ? 2 * l->cap : 256;
    void *more = realloc(l->at, (size_t)cap * sizeof *l->at);
    if (!more) return false;
    l->at = more;
    l->cap = cap;
  }
  l->at[l->n++] = *p;
  return true;
}

// Pairs of one point: observations by the stream place it, others are compared.
static bool add_point(pair_list *l, const lab_import *im, const lab_matches *m, int i_point, int i_stream) {
  lab_ray rays[CAP_VIEWS];
  double x[3];
  int n = 0;
  for (int i = m->first[i_point]; i < m->first[i_point + 1]; i++) {
    const lab_import_view *v = &im->views[m->obs[i].view];
    if (v->sub_view != i_stream || n == CAP_VIEWS || !ray_of(v, &m->obs[i], rays[n].ray)) continue;
    rays[n++].cam_from_world = v->cam_from_world;
  }
  if (n < 2 || !lab_triangulate(rays, n, x)) return true;
  for (int i = 0; i < n; i++) { // what does not agree with the stream's own poses tells nothing
    double c[3];
    sv_pose_apply(c, &rays[i].cam_from_world, x);
    if (hypot(c[0] / c[2] - rays[i].ray[0], c[1] / c[2] - rays[i].ray[1]) > 0.01) return true;
  }
  for (int i = m->first[i_point]; i < m->first[i_point + 1]; i++) {
    const lab_import_view *v = &im->views[m->obs[i].view];
    if (v->sub_view == i_stream) continue;
    for (int k = 0; k < im->n; k++) {
      const lab_import_view *stream = &im->views[k];
      pair_seen p = {.f_px = v->model.p[0]};
      if (stream->sub_view != i_stream || stream->exposure != v->exposure) continue;
      sv_pose world_from_stream = sv_pose_inv(&stream->cam_from_world);
      p.cam_from_stream = sv_pose_mul(&v->cam_from_world, &world_from_stream);
      sv_pose_apply(p.in_stream, &stream->cam_from_world, x);
      if (p.in_stream[2] > 0 && ray_of(v, &m->obs[i], p.ray) && !add_pair(l, &p)) return false;
      break;
    }
  }
  return true;
}

static double median_scale(const pair_list *l, double *work) {
  int n = 0;
  for (int i = 0; i < l->n; i++) {
    double s = scale_of(&l->at[i]);
    if (s > 0) work[n++] = s;
  }
  if (n < N_ENOUGH) return 0;
  qsort(work, (size_t)n, sizeof *work, by_value);
  return work[n / 2];
}

// Gauss-Newton on log s under Huber's loss.
static int improve(const pair_list *l, double *s, double *sigma) {
  int n = 0;
  for (int round = 0; round < N_ITERATIONS; round++) {
    double up = 0, down = 0, sum = 0;
    n = 0;
    for (int i = 0; i < l->n; i++) {
      double r[2], d[2];
      if (!residual(&l->at[i], *s, r, d)) continue;
      double size = hypot(r[0], r[1]), w = size > GOOD_PX ? GOOD_PX / size : 1;
      up += w * (r[0] * d[0] + r[1] * d[1]);
      down += w * (d[0] * d[0] + d[1] * d[1]);
      sum += w * size * size;
      n += size < 4 * GOOD_PX;
    }
    if (!(down > 0)) return 0;
    double step = fmax(-0.5, fmin(0.5, -up / down));
    *s *= exp(step);
    *sigma = sqrt(sum / (2 * fmax(n, 1)) / down);
    if (fabs(step) < 1e-9) break;
  }
  return n;
}

sv_status lab_scale_find(lab_scale *out, const lab_import *im, const lab_matches *m, int i_stream,
                         sv_err *err) {
  pair_list l = {0};
  bool has_memory = true;
  memset(out, 0, sizeof *out);
  for (int i = 0; i < m->n_points && has_memory; i++) has_memory = add_point(&l, im, m, i, i_stream);
  double *work = malloc(((size_t)l.n + 1) * sizeof *work);
  if (work && has_memory && (out->unit_m = median_scale(&l, work)) > 0)
    out->n_points = improve(&l, &out->unit_m, &out->sigma);
  free(work);
  free(l.at);
  if (!work || !has_memory) return sv_fail(err, SV_E_NOMEM, "no memory for %d matches", m->n_obs);
  return out->n_points >= N_ENOUGH
             ? SV_OK
             : sv_fail(err, SV_E_NOT_FOUND,
                       "the images do not tell the scale of the poses: %d matches between the rig's cameras, "
                       "%d needed; give --unit",
                       out->n_points, N_ENOUGH);
}

void lab_scale_apply(lab_import *im, int i_stream, double unit_m) {
  for (int i = 0; i < im->n; i++) {
    lab_import_view *v = &im->views[i];
    v->depth_unit *= unit_m;
    for (int k = 0; k < im->n && v->sub_view != i_stream; k++) {
      const lab_import_view *stream = &im->views[k];
      if (stream->sub_view != i_stream || stream->exposure != v->exposure) continue;
      sv_pose world_from_stream = sv_pose_inv(&stream->cam_from_world), moved = stream->cam_from_world;
      sv_pose cam_from_stream = sv_pose_mul(&v->cam_from_world, &world_from_stream);
      for (int a = 0; a < 3; a++) moved.t[a] *= unit_m;
      v->cam_from_world = sv_pose_mul(&cam_from_stream, &moved);
      break;
    }
  }
  for (int i = 0; i < im->n; i++)
    for (int a = 0; a < 3 && im->views[i].sub_view == i_stream; a++)
      im->views[i].cam_from_world.t[a] *= unit_m;
  for (int i = 0; i < im->n_points; i++)
    for (int a = 0; a < 3; a++) im->points[i].mean[a] *= (float)unit_m;
}
