// SPDX-License-Identifier: Apache-2.0
#include "tools/train/align_view.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/cholesky.h"
#include "src/base/mathx.h"
#include "src/track/bundle.h"

#define COARSEST     4
#define LEAST_SIDE   40 // px of a coarse level
#define N_STEPS      12 // of a level at most
#define LEAST_ALPHA  0.5f
#define LEAST_CHANGE 1e-5 // of the error, relative: a level is done

// A level of the pyramid.
typedef struct {
  const lab_align_job *job;
  sv_view view; // reduced; its pose is moved
  int w, h;
  float *truth;     // [3][h][w]
  uint8_t *counted; // [h][w]
  float *image;     // [3][h][w] the last rendering
  float *depth;     // [h][w] its depth, 0: none
  float *plane;     // the renderer's
} level;

static sv_status render(level *l, double *mse, sv_err *err) {
  sv_renderer *r = &l->job->viewer->r;
  sv_render_options o = l->job->render;
  o.has_depth = true;
  sv_status s = sv_render(r, l->job->g, &l->view, &o);
  if (s < 0) return sv_fail(err, s, "a held-out view of %dx%d cannot be rendered", l->w, l->h);
  sv_render_expected_depth(r, LEAST_ALPHA, l->plane);
  const size_t stride = (size_t)r->rgb.stride, n = (size_t)l->w * (size_t)l->h;
  double sum = 0, n_counted = 0;
  for (size_t y = 0; y < (size_t)l->h; y++)
    for (size_t x = 0; x < (size_t)l->w; x++) {
      const size_t at = y * (size_t)l->w + x;
      l->depth[at] = l->plane[y * stride + x];
      for (size_t c = 0; c < 3; c++) {
        const float v = r->rgb.c[c][y * stride + x], e = v - l->truth[c * n + at];
        l->image[c * n + at] = v;
        if (l->counted[at]) sum += (double)e * (double)e;
      }
      n_counted += l->counted[at];
    }
  *mse = n_counted > 0 ? sum / (3 * n_counted) : 0;
  return SV_OK;
}

// Derivatives of a pixel's place by the twist (omega, v) of the camera: x <- x + omega x x + v.
static bool place_by_twist(const sv_view *v, float u, float w, float depth, float out[2][6]) {
  float x[3], j[6];
  if (!sv_view_ray(v, u, w, x)) return false;
  for (int k = 0; k < 3; k++) x[k] *= depth;
  sv_view_jacobian(v, x, j);
  for (int i = 0; i < 2; i++) {
    const float *d = j + 3 * i;
    out[i][0] = d[2] * x[1] - d[1] * x[2];
    out[i][1] = d[0] * x[2] - d[2] * x[0];
    out[i][2] = d[1] * x[0] - d[0] * x[1];
    for (int k = 0; k < 3; k++) out[i][3 + k] = d[k];
  }
  return true;
}

// Normal equations of the error by the twist. The gradient is the mean of both pictures' (ESM,
// Malis 2004), which converges from twice as far.
static void accumulate(const level *l, double h[36], double g[6]) {
  const size_t n = (size_t)l->w * (size_t)l->h, w = (size_t)l->w;
  memset(h, 0, 36 * sizeof *h);
  memset(g, 0, 6 * sizeof *g);
  for (int y = 1; y + 1 < l->h; y++)
    for (int x = 1; x + 1 < l->w; x++) {
      const size_t at = (size_t)y * w + (size_t)x;
      float p[2][6];
      if (!l->counted[at] || !(l->depth[at] > 0) ||
          !place_by_twist(&l->view, (float)x + 0.5f, (float)y + 0.5f, l->depth[at], p))
        continue;
      for (size_t c = 0; c < 3; c++) {
        const float *a = l->image + c * n + at, *b = l->truth + c * n + at;
        const float dx = 0.25f * (a[1] - a[-1] + b[1] - b[-1]);
        const float dy = 0.25f * (a[w] - *(a - w) + b[w] - *(b - w));
        double d[6];
        for (int k = 0; k < 6; k++) d[k] = -(double)(dx * p[0][k] + dy * p[1][k]);
        const double e = (double)(a[0] - b[0]);
        for (int i = 0; i < 6; i++) {
          g[i] += d[i] * e;
          for (int k = 0; k < 6; k++) h[6 * i + k] += d[i] * d[k];
        }
      }
    }
}

