// SPDX-License-Identifier: Apache-2.0
#include "src/train/measurement.h"

#include <math.h>
#include <string.h>

#include "src/base/mathx.h"
#include "src/train/curvature.h"
#include "src/train/optimize.h"
#include "src/train/step.h"

// Regions lie side by side and reach beyond the sensor by less than one; the jitter shares that out
// between the two ends, and the outer ones are pushed back onto the sensor.
static int start_of(int side, int n, int region_px, float jitter, int i) {
  int size = sv_mini(region_px, side), beyond = n * region_px - side;
  return sv_maxi(0, sv_mini(i * region_px - (int)(jitter * (float)beyond), side - size));
}

sv_region sv_train_region(const sv_trainer *t, const sv_train_measurement *c, int i) {
  const int w = c->model.width_px, h = c->model.height_px, region_px = t->cfg.region_px;
  const int x0 = start_of(w, c->n_x, region_px, t->jitter[0], i % c->n_x);
  const int y0 = start_of(h, c->n_y, region_px, t->jitter[1], i / c->n_x);
  return (sv_region){.x0 = x0, .y0 = y0, .x1 = x0 + sv_mini(region_px, w), .y1 = y0 + sv_mini(region_px, h)};
}

// A random background where it is known what the lenses see through: its light beside that of the
// renderings, which stay over o's background.
static bool draw_backdrop(sv_trainer *t, const sv_train_measurement *c, float progress,
                          sv_render_options *o) {
  float light[6]; // random, o's
  memset(t->forward.backdrop, 0, sizeof t->forward.backdrop);
  if (!c->clear || !(t->cfg.background == SV_BG_RANDOM || progress < t->cfg.random_until)) return false;
  for (int k = 0; k < 3; k++) light[k] = sv_rng_f(&t->rng);
  memcpy(light + 3, o->bg, sizeof o->bg);
  if (c->model.is_linear) t->compute.k->srgb_to_linear(&(sv_curve_args){.src = light, .dst = light, .n = 6});
  for (int k = 0; k < 3; k++) t->forward.backdrop[k] = light[k] - light[3 + k];
  o->has_depth = true; // and transmittance
  return true;
}

// A row of one color as it would have been measured over the backdrop.
static void add_backdrop(const sv_trainer *t, const sv_multiplexed *c, const uint16_t *clear, float backdrop,
                         float *row) {
  const int w = t->target.width_px;
  if (c->is_linear) t->compute.k->srgb_to_linear(&(sv_curve_args){.src = row, .dst = row, .n = w});
  for (int x = 0; x < w; x++)
    row[x] = sv_clampf(fmaf(backdrop, (float)clear[x] * (1.0f / 65535.0f), row[x]), 0.0f, 1.0f);
  if (c->is_linear) t->compute.k->linear_to_srgb(&(sv_curve_args){.src = row, .dst = row, .n = w});
}

static void load_region(sv_trainer *t, const sv_train_measurement *c, const sv_region *r, bool has_backdrop) {
  const int w = r->x1 - r->x0, h = r->y1 - r->y0;
  sv_train_size_images(t, w, h);
  for (int y = 0; y < h; y++) {
    const size_t at = (size_t)(r->y0 + y) * (size_t)c->model.width_px + (size_t)r->x0;
    const uint16_t *src = c->px + 3 * at;
    for (int k = 0; k < 3; k++) {
      float *dst = t->target.c[k] + (size_t)y * (size_t)t->target.stride;
      for (int x = 0; x < w; x++) dst[x] = (float)src[3 * x + k] * (1.0f / 65535.0f);
      if (has_backdrop) add_backdrop(t, &c->model, c->clear + at, t->forward.backdrop[k], dst);
    }
  }
}

sv_status sv_train_predict(sv_trainer *t, const sv_multiplexed *c, const sv_region *region,
                           const sv_render_options *o, int *last, size_t *n_px) {
  sv_crop crop;
  size_t sum_px = 0;
  if (last) *last = -1;
  sv_status s = sv_forward_begin(&t->forward, region);
  for (int m = 0; m < c->n_lenses && s >= 0; m++) {
    if (!sv_multiplexed_crop(c, m, region, &crop)) continue;
    if ((s = sv_render(&t->render, &t->g, &crop.view, o)) < 0) break;
    sv_forward_add(&t->forward, c, &crop, &t->render.rgb, o->has_depth ? t->render.trans : NULL);
    if (last) *last = m;
    sum_px += (size_t)crop.view.width_px * (size_t)crop.view.height_px;
  }
  if (n_px) *n_px = sum_px;
  if (s >= 0) sv_forward_finish(&t->forward, c);
  return s;
}

