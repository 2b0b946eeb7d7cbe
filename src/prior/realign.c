// SPDX-License-Identifier: Apache-2.0
// Aligned maps against the model as it is, where another view sees the same surface.
#include <math.h>
#include <string.h>

#include "src/base/mathx.h"
#include "src/prior/align.h"
#include "src/prior/solve.h"
#include "src/prior/views.h"

#define PARTNERS    2     // nearest other views that may confirm a surface
#define SAME        0.03f // relative: another view sees the surface at this depth
#define MIN_SHARE   20    // one of so many samples must be confirmed
#define MIN_SAMPLES 64
#define LEAST       0.1f // of the scene's inverse depth: smallest inverse depth of a map

static void world_from_pixel(const sv_view *v, int x, int y, float z, float *out) {
  float ray[3] = {0}, c[3];
  (void)sv_view_ray(v, (float)x + 0.5f, (float)y + 0.5f, ray);
  for (int i = 0; i < 3; i++) c[i] = ray[i] * z - v->t[i];
  for (int i = 0; i < 3; i++) out[i] = v->r[i] * c[0] + v->r[3 + i] * c[1] + v->r[6 + i] * c[2];
}

// Pixels that the map knows and the model covers, evenly over the picture, none confirmed.
static void take_samples(sv_prior *p, const sv_prior_depth *d, const sv_view *v) {
  const int stride = p->t->render.rgb.stride, step = sv_prior_stride(d);
  sv_prior_samples *s = p->samples;
  s->n = 0;
  for (int y = step / 2; y < d->height_px; y += step)
    for (int x = step / 2; x < d->width_px; x += step) {
      const float z = p->expected[(size_t)y * (size_t)stride + (size_t)x];
      if (d->map[(size_t)y * (size_t)d->width_px + (size_t)x] < 0.0f || !(z > 0.0f)) continue;
      const int k = sv_prior_add_sample(s, d, x, y, z);
      if (k < 0) return;
      world_from_pixel(v, x, y, z, s->point[k]);
      s->is_confirmed[k] = false;
    }
}

// The model as another view sees it has been rendered: samples that it sees are confirmed.
static void confirm(sv_prior *p, const sv_view *v) {
  sv_prior_samples *s = p->samples;
  const sv_planes *size = &p->t->render.rgb;
  for (int i = 0; i < s->n; i++) {
    const float *w = s->point[i];
    float c[3], uv[2], z;
    for (int k = 0; k < 3; k++)
      c[k] = v->r[3 * k] * w[0] + v->r[3 * k + 1] * w[1] + v->r[3 * k + 2] * w[2] + v->t[k];
    if (!sv_view_project(v, c, uv, &z)) continue;
    if (!(uv[0] >= 0.0f && uv[0] < (float)size->width_px)) continue;
    if (!(uv[1] >= 0.0f && uv[1] < (float)size->height_px)) continue;
    const float seen = p->expected[(size_t)(int)uv[1] * (size_t)size->stride + (size_t)(int)uv[0]];
    s->is_confirmed[i] |= seen > 0.0f && fabsf(seen - z) < SAME * z;
  }
}

// Cosine of the angle between two cameras, seen from the scene's center.
static double cosine(const sv_prior *p, int a, int b) {
  const int view[2] = {a, b};
  double d[2][3];
  for (int i = 0; i < 2; i++) {
    float eye[3];
    sv_view_centre(eye, &p->t->views[view[i]].view);
    for (int k = 0; k < 3; k++) d[i][k] = (double)eye[k] - (double)p->t->centre[k];
  }
  return sv_dot3(d[0], d[1]) / (sv_norm3(d[0]) * sv_norm3(d[1]) + 1e-30);
}

// The nearest other view beyond *last, a cosine, which becomes its own; -1: there is none.
static int next_partner(const sv_prior *p, int i_view, double *last) {
  double best = -2;
  int i_best = -1;
  for (int i = 0; i < p->t->n_views; i++) {
    const double c = i == i_view ? -2 : cosine(p, i, i_view);
    if (c >= *last || c <= best) continue;
    best = c;
    i_best = i;
  }
  *last = best;
  return i_best;
}

// What another view confirms moves to the front; returns how many there were of all.
static int keep_confirmed(sv_prior_samples *s) {
  const int n_all = s->n;
  int n = 0;
  for (int i = 0; i < n_all; i++) {
    if (!s->is_confirmed[i]) continue;
    s->map[n] = s->map[i];
    s->low[n] = s->low[i];
    memcpy(s->at[n++], s->at[i], sizeof s->at[i]);
  }
  s->n = n;
  return n_all;
}

static sv_status realign(sv_prior *p, sv_prior_depth *d, float progress, int *n_solved) {
  const sv_view *v = &p->t->views[d->id].view;
  double last = 2;
  sv_status s = sv_prior_render(p, v, progress);
  if (s < 0) return s;
  take_samples(p, d, v);
  for (int k = 0; k < PARTNERS; k++) {
    const int i = next_partner(p, d->id, &last);
    if (i < 0) break;
    if ((s = sv_prior_render(p, &p->t->views[i].view, progress)) < 0) return s;
    confirm(p, &p->t->views[i].view);
  }
  const int n_all = keep_confirmed(p->samples);
  if (p->samples->n * MIN_SHARE < n_all || p->samples->n < MIN_SAMPLES) return SV_OK;
  if (sv_prior_solve(p->samples, d, LEAST * d->unit)) *n_solved += 1;
  else d->trust = 0.0f; // its relief is turned inside out
  return SV_OK;
}

sv_status sv_prior_realign(sv_prior *p, float progress, int *n_solved) {
  sv_status s = SV_OK;
  *n_solved = 0;
  for (int i = 0; i < p->cfg.cap_depths && p->t->n_views > 1 && s >= 0; i++) {
    sv_prior_depth *d = &p->depths[i];
    if (d->kind != SV_PRIOR_ALIGNED || d->is_measured || d->id < 0 || d->id >= p->t->n_views) continue;
    s = realign(p, d, progress, n_solved);
  }
  return s;
}