static sv_pose pose_of(const sv_view *v) {
  sv_pose p;
  for (int i = 0; i < 9; i++) p.r[i] = (double)v->r[i];
  for (int i = 0; i < 3; i++) p.t[i] = (double)v->t[i];
  return p;
}

static void set_pose(sv_view *v, const sv_pose *p) {
  for (int i = 0; i < 9; i++) v->r[i] = (float)p->r[i];
  for (int i = 0; i < 3; i++) v->t[i] = (float)p->t[i];
}

// Levenberg-Marquardt. The view keeps the best pose that was seen.
static sv_status descend(level *l, sv_err *err) {
  double mse, h[36], g[6], lambda = 1e-4;
  sv_status s = render(l, &mse, err);
  if (s < 0) return s;
  accumulate(l, h, g);
  for (int i = 0; i < N_STEPS; i++) {
    const sv_view before = l->view;
    double a[36], x[6], next;
    memcpy(a, h, sizeof a);
    for (int k = 0; k < 6; k++) {
      a[7 * k] += lambda * h[7 * k] + 1e-12;
      x[k] = -g[k];
    }
    if (!sv_cholesky(a, 6)) break;
    sv_cholesky_solve(a, 6, x);
    sv_pose p = pose_of(&l->view);
    sv_pose_twist(&p, x);
    set_pose(&l->view, &p);
    if ((s = render(l, &next, err)) < 0) return s;
    if (next < mse) {
      const bool is_done = mse - next < LEAST_CHANGE * mse;
      mse = next;
      lambda *= 0.1;
      if (is_done) break;
      accumulate(l, h, g);
      continue;
    }
    l->view = before;
    lambda *= 10;
  }
  return SV_OK;
}

// Means of k x k pixels; a pixel counts when all of them do.
static void reduce(level *l, const sv_view *full, int k) {
  const size_t w = (size_t)full->width_px, n = w * (size_t)full->height_px;
  for (int y = 0; y < l->h; y++)
    for (int x = 0; x < l->w; x++) {
      const size_t at = (size_t)y * (size_t)l->w + (size_t)x;
      float sum[3] = {0};
      l->counted[at] = 1;
      for (int i = 0; i < k * k; i++) {
        const size_t from = (size_t)(k * y + i / k) * w + (size_t)(k * x + i % k);
        for (size_t c = 0; c < 3; c++) sum[c] += l->job->truth[c * n + from];
        if (l->job->counted && !l->job->counted[from]) l->counted[at] = 0;
      }
      for (size_t c = 0; c < 3; c++) l->truth[c * (size_t)l->w * (size_t)l->h + at] = sum[c] / (float)(k * k);
    }
}

sv_status lab_align_view(sv_view *v, const lab_align_job *job, sv_err *err) {
  const size_t n = (size_t)v->width_px * (size_t)v->height_px;
  const size_t n_plane = job->viewer->r.cfg.cap_pixels;
  level l = {.job = job};
  float *block = malloc((7 * n + n_plane) * sizeof *block);
  l.counted = malloc(n);
  sv_status s = block && l.counted ? SV_OK : sv_fail(err, SV_E_NOMEM, "no memory to align a view");
  l.truth = block;
  for (int k = COARSEST; s == SV_OK && k >= 1; k /= 2) {
    l.view = sv_view_scaled(v, k);
    l.w = l.view.width_px;
    l.h = l.view.height_px;
    if (k > 1 && (l.w < LEAST_SIDE || l.h < LEAST_SIDE)) continue;
    const size_t pixels = (size_t)l.w * (size_t)l.h;
    l.image = l.truth + 3 * pixels;
    l.depth = l.image + 3 * pixels;
    l.plane = l.depth + pixels;
    reduce(&l, v, k);
    s = descend(&l, err);
    const sv_pose p = pose_of(&l.view);
    set_pose(v, &p);
  }
  free(block);
  free(l.counted);
  return s;
}

double lab_view_turn_deg(const sv_view *a, const sv_view *b) {
  const sv_pose p = pose_of(a), q = pose_of(b), back = sv_pose_inv(&q), d = sv_pose_mul(&p, &back);
  double w[3];
  sv_rodrigues_inv(w, d.r);
  return sv_norm3(w) * 180 / SV_PI;
}

double lab_view_shift(const sv_view *a, const sv_view *b) {
  float p[3], q[3];
  sv_view_centre(p, a);
  sv_view_centre(q, b);
  return hypot(hypot((double)(p[0] - q[0]), (double)(p[1] - q[1])), (double)(p[2] - q[2]));
}
