// SPDX-License-Identifier: Apache-2.0
#include "src/preview/pictures.h"

#include <string.h>

#include "src/base/mathx.h"
#include "src/capture/measurements.h"
#include "src/metric/metric.h"
#include "src/train/driver.h"
#include "src/train/measurement.h"

static uint8_t to_u8(float x) { return (uint8_t)(sv_clampf(x, 0.0f, 1.0f) * 255.0f + 0.5f); }

void sv_pictures_pixel(uint8_t out[3], const sv_planes *p, int x, int y) {
  for (int k = 0; k < 3; k++) out[k] = to_u8(p->c[k][(long)y * p->stride + x]);
}

// --- sizes ---------------------------------------------------------------------------------------

// One of the three panels of a shared sensor, with one pixel for step x step of the sensor's.
typedef struct {
  int width_px, height_px, step;
} panel;

static panel panel_of(int width_px, int height_px) {
  panel p = {.step = (3 * width_px + SV_PICTURES_CAP_PX - 1) / SV_PICTURES_CAP_PX};
  p.width_px = (width_px + p.step - 1) / p.step;
  p.height_px = (height_px + p.step - 1) / p.step;
  return p;
}

void sv_pictures_size(const sv_rig *rig, const sv_camera_caps *caps, int n_cameras, int *width_px,
                      int *height_px) {
  *width_px = *height_px = 1;
  if (rig->forward == SV_FORWARD_MULTIPLEXED) {
    int i = 0;
    while (i < n_cameras - 1 && !sv_measurements_has_lens(rig, i)) i++;
    panel p = panel_of(caps[i].width_px, caps[i].height_px);
    *width_px = 3 * p.width_px;
    *height_px = p.height_px;
    return;
  }
  for (int i = 0; i < rig->n_sub_views; i++) {
    *width_px = sv_maxi(*width_px, 2 * rig->sub_views[i].model.width_px);
    *height_px = sv_maxi(*height_px, rig->sub_views[i].model.height_px);
  }
}

// --- a sub-view's picture ------------------------------------------------------------------------

static sv_status show_view(const sv_pictures *o, const sv_train_view *tv) {
  const sv_publish *p = o->publish;
  const sv_planes *measured;
  sv_status s = sv_driver_render_view(o->t, (int)(tv - o->t->views), &measured);
  if (s < 0) return s;
  int w = tv->view.width_px, h = tv->view.height_px;
  for (int y = 0; y < h; y++) {
    uint8_t *left = o->rgb + (size_t)y * (size_t)w * 6, *right = left + (size_t)w * 3;
    memcpy(left, tv->image.px + (size_t)y * (size_t)tv->image.stride_bytes, (size_t)w * 3);
    for (int x = 0; x < w; x++) sv_pictures_pixel(right + 3 * x, measured, x, y);
  }
  p->image(p->self, "preview", 2 * w, h, o->rgb);
  return SV_OK;
}

// --- a shared sensor -----------------------------------------------------------------------------

static uint8_t *at(const sv_pictures *o, const panel *p, int i_panel, int x, int y) {
  return o->rgb + 3 * ((size_t)y * 3 * (size_t)p->width_px + (size_t)(i_panel * p->width_px + x));
}

static void put_measured(const sv_pictures *o, const panel *p, const sv_train_measurement *c) {
  for (int y = 0; y < p->height_px; y++)
    for (int x = 0; x < p->width_px; x++) {
      const uint16_t *px = c->px + 3 * (size_t)p->step * ((size_t)y * (size_t)c->model.width_px + (size_t)x);
      for (int k = 0; k < 3; k++) at(o, p, 0, x, y)[k] = (uint8_t)((px[k] + 128) / 257);
    }
}

