// SPDX-License-Identifier: Apache-2.0
#include "src/prior/align.h"

#include <math.h>

#include "src/base/mathx.h"
#include "src/prior/methods.h"
#include "src/prior/solve.h"

#define MIN_SAMPLES 64    // for a fit of two numbers
#define STRAY       500   // one of so many values may lie outside of its limits
#define HALVINGS    30    // of the interval of scales
#define ROUNDS      8     // of reweighting
#define MAD_SIGMA   1.48f // median absolute deviation to a standard deviation
#define CAUCHY      2.4f  // standard deviations at which a weight is a half
#define PLATEAU     100   // one of so many pixels at the lowest value are no surface
#define BORDER      10    // one of so many border pixels may be known of a scene inside the picture
// of a map that the model can tell more of later (sv_prior_realign)
#define GUESSED_TRUST 0.05f
#define FAR_RADII     8.0f // behind the ball, as the planes of a sweep

// --- fits ----------------------------------------------------------------------------------------

// Interval of shifts that a scale leaves, but for strays. False: empty.
static bool shifts(const sv_prior_fit *f, float scale, float *work, float *shift) {
  float *below = work, *above = work + f->n;
  for (int i = 0; i < f->n; i++) {
    below[i] = f->low[i] - scale * f->map[i];
    above[i] = f->high[i] - scale * f->map[i];
  }
  sv_prior_sort(below, f->n);
  sv_prior_sort(above, f->n);
  const float from = below[f->n - 1 - f->n / STRAY], to = above[f->n / STRAY];
  *shift = 0.5f * (from + to);
  return from <= to;
}

bool sv_prior_fit_between(const sv_prior_fit *f, float *work, float *scale, float *shift) {
  float least = 1e30f, most = -1e30f, low = 1e30f, high = -1e30f, b;
  if (f->n < MIN_SAMPLES) return false;
  for (int i = 0; i < f->n; i++) {
    least = sv_minf(least, f->map[i]);
    most = sv_maxf(most, f->map[i]);
    low = sv_minf(low, f->low[i]);
    high = sv_maxf(high, f->high[i]);
  }
  if (!(most > least)) return false;
  float from = 0.0f, to = 4.0f * (high - low) / (most - least);
  for (int k = 0; k < HALVINGS; k++) {
    const float mid = 0.5f * (from + to);
    if (shifts(f, mid, work, &b)) from = mid;
    else to = mid;
  }
  *scale = from;
  return shifts(f, from, work, shift) && from > 1e-3f * to;
}

// Weighted least squares; weights of one round before by |residual| / sigma.
static bool line_through(const sv_prior_fit *f, float sigma, float *scale, float *shift) {
  const float a = *scale, b = *shift;
  double n = 0, mm = 0, my = 0, vm = 0, c = 0;
  for (int pass = 0; pass < 2; pass++) {
    for (int i = 0; i < f->n; i++) {
      const double e = sigma > 0 ? (double)((f->low[i] - a * f->map[i] - b) / (CAUCHY * sigma)) : 0;
      const double w = 1 / (1 + e * e), m = (double)f->map[i], y = (double)f->low[i];
      if (pass == 0) {
        n += w;
        mm += w * m;
        my += w * y;
      } else {
        vm += w * (m - mm) * (m - mm);
        c += w * (m - mm) * (y - my);
      }
    }
    if (pass == 0) {
      mm /= n;
      my /= n;
    }
  }
  if (!(vm > 0) || !(c > 0)) return false;
  *scale = (float)(c / vm);
  *shift = (float)(my - c / vm * mm);
  return true;
}

