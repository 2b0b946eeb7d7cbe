// SPDX-License-Identifier: Apache-2.0
// What a run leaves: model.ply, checkpoint.bin, the preview picture.
#include <string.h>

#include "src/app/app.h"
#include "src/base/mathx.h"
#include "src/train/checkpoint.h"

static sv_sink store_sink(sv_store *st) { return (sv_sink){.self = st->self, .write = st->write}; }

// Between begin and commit; after a failure the old file is still there.
static sv_status finish(sv_store *st, sv_status s, sv_err *err) {
  if (s >= 0) return st->commit(st->self, err);
  st->abandon(st->self);
  return s;
}

sv_status sv_app_save_model(sv_app *app, sv_err *err) {
  sv_store *st = &app->port.store;
  sv_status s = st->begin(st->self, "model.ply", err);
  if (s < 0) return s;
  s = sv_model_write_ply(&app->trainer.g, app->trainer.cfg.is_antialiased, store_sink(st), &app->ply, err);
  return finish(st, s, err);
}

sv_status sv_app_save_checkpoint(sv_app *app, sv_err *err) {
  sv_store *st = &app->port.store;
  sv_status s = st->begin(st->self, "checkpoint.bin", err);
  if (s < 0) return s;
  return finish(st, sv_checkpoint_write(&app->trainer, store_sink(st), err), err);
}

sv_status sv_app_resume(sv_app *app, sv_err *err) {
  size_t bytes;
  sv_store *st = &app->port.store;
  sv_status s = st->read(st->self, "checkpoint.bin", app->checkpoint, app->checkpoint_bytes, &bytes, err);
  if (s == SV_E_NOT_FOUND) return SV_AGAIN;
  if (s == SV_E_NOMEM)
    return sv_fail(err, SV_E_RANGE,
                   "checkpoint.bin is larger than this run's %zu bytes: it was made with other "
                   "settings",
                   app->checkpoint_bytes);
  if (s < 0) return s;
  return sv_checkpoint_read(&app->trainer, "checkpoint.bin", app->checkpoint, bytes, err);
}

static uint8_t to_u8(float x) { return (uint8_t)(sv_clampf(x, 0.0f, 1.0f) * 255.0f + 0.5f); }

sv_status sv_app_publish_preview(sv_app *app) {
  const sv_train_view *tv = &app->trainer.views[0];
  const sv_publish *p = &app->port.publish;
  if (!p->image || app->trainer.n_views < 1) return SV_OK;
  sv_render_options o = sv_train_render_options(&app->trainer, 1.0f, false);
  sv_renderer *r = &app->trainer.render;
  sv_status s = sv_render(r, app->k, &app->port.pool, &app->trainer.g, &tv->view, &o);
  if (s < 0) return s;
  int w = tv->view.width_px, h = tv->view.height_px;
  for (int y = 0; y < h; y++) {
    uint8_t *left = app->preview + (size_t)y * (size_t)w * 6, *right = left + (size_t)w * 3;
    memcpy(left, tv->image.px + (size_t)y * (size_t)tv->image.stride_bytes, (size_t)w * 3);
    for (int x = 0; x < w; x++)
      for (int c = 0; c < 3; c++) right[3 * x + c] = to_u8(r->rgb.c[c][(long)y * r->rgb.stride + x]);
  }
  p->image(p->self, "preview", 2 * w, h, app->preview);
  return SV_OK;
}

sv_status sv_app_mse(sv_app *app, const sv_view *view, const uint8_t *rgb, double *mse) {
  sv_render_options o = sv_train_render_options(&app->trainer, 1.0f, false);
  sv_renderer *r = &app->trainer.render;
  sv_status s = sv_render(r, app->k, &app->port.pool, &app->trainer.g, view, &o);
  if (s < 0) return s;
  double sum = 0;
  for (int y = 0; y < view->height_px; y++)
    for (int x = 0; x < view->width_px; x++)
      for (int c = 0; c < 3; c++) {
        double d = (double)sv_clampf(r->rgb.c[c][(long)y * r->rgb.stride + x], 0.0f, 1.0f) -
                   rgb[((size_t)y * (size_t)view->width_px + (size_t)x) * 3 + (size_t)c] / 255.0;
        sum += d * d;
      }
  *mse = sum / (3.0 * view->width_px * view->height_px);
  return SV_OK;
}

sv_status sv_app_training_psnr(sv_app *app, double *psnr) {
  *psnr = 0;
  for (int i = 0; i < app->trainer.n_views; i++) {
    const sv_train_view *tv = &app->trainer.views[i];
    double mse;
    sv_status s = sv_app_mse(app, &tv->view, tv->image.px, &mse);
    if (s < 0) return s;
    *psnr += -10.0 / 2.302585092994046 * sv_log(mse > 1e-12 ? mse : 1e-12) / app->trainer.n_views;
  }
  return SV_OK;
}
