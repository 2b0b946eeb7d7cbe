// SPDX-License-Identifier: Apache-2.0
#include "src/train/demultiplex.h"

#include <string.h>

#include "src/base/mathx.h"
#include "src/train/measurement.h"
#include "src/train/step.h"

#define MIN_ALPHA 0.5f // of a depth

// The images of one sensor's lenses, and what a region of it still lacks.
typedef struct {
  sv_trainer *t;
  const sv_train_measurement *of;
  sv_train_view *views; // [n_lenses] out
  uint8_t *const *px;   // [n_lenses] their images
  float *const *depth;  // [n_lenses]
  sv_region region;
} sensor;

typedef struct {
  sv_trainer *trainer;
  sv_train_view *views;
  uint8_t **px;
  float **depth;
} space;

static space carve(const sv_train_cfg *cfg, sv_arena *a) {
  const int n = cfg->cap_lenses;
  space s = {SV_TAKE(a, sv_trainer, 1), SV_TAKE(a, sv_train_view, n), SV_TAKE(a, uint8_t *, n),
             SV_TAKE(a, float *, n)};
  for (int i = 0; i < n; i++) {
    uint8_t *px = SV_TAKE(a, uint8_t, 3 * cfg->cap_lens_px);
    float *depth = SV_TAKE(a, float, cfg->cap_lens_px);
    if (!s.px || !s.depth) continue;
    s.px[i] = px;
    s.depth[i] = depth;
  }
  return s;
}

size_t sv_demultiplex_bytes(const sv_train_cfg *cfg) {
  sv_arena dry = sv_arena_dry();
  if (cfg->cap_lenses < 1) return 0;
  (void)carve(cfg, &dry);
  return dry.used_bytes;
}

sv_train_cfg sv_demultiplex_cfg(const sv_train_cfg *cfg) {
  sv_train_cfg c = *cfg;
  c.has_lens_views = true;
  c.cap_views = cfg->cap_lenses;
  c.cap_width_px = cfg->cap_lens_width_px;
  c.cap_height_px = cfg->cap_lens_height_px;
  return c;
}

static float weight(const sv_crop *crop, int x, int y) {
  const sv_footprint *f = &crop->lens->footprint;
  if (!f->coverage) return 1.0f;
  return (float)f->coverage[(size_t)(crop->lens_y + y) * (size_t)f->width_px + (size_t)(crop->lens_x + x)] *
         (1.0f / 255.0f);
}

static void to_light(const sensor *s, const float *src, float *dst, int n) {
  if (s->of->model.is_linear)
    s->t->compute.k->srgb_to_linear(&(sv_curve_args){.src = src, .dst = dst, .n = n});
  else memcpy(dst, src, (size_t)n * sizeof *dst);
}

static void to_display(const sensor *s, const float *src, float *dst, int n) {
  if (s->of->model.is_linear)
    s->t->compute.k->linear_to_srgb(&(sv_curve_args){.src = src, .dst = dst, .n = n});
  else memcpy(dst, src, (size_t)n * sizeof *dst);
}

// Into the trainer's planes: grad, what the predicted sum lacks; err_plane, the sum of squared
// weights.
static void load_lack(const sensor *s) {
  sv_trainer *t = s->t;
  const sv_multiplexed *c = &s->of->model;
  const int w = s->region.x1 - s->region.x0, h = s->region.y1 - s->region.y0;
  sv_train_size_images(t, w, h);
  for (int y = 0; y < h; y++) {
    const size_t at = (size_t)y * (size_t)t->grad.stride;
    const uint16_t *src =
        s->of->px + 3 * ((size_t)(s->region.y0 + y) * (size_t)c->width_px + (size_t)s->region.x0);
    memset(t->err_plane + at, 0, (size_t)w * sizeof *t->err_plane);
    for (int k = 0; k < 3; k++) {
      float *lack = t->grad.c[k] + at, *target = t->target.c[k] + at;
      for (int x = 0; x < w; x++) target[x] = (float)src[3 * x + k] * (1.0f / 65535.0f);
      to_light(s, t->forward.predicted.c[k] + at, lack, w);
      to_light(s, target, target, w);
      for (int x = 0; x < w; x++) lack[x] = c->max_overlap * (target[x] - lack[x]);
    }
  }
  sv_crop crop;
  for (int m = 0; m < c->n_lenses; m++) {
    if (!sv_multiplexed_crop(c, m, &s->region, &crop)) continue;
    for (int y = 0; y < crop.view.height_px; y++)
      for (int x = 0; x < crop.view.width_px; x++) {
        const float here = weight(&crop, x, y);
        t->err_plane[(size_t)(crop.y_px + y) * (size_t)t->grad.stride + (size_t)(crop.x_px + x)] +=
            here * here;
      }
  }
}