bool sv_prior_fit_line(const sv_prior_fit *f, float *work, float *scale, float *shift) {
  if (f->n < MIN_SAMPLES || !line_through(f, 0.0f, scale, shift)) return false;
  for (int k = 0; k < ROUNDS; k++) {
    for (int i = 0; i < f->n; i++) work[i] = fabsf(f->low[i] - *scale * f->map[i] - *shift);
    sv_prior_sort(work, f->n);
    const float sigma = MAD_SIGMA * work[f->n / 2];
    if (!(sigma > 0)) return true;
    if (!line_through(f, sigma, scale, shift)) return false;
  }
  return true;
}

// --- the ball ------------------------------------------------------------------------------------

static bool is_relative(const sv_prior_depth *d) {
  return d->kind == SV_PRIOR_RELATIVE || d->kind == SV_PRIOR_INVERSE;
}

static float value_at(const sv_prior_depth *d, int x, int y) {
  return d->map[(size_t)y * (size_t)d->width_px + (size_t)x];
}

// Many pixels at the lowest inverse depth are sky or nothing: no surface.
static void forget_plateau(sv_prior_depth *d) {
  const int n = d->width_px * d->height_px;
  float least = 1e30f;
  int n_least = 0;
  if (d->kind != SV_PRIOR_INVERSE) return;
  for (int i = 0; i < n; i++)
    if (d->map[i] >= 0.0f) least = sv_minf(least, d->map[i]);
  for (int i = 0; i < n; i++) n_least += d->map[i] == least;
  for (int i = 0; i < n && n_least > n / PLATEAU; i++)
    if (d->map[i] == least) d->map[i] = -1.0f;
}

static bool reaches_border(const sv_prior_depth *d) {
  const int w = d->width_px, h = d->height_px;
  int n = 0;
  for (int x = 0; x < w; x++) n += (value_at(d, x, 0) >= 0.0f) + (value_at(d, x, h - 1) >= 0.0f);
  for (int y = 0; y < h; y++) n += (value_at(d, 0, y) >= 0.0f) + (value_at(d, w - 1, y) >= 0.0f);
  return n > 2 * (w + h) / BORDER;
}

// In the camera's frame.
typedef struct {
  double centre[3], radius;
} ball;

static double angle_to(const ball *b, const float ray[3]) {
  const double r[3] = {(double)ray[0], (double)ray[1], (double)ray[2]};
  return sv_angle_between(r, b->centre);
}

// The ball about its centre that all rays of known pixels meet.
static void tighten(ball *b, const sv_view *v, const sv_prior_depth *d) {
  double widest = 0;
  for (int y = 0; y < d->height_px; y++)
    for (int x = 0; x < d->width_px; x++) {
      float ray[3];
      if (value_at(d, x, y) >= 0.0f && sv_view_ray(v, (float)x + 0.5f, (float)y + 0.5f, ray))
        widest = sv_maxd(widest, angle_to(b, ray));
    }
  if (widest > 0 && widest < 0.5 * SV_PI) b->radius = sv_norm3(b->centre) * sv_sin(widest);
}

// Depths at which a pixel's ray enters and leaves the ball; false: it passes by.
static bool chord(const ball *b, const float ray[3], double *near, double *far) {
  const double r[3] = {(double)ray[0], (double)ray[1], (double)ray[2]};
  const double a = sv_dot3(r, r), half = sv_dot3(r, b->centre);
  const double disc = half * half - a * (sv_dot3(b->centre, b->centre) - b->radius * b->radius);
  if (!(disc > 0)) return false;
  *near = (half - sqrt(disc)) / a;
  *far = (half + sqrt(disc)) / a;
  return *near > 0;
}

static void add_sample(sv_prior_samples *s, float map, double low, double high) {
  if (s->n >= SV_PRIOR_SAMPLES) return;
  s->map[s->n] = map;
  s->low[s->n] = (float)low;
  s->high[s->n++] = (float)high;
}

// Between samples, in both directions.
static int stride_of(const sv_prior_depth *d) {
  int step = 1;
  while ((d->width_px / step + 1) * (d->height_px / step + 1) > SV_PRIOR_SAMPLES) step++;
  return step;
}

