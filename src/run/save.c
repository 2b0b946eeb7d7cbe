// SPDX-License-Identifier: Apache-2.0
// What a run leaves: model.ply and checkpoint.bin; and how good it is.
#include <string.h>

#include "src/run/app.h"
#include "src/base/mathx.h"
#include "src/deform/deform_file.h"
#include "src/format/axes.h"
#include "src/metric/metric.h"
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
  float up[3];
  sv_app_up(app, up);
  const sv_model_notes notes = {.is_mip = app->trainer.cfg.is_antialiased,
                                .dilation_px2 = app->trainer.cfg.dilation_px2,
                                .up = sv_up_name(up)};
  s = sv_model_write_ply(&app->trainer.g, &notes, store_sink(st), &app->ply, err);
  return finish(st, s, err);
}

sv_status sv_app_save_motion(sv_app *app, sv_err *err) {
  sv_store *st = &app->port.store;
  sv_status s = st->begin(st->self, "motion.bin", err);
  if (s < 0) return s;
  return finish(st, sv_deform_write(&app->trainer.deform, &app->trainer.g, store_sink(st), err), err);
}

sv_status sv_app_save_checkpoint(sv_app *app, sv_err *err) {
  sv_store *st = &app->port.store;
  sv_status s = st->begin(st->self, "checkpoint.bin", err);
  if (s < 0) return s;
  return finish(st, sv_checkpoint_write(&app->trainer, store_sink(st), err), err);
}

sv_status sv_app_save_all(sv_app *app, sv_err *err) {
  sv_status s = sv_app_save_model(app, err);
  if (s >= 0 && app->cfg.is_dynamic) s = sv_app_save_motion(app, err);
  if (s >= 0 && app->cfg.is_refining) s = sv_app_save_poses(app, err);
  if (s >= 0) s = sv_app_save_checkpoint(app, err);
  return s >= 0 ? sv_app_publish_preview(app) : s;
}

// FNV-1a over the words of a source string, without what does not change the pictures: a replay's speed and the slash
// that a shell's completion leaves behind a folder.
uint64_t sv_app_origin(const char *source) {
  uint64_t h = 14695981039346656037ull;
  for (const char *p = source; p && *p;) {
    size_t n = 0, kept;
    while (p[n] && p[n] != ',') n++;
    kept = n;
    while (kept > 1 && p[kept - 1] == '/') kept--;
    if (strncmp(p, "speed=", 6) == 0) kept = 0;
    for (size_t i = 0; i < kept; i++) h = (h ^ (unsigned char)p[i]) * 1099511628211ull;
    if (kept) h = (h ^ ',') * 1099511628211ull;
    p += n + (p[n] == ',');
  }
  return h;
}

sv_status sv_app_resume(sv_app *app, sv_err *err) {
  size_t bytes;
  sv_store *st = &app->port.store;
  sv_status s = st->read(st->self, "checkpoint.bin", app->checkpoint, app->checkpoint_bytes, &bytes, err);
  if (s == SV_E_NOT_FOUND) return SV_AGAIN;
  if (s == SV_E_NOMEM)
    return sv_fail(err, SV_E_RANGE,
                   "checkpoint.bin is larger than this run's %zu bytes: it was made with other "
                   "settings or by an older version",
                   app->checkpoint_bytes);
  if (s < 0) return s;
  return sv_checkpoint_read(&app->trainer, "checkpoint.bin", app->checkpoint, bytes, err);
}

sv_status sv_app_mse(sv_app *app, const sv_view *view, const uint8_t *rgb, double *mse) {
  sv_trainer *t = &app->trainer;
  sv_render_options o = sv_train_render_options(t, 1.0f, false);
  const sv_planes *p;
  sv_train_set_time(t, view->time);
  sv_status s = sv_train_measure(t, view, &o, sv_train_is_supersampled(t, 1, 1.0f), &p);
  if (s < 0) return s;
  double sum = 0;
  for (int y = 0; y < view->height_px; y++)
    for (int x = 0; x < view->width_px; x++)
      for (int c = 0; c < 3; c++) {
        double d = (double)sv_clampf(p->c[c][(long)y * p->stride + x], 0.0f, 1.0f) -
                   rgb[((size_t)y * (size_t)view->width_px + (size_t)x) * 3 + (size_t)c] / 255.0;
        sum += d * d;
      }
  *mse = sum / (3.0 * view->width_px * view->height_px);
  return SV_OK;
}

// Of what a sensor measured, region by region.
static sv_status composite_mse(sv_app *app, const sv_train_composite *tc, double *mse) {
  const int side = app->trainer.cfg.region_px, width_px = tc->model.width_px, height_px = tc->model.height_px;
  const sv_planes *p = &app->trainer.forward.predicted;
  sv_render_options o = sv_train_render_options(&app->trainer, 1.0f, false);
  double sum = 0;
  for (int y0 = 0; y0 < height_px; y0 += side)
    for (int x0 = 0; x0 < width_px; x0 += side) {
      sv_region r = {x0, y0, sv_mini(x0 + side, width_px), sv_mini(y0 + side, height_px)};
      sv_status s = sv_train_predict(&app->trainer, &tc->model, &r, &o, NULL, NULL);
      if (s < 0) return s;
      for (int y = y0; y < r.y1; y++)
        for (int x = x0; x < r.x1; x++)
          for (int k = 0; k < 3; k++) {
            double d = (double)sv_clampf(p->c[k][(long)(y - y0) * p->stride + (x - x0)], 0.0f, 1.0f) -
                       tc->px[((size_t)y * (size_t)width_px + (size_t)x) * 3 + (size_t)k] / 65535.0;
            sum += d * d;
          }
    }
  *mse = sum / (3.0 * width_px * height_px);
  return SV_OK;
}

sv_status sv_app_training_psnr(sv_app *app, double *psnr) {
  const sv_trainer *t = &app->trainer;
  *psnr = 0;
  for (int i = 0; i < t->n_views + t->n_composites; i++) {
    double mse;
    sv_status s = i < t->n_views ? sv_app_mse(app, &t->views[i].view, t->views[i].image.px, &mse)
                                 : composite_mse(app, &t->composites[i - t->n_views], &mse);
    if (s < 0) return s;
    *psnr += sv_psnr_of_mse(mse) / (t->n_views + t->n_composites);
  }
  return SV_OK;
}