// One row of one color of lens m, from its rendering.
static void store_row(const sensor *s, const sv_crop *crop, int m, int y, int k) {
  sv_trainer *t = s->t;
  const int w = crop->view.width_px;
  const size_t at = (size_t)(crop->y_px + y) * (size_t)t->grad.stride + (size_t)crop->x_px;
  float *light = t->part_grad.c[k];
  uint8_t *out = s->px[m] + 3 * ((size_t)(crop->lens_y + y) * (size_t)crop->lens->footprint.width_px +
                                 (size_t)crop->lens_x);
  to_light(s, t->render.rgb.c[k] + (size_t)y * (size_t)t->render.rgb.stride, light, w);
  for (int x = 0; x < w; x++) {
    const float square = t->err_plane[at + (size_t)x];
    if (square > 0) light[x] += weight(crop, x, y) * t->grad.c[k][at + (size_t)x] / square;
    light[x] = sv_clampf(light[x], 0.0f, 1.0f);
  }
  to_display(s, light, light, w);
  for (int x = 0; x < w; x++) out[3 * x + k] = (uint8_t)(sv_clampf(light[x], 0.0f, 1.0f) * 255.0f + 0.5f);
}

// A row of the model's depth, as lens m sees it.
static void store_depth(const sensor *s, const sv_crop *crop, int m, int y) {
  const sv_renderer *r = &s->t->render;
  float *out =
      s->depth[m] + (size_t)(crop->lens_y + y) * (size_t)crop->lens->footprint.width_px + crop->lens_x;
  const size_t at = (size_t)y * (size_t)r->rgb.stride;
  for (int x = 0; x < crop->view.width_px; x++) {
    const float alpha = 1.0f - r->trans[at + (size_t)x];
    out[x] = alpha > MIN_ALPHA ? r->depth[at + (size_t)x] / alpha : 0.0f;
  }
}

static sv_status solve_region(const sensor *s) {
  sv_trainer *t = s->t;
  const sv_multiplexed *c = &s->of->model;
  const sv_render_options o = sv_train_render_options(t, 1.0f, true);
  sv_crop crop;
  sv_status st = sv_train_predict(t, c, &s->region, &o, NULL, NULL);
  if (st < 0) return st;
  load_lack(s);
  for (int m = 0; m < c->n_lenses; m++) {
    if (!sv_multiplexed_crop(c, m, &s->region, &crop)) continue;
    if ((st = sv_render(&t->render, &t->g, &crop.view, &o)) < 0) return st;
    for (int y = 0; y < crop.view.height_px; y++) {
      for (int k = 0; k < 3; k++) store_row(s, &crop, m, y, k);
      store_depth(s, &crop, m, y);
    }
  }
  return SV_OK;
}

static sv_status solve(sensor *s) {
  const sv_multiplexed *c = &s->of->model;
  const int side = s->t->cfg.region_px;
  for (int m = 0; m < c->n_lenses; m++) {
    const sv_view *v = &c->lenses[m].view;
    if ((size_t)v->width_px * (size_t)v->height_px > s->t->cfg.cap_lens_px) return SV_E_RANGE;
    s->views[m] = (sv_train_view){*v, {s->px[m], v->width_px, v->height_px, 3, 3 * v->width_px, NULL}, 1.0f};
  }
  for (int y0 = 0; y0 < c->height_px; y0 += side)
    for (int x0 = 0; x0 < c->width_px; x0 += side) {
      s->region = (sv_region){x0, y0, sv_mini(x0 + side, c->width_px), sv_mini(y0 + side, c->height_px)};
      sv_status st = solve_region(s);
      if (st < 0) return st;
    }
  return SV_OK;
}

sv_status sv_demultiplex(sv_trainer *t, sv_arena *scratch, sv_lens_images *out) {
  const space room = carve(&t->cfg, scratch);
  sv_trainer *lenses = room.trainer;
  if (scratch->status < 0) return scratch->status;
  *lenses = *t;
  lenses->cfg = sv_demultiplex_cfg(&t->cfg);
  lenses->views = room.views;
  lenses->n_views = 0;
  for (int i = 0; i < t->n_measurements; i++) {
    const int n = lenses->n_views;
    sensor s = {.t = t,
                .of = &t->measurements[i],
                .views = room.views + n,
                .px = room.px + n,
                .depth = room.depth + n};
    lenses->n_views += s.of->model.n_lenses;
    if (lenses->n_views > t->cfg.cap_lenses) return SV_E_RANGE;
    sv_status st = solve(&s);
    if (st < 0) return st;
  }
  *out = (sv_lens_images){lenses, room.depth};
  return SV_OK;
}
