// SPDX-License-Identifier: Apache-2.0
#include "src/train/seed.h"

#include "src/base/mathx.h"

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

void sv_seed_points(const sv_trainer *t, const sv_bounds *bounds, uint64_t seed, sv_point *point, int n) {
  sv_rng rng = sv_rng_make(seed, 11);
  for (int i = 0; i < n; i++) {
    const sv_train_view *tv = &t->views[i % t->n_views];
    const sv_view *v = &tv->view;
    int x = (int)sv_rng_below(&rng, (uint32_t)v->width_px),
        y = (int)sv_rng_below(&rng, (uint32_t)v->height_px);
    float c[3];
    sv_view_centre(c, v);
    double ray[3] = {((double)x + 0.5 - v->cx) / v->fx, ((double)y + 0.5 - v->cy) / v->fy, 1};
    double o[3] = {c[0], c[1], c[2]}, d[3];
    for (int k = 0; k < 3; k++) d[k] = v->r[k] * ray[0] + v->r[3 + k] * ray[1] + v->r[6 + k] * ray[2];
    double len = sv_norm3(d);
    for (int k = 0; k < 3; k++) d[k] /= len;
    double depth = choose_depth(bounds, o, d, &rng);
    const uint8_t *px =
        tv->image.px + (size_t)y * (size_t)tv->image.stride_bytes + (size_t)x * (size_t)tv->image.n_channels;
    for (int k = 0; k < 3; k++) {
      point[i].mean[k] = (float)(o[k] + d[k] * depth);
      point[i].rgb[k] = (float)px[k] / 255.0f;
    }
  }
}