static sv_status put_predicted(const sv_pictures *o, const panel *p, const sv_multiplexed *c,
                               const sv_render_options *options) {
  const int side = o->t->cfg.region_px;
  const sv_planes *predicted = &o->t->forward.predicted;
  for (int y0 = 0; y0 < c->height_px; y0 += side)
    for (int x0 = 0; x0 < c->width_px; x0 += side) {
      sv_region r = {x0, y0, sv_mini(x0 + side, c->width_px), sv_mini(y0 + side, c->height_px)};
      sv_status s = sv_train_predict(o->t, c, &r, options, NULL, NULL);
      if (s < 0) return s;
      for (int y = (y0 + p->step - 1) / p->step; y * p->step < r.y1; y++)
        for (int x = (x0 + p->step - 1) / p->step; x * p->step < r.x1; x++)
          sv_pictures_pixel(at(o, p, 1, x, y), predicted, x * p->step - x0, y * p->step - y0);
    }
  return SV_OK;
}

// In the middle of its panel, as large as whole multiples fit (or each so many pixels of a large
// one).
static sv_status put_lens(const sv_pictures *o, const panel *p, const sv_multiplexed *c,
                          const sv_render_options *options) {
  const sv_view *v = &c->lenses[c->n_lenses / 2].view;
  const sv_planes *rgb = &o->t->render.rgb;
  sv_status s = sv_render(&o->t->render, &o->t->g, v, options);
  if (s < 0) return s;
  int zoom = sv_maxi(1, sv_mini(p->width_px / v->width_px, p->height_px / v->height_px));
  int step = zoom > 1 ? 1 : p->step, w = v->width_px * zoom / step, h = v->height_px * zoom / step;
  w = sv_mini(w, p->width_px);
  h = sv_mini(h, p->height_px);
  int left = (p->width_px - w) / 2, top = (p->height_px - h) / 2;
  for (int y = 0; y < p->height_px; y++)
    for (int x = 0; x < p->width_px; x++) {
      bool is_in = x >= left && x < left + w && y >= top && y < top + h;
      if (is_in) sv_pictures_pixel(at(o, p, 2, x, y), rgb, (x - left) * step / zoom, (y - top) * step / zoom);
      else memset(at(o, p, 2, x, y), 0, 3);
    }
  return SV_OK;
}

static sv_status show_measurement(const sv_pictures *o, const sv_train_measurement *tc) {
  const sv_publish *p = o->publish;
  const sv_multiplexed *c = &tc->model;
  panel one = panel_of(c->width_px, c->height_px);
  sv_render_options options = sv_train_render_options(o->t, 1.0f, false);
  put_measured(o, &one, tc);
  sv_status s = put_predicted(o, &one, c, &options);
  if (s >= 0) s = put_lens(o, &one, c, &options);
  if (s < 0) return s;
  p->image(p->self, "preview", 3 * one.width_px, one.height_px, o->rgb);
  return SV_OK;
}

sv_status sv_pictures_publish(const sv_pictures *o) {
  if (!o->publish->image) return SV_OK;
  if (o->t->n_measurements > 0) return show_measurement(o, &o->t->measurements[o->i_shown]);
  return o->t->n_views > 0 ? show_view(o, &o->t->views[o->i_shown]) : SV_OK;
}

// --- for the page --------------------------------------------------------------------------------

static int fitting_step(int width_px, int height_px, int cap_w, int cap_h) {
  return sv_maxi((width_px + cap_w - 1) / cap_w, (height_px + cap_h - 1) / cap_h);
}

// Where pixel (x, y) of the full image lands on the left half; NULL: it is skipped.
static uint8_t *pair_at(const sv_picture_pair *p, int step, int x, int y) {
  const int half_px = p->width_px / 2;
  if (x % step || y % step || x / step >= half_px || y / step >= p->height_px) return NULL;
  return p->rgb + 3 * ((size_t)(y / step) * 2 * (size_t)half_px + (size_t)(x / step));
}