static void sample_ball(sv_prior_samples *s, const ball *b, const sv_view *v, const sv_prior_depth *d) {
  const bool is_inverse = d->kind == SV_PRIOR_INVERSE;
  const int step = stride_of(d);
  s->n = 0;
  for (int y = step / 2; y < d->height_px; y += step)
    for (int x = step / 2; x < d->width_px; x += step) {
      double near, far;
      float ray[3];
      if (value_at(d, x, y) < 0.0f || !sv_view_ray(v, (float)x + 0.5f, (float)y + 0.5f, ray)) continue;
      if (!chord(b, ray, &near, &far)) continue;
      add_sample(s, value_at(d, x, y), is_inverse ? 1 / far : near, is_inverse ? 1 / near : far);
    }
}

static bool align_to_ball(sv_prior *p, sv_prior_depth *d, const sv_bounds *bounds) {
  const sv_view *v = &p->t->views[d->id].view;
  sv_prior_samples *s = p->samples;
  ball b = {.radius = (double)bounds->radius};
  float scale, shift;
  for (int k = 0; k < 3; k++)
    b.centre[k] = (double)(v->r[3 * k] * bounds->centre[0] + v->r[3 * k + 1] * bounds->centre[1] +
                           v->r[3 * k + 2] * bounds->centre[2] + v->t[k]);
  const double distance = sv_norm3(b.centre);
  forget_plateau(d);
  if (!reaches_border(d)) tighten(&b, v, d);
  if (!(b.radius < distance) || !(b.centre[2] > 0)) return false;
  sample_ball(s, &b, v, d);
  const sv_prior_fit f = {s->map, s->low, s->high, s->n};
  if (!sv_prior_fit_between(&f, s->work, &scale, &shift)) return false;
  sv_prior_apply_line(d, scale, shift, 1.0f / (float)(distance + (double)FAR_RADII * b.radius));
  d->unit = (float)(1 / b.centre[2]);
  if (p->t->n_views > 1) d->trust = GUESSED_TRUST;
  return true;
}

int sv_prior_align_to_ball(sv_prior *p, const sv_bounds *bounds) {
  int n = 0;
  for (int i = 0; i < p->cfg.cap_depths; i++) {
    sv_prior_depth *d = &p->depths[i];
    if (d->id >= 0 && d->id < p->t->n_views && is_relative(d)) n += align_to_ball(p, d, bounds);
  }
  return n;
}

// --- measured depth ------------------------------------------------------------------------------

static void sample_depth(sv_prior_samples *s, const sv_prior_depth *d, const float *depth) {
  const int step = sv_prior_stride(d);
  s->n = 0;
  for (int y = step / 2; y < d->height_px; y += step)
    for (int x = step / 2; x < d->width_px; x += step) {
      const float z = depth[(size_t)y * (size_t)d->width_px + (size_t)x];
      if (z > 0.0f && value_at(d, x, y) >= 0.0f) (void)sv_prior_add_sample(s, d, x, y, z);
    }
}

bool sv_prior_align_to_depth(sv_prior *p, sv_prior_depth *d, const float *depth) {
  sv_prior_samples *s = p->samples;
  float farthest = 0.0f;
  double sum = 0;
  if (!is_relative(d)) return false;
  sample_depth(s, d, depth);
  for (int i = 0; i < s->n; i++) {
    const float z = d->kind == SV_PRIOR_INVERSE ? 1.0f / s->low[i] : s->low[i];
    sum += 1 / (double)z;
    farthest = sv_maxf(farthest, z);
  }
  d->unit = (float)(sum / sv_maxi(s->n, 1));
  if (!sv_prior_solve(s, d, 1.0f / (FAR_RADII * sv_maxf(farthest, 1e-6f)))) return false;
  d->is_measured = true;
  for (int i = 0; i < d->width_px * d->height_px; i++)
    if (depth[i] > 0.0f) d->map[i] = -1.0f;
  return true;
}
