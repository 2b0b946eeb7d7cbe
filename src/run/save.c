// SPDX-License-Identifier: Apache-2.0
// What a run leaves: model.ply, motion.bin and checkpoint.bin.
#include <string.h>

#include "src/run/app.h"
#include "src/deform/deform_file.h"
#include "src/format/axes.h"
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
  s = sv_model_write_ply(&app->trainer.g, &notes, store_sink(st), &app->files.ply, err);
  return finish(st, s, err);
}

sv_status sv_app_save_motion(sv_app *app, sv_err *err) {
  sv_store *st = &app->port.store;
  sv_status s = st->begin(st->self, "motion.bin", err);
  if (s < 0) return s;
  return finish(st, sv_deform_write(&app->dynamic.deform, &app->trainer.g, store_sink(st), err), err);
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

// FNV-1a over the words of a source string, without what does not change the pictures: a replay's
// speed and the slash that a shell's completion leaves behind a folder.
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
  sv_status s =
      st->read(st->self, "checkpoint.bin", app->files.checkpoint, app->files.checkpoint_bytes, &bytes, err);
  if (s == SV_E_NOT_FOUND) return SV_AGAIN;
  if (s == SV_E_NOMEM)
    return sv_fail(err, SV_E_RANGE,
                   "checkpoint.bin is larger than this run's %zu bytes: it was made with other "
                   "settings or by an older version",
                   app->files.checkpoint_bytes);
  if (s < 0) return s;
  return sv_checkpoint_read(&app->trainer, "checkpoint.bin", app->files.checkpoint, bytes, err);
}