static int begin_pair(sv_picture_pair *p, int width_px, int height_px) {
  const int step = fitting_step(2 * width_px, height_px, p->cap_width_px, p->cap_height_px);
  p->width_px = 2 * (width_px / step);
  p->height_px = height_px / step;
  return step;
}

static sv_status pair_of_view(sv_trainer *t, const sv_train_view *tv, sv_picture_pair *p) {
  const sv_planes *rendered;
  sv_status s = sv_driver_render_view(t, (int)(tv - t->views), &rendered);
  if (s < 0) return s;
  const int w = tv->view.width_px, h = tv->view.height_px, n_ch = tv->image.n_channels,
            step = begin_pair(p, w, h);
  double sum = 0;
  for (int y = 0; y < h; y++) {
    const uint8_t *in = tv->image.px + (size_t)y * (size_t)tv->image.stride_bytes;
    for (int x = 0; x < w; x++) {
      uint8_t got[3], *left = pair_at(p, step, x, y);
      sv_pictures_pixel(got, rendered, x, y);
      for (int k = 0; k < 3 && sv_image_counts(&tv->image, 1, x, y); k++) {
        double d = (double)got[k] - (double)in[n_ch * x + k];
        sum += d * d;
      }
      if (!left) continue;
      memcpy(left, in + n_ch * x, 3);
      memcpy(left + 3 * (size_t)(p->width_px / 2), got, 3);
    }
  }
  p->psnr =
      sv_psnr_of_mse(sum / (255.0 * 255.0 * 3.0 * (double)sv_maxi(1, (int)sv_image_n_counted(&tv->image))));
  return SV_OK;
}

// One region, which was predicted; returns its sum of squared differences.
static double pair_region(const sv_train_measurement *tc, const sv_region *r, const sv_planes *predicted,
                          const sv_picture_pair *p, int step) {
  double sum = 0;
  for (int y = r->y0; y < r->y1; y++)
    for (int x = r->x0; x < r->x1; x++) {
      const uint16_t *px = tc->px + 3 * ((size_t)y * (size_t)tc->model.width_px + (size_t)x);
      uint8_t got[3], *left = pair_at(p, step, x, y);
      sv_pictures_pixel(got, predicted, x - r->x0, y - r->y0);
      for (int k = 0; k < 3; k++) {
        double d = (double)got[k] / 255.0 - (double)px[k] / 65535.0;
        sum += d * d;
      }
      if (!left) continue;
      for (int k = 0; k < 3; k++) left[k] = (uint8_t)((px[k] + 128) / 257);
      memcpy(left + 3 * (size_t)(p->width_px / 2), got, 3);
    }
  return sum;
}

static sv_status pair_of_measurement(sv_trainer *t, const sv_train_measurement *tc, sv_picture_pair *p) {
  const sv_multiplexed *c = &tc->model;
  const int side = t->cfg.region_px, w = c->width_px, h = c->height_px, step = begin_pair(p, w, h);
  sv_render_options o = sv_train_render_options(t, 1.0f, false);
  double sum = 0;
  for (int y0 = 0; y0 < h; y0 += side)
    for (int x0 = 0; x0 < w; x0 += side) {
      sv_region r = {x0, y0, sv_mini(x0 + side, w), sv_mini(y0 + side, h)};
      sv_status s = sv_train_predict(t, c, &r, &o, NULL, NULL);
      if (s < 0) return s;
      sum += pair_region(tc, &r, &t->forward.predicted, p, step);
    }
  p->psnr = sv_psnr_of_mse(sum / (3.0 * w * h));
  return SV_OK;
}

sv_status sv_pictures_pair(sv_trainer *t, uint32_t i, sv_picture_pair *pair) {
  if (t->n_measurements > 0)
    return pair_of_measurement(t, &t->measurements[i % (uint32_t)t->n_measurements], pair);
  return t->n_views > 0 ? pair_of_view(t, &t->views[i % (uint32_t)t->n_views], pair) : SV_E_NOT_FOUND;
}