// The curvature of a region's loss. *held: the lens whose part the renderer holds, before and
// after.
static sv_status probe_region(sv_trainer *t, const sv_multiplexed *c, const sv_region *region,
                              const sv_render_options *o, double l1, int *held) {
  float *const g_trans = o->has_depth ? t->part_trans : NULL;
  sv_train_make_probe(t, l1, &t->target);
  for (int m = *held; m >= 0; m--) {
    sv_crop crop;
    sv_status s = SV_OK;
    if (!sv_multiplexed_crop(c, m, region, &crop)) continue;
    if (m != *held && (s = sv_render(&t->render, &t->g, &crop.view, o)) < 0) return s;
    *held = m;
    sv_forward_bwd(&t->forward, c, &crop, &t->render.rgb,
                   &(sv_forward_grad){&t->target, NULL, &t->part_grad, NULL, g_trans});
    if ((s = sv_render_bwd(&t->render, &t->part_grad, NULL, g_trans, NULL)) < 0) return s;
    sv_train_collect_curvature(t);
  }
  sv_train_apply_curvature(t);
  return SV_OK;
}

// The region is taken; o may get a backdrop.
static sv_status region_step(sv_trainer *t, const sv_train_measurement *tc, const sv_region *region,
                             float progress, sv_render_options *o, sv_step_stats *out) {
  const sv_multiplexed *c = &tc->model;
  // about M_max crops see a Gaussian
  const sv_regularisers reg = sv_train_regularisers(t, progress, 1.0f / c->max_overlap);
  const bool has_backdrop = draw_backdrop(t, tc, progress, o);
  float *const g_trans = has_backdrop ? t->part_trans : NULL;
  int last;
  size_t n_px;
  t->forward.noise =
      (sv_forward_noise){t->cfg.noise_read, t->cfg.noise_shot, sv_hash3((uint32_t)t->cfg.seed, t->step, 0)};
  sv_status s = sv_train_predict(t, c, region, o, &last, &n_px);
  if (s < 0 || last < 0) return s;
  load_region(t, tc, region, has_backdrop);
  float *const errors = sv_train_is_error_due(t, progress) ? t->err_plane : NULL;
  float *const crop_errors = errors ? t->part_err : NULL;
  const sv_photometric_value loss = sv_photometric_loss(&t->photometric, &t->forward.predicted, &t->target,
                                                        &t->grad, errors, t->cfg.weight_ssim);
  out->loss = loss.loss;
  out->l1 = loss.l1;
  out->ssim = loss.ssim;
  int held = last;
  if (sv_train_is_probe_due(t) && (s = probe_region(t, c, region, o, loss.l1, &held)) < 0) return s;
  for (int m = last; m >= 0; m--) {
    sv_crop crop;
    if (!sv_multiplexed_crop(c, m, region, &crop)) continue;
    if (m != held && (s = sv_render(&t->render, &t->g, &crop.view, o)) < 0) return s;
    held = m;
    sv_forward_bwd(&t->forward, c, &crop, &t->render.rgb,
                   &(sv_forward_grad){&t->grad, errors, &t->part_grad, crop_errors, g_trans});
    float share = (float)((double)crop.view.width_px * (double)crop.view.height_px / (double)n_px);
    if (t->cfg.weight_tv > 0.0f)
      out->loss += sv_tv_loss(&t->tv, &t->render.rgb, &t->part_grad, SV_TV_SQUARED, t->cfg.weight_tv * share);
    s = sv_render_bwd(&t->render, &t->part_grad, NULL, g_trans, crop_errors);
    if (s < 0) return s;
    sv_train_collect(t, &reg, true);
  }
  return SV_OK;
}

// The crops are rendered twice: once for their sum, once for their gradients, so that one renderer
// is enough.
sv_status sv_train_region_step(sv_trainer *t, int i, float progress, const sv_render_options *options,
                               sv_step_stats *out) {
  const sv_train_measurement *c = t->measurements;
  sv_render_options o = *options;
  for (; i >= c->n_x * c->n_y; c++) i -= c->n_x * c->n_y;
  const sv_region region = sv_train_region(t, c, i);
  const sv_status s = region_step(t, c, &region, progress, &o, out);
  t->forward.noise = (sv_forward_noise){0};
  memset(t->forward.backdrop, 0, sizeof t->forward.backdrop);
  return s;
}
