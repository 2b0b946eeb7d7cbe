// SPDX-License-Identifier: Apache-2.0
#include "src/train/seed.h"

#include "src/base/mathx.h"

#define MAX_TRIES 64 // for a pixel that is not masked

// Distances along the ray o + s d (|d| = 1) inside the ball; false when it passes by.
static bool chord(const sv_bounds *b, const double o[3], const double d[3], double *near, double *far) {
  double e[3] = {b->centre[0] - o[0], b->centre[1] - o[1], b->centre[2] - o[2]};
  double mid = sv_dot3(e, d), h2 = (double)b->radius * b->radius - (sv_dot3(e, e) - mid * mid);
  if (h2 <= 0 || mid + sqrt(h2) <= 0) return false;
  *near = sv_maxf((float)(mid - sqrt(h2)), 0.05f * b->radius);
  *far = mid + sqrt(h2);
  return true;
}

static double choose_depth(const sv_bounds *b, const double o[3], const double d[3], sv_rng *rng) {
  double e[3] = {b->centre[0] - o[0], b->centre[1] - o[1], b->centre[2] - o[2]}, near, far;
  double u = (double)sv_rng_f(rng), to_centre = sv_norm3(e);
  bool is_inside = sv_rng_u32(rng) & 1;
  if (is_inside && chord(b, o, d, &near, &far)) return near + (far - near) * u;
  near = to_centre - (double)b->radius;
  if (near < 0.3 * to_centre) near = 0.3 * to_centre;
  if (near < 0.05 * (double)b->radius) near = 0.05 * (double)b->radius;
  far = to_centre + 8 * (double)b->radius;
  return near * sv_exp(u * sv_log(far / near));
}

typedef struct {
  const sv_view *view;
  const sv_image_u8 *image;      // or
  const sv_train_measurement *c; // with the lens's place on it
  const sv_footprint *footprint;
} source;

// The i-th of all views, those with pictures first.
static source source_of(const sv_trainer *t, int i) {
  if (i < t->n_views) return (source){.view = &t->views[i].view, .image = &t->views[i].image};
  const sv_train_measurement *c = t->measurements;
  for (i -= t->n_views; i >= c->model.n_lenses; c++) i -= c->model.n_lenses;
  const sv_lens *lens = &c->model.lenses[i];
  return (source){.view = &lens->view, .c = c, .footprint = &lens->footprint};
}

static void colour(const source *s, int x, int y, float rgb[3]) {
  const sv_image_u8 *im = s->image;
  for (int k = 0; k < 3 && im; k++)
    rgb[k] = (float)im->px[(size_t)y * (size_t)im->stride_bytes + (size_t)(x * im->n_channels + k)] / 255.0f;
  if (im) return;
  size_t at =
      (size_t)(s->footprint->y0_px + y) * (size_t)s->c->model.width_px + (size_t)(s->footprint->x0_px + x);
  for (int k = 0; k < 3; k++) rgb[k] = (float)s->c->px[3 * at + (size_t)k] / 65535.0f;
}

void sv_seed_points(const sv_trainer *t, const sv_bounds *bounds, uint64_t seed, sv_point *point, int n) {
  sv_rng rng = sv_rng_make(seed, 11);
  int n_sources = t->n_views;
  for (int i = 0; i < t->n_measurements; i++) n_sources += t->measurements[i].model.n_lenses;
  for (int i = 0; i < n; i++) {
    const source from = source_of(t, i % n_sources);
    const sv_view *v = from.view;
    int x, y, n_tries = 0;
    float c[3];
    do {
      x = (int)sv_rng_below(&rng, (uint32_t)v->width_px);
      y = (int)sv_rng_below(&rng, (uint32_t)v->height_px);
    } while (from.image && !sv_image_counts(from.image, 1, x, y) && ++n_tries < MAX_TRIES);
    sv_view_centre(c, v);
    double ray[3] = {((double)x + 0.5 - v->cx) / v->fx, ((double)y + 0.5 - v->cy) / v->fy, 1};
    float wide[3];
    if (v->fisheye && sv_view_ray(v, (float)x + 0.5f, (float)y + 0.5f, wide))
      for (int k = 0; k < 3; k++) ray[k] = (double)wide[k];
    double o[3] = {c[0], c[1], c[2]}, d[3];
    for (int k = 0; k < 3; k++) d[k] = v->r[k] * ray[0] + v->r[3 + k] * ray[1] + v->r[6 + k] * ray[2];
    double len = sv_norm3(d);
    for (int k = 0; k < 3; k++) d[k] /= len;
    double depth = choose_depth(bounds, o, d, &rng);
    for (int k = 0; k < 3; k++) point[i].mean[k] = (float)(o[k] + d[k] * depth);
    colour(&from, x, y, point[i].rgb);
  }
}
