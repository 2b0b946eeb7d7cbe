// SPDX-License-Identifier: Apache-2.0
// Saving what a run leaves. A store that refuses costs a warning while training. At the end it is
// asked for some seconds, then what it does not take goes to the port's second place.
#include <math.h>
#include <string.h>

#include "src/run/app.h"
#include "src/base/mathx.h"
#include "src/base/str.h"
#include "src/deform/deform_file.h"
#include "src/deform/deform_sequence.h"
#include "src/format/axes.h"
#include "src/train/checkpoint.h"

#define CHECKPOINT   "checkpoint.bin"
#define CHECKPOINT_1 "checkpoint.1.bin"

#define N_TRIES       6                    // of the final save
#define FIRST_WAIT_NS (250 * SV_NS_PER_MS) // between the first two; then twice as long each
#define CAP_DOUBLINGS 6                    // 64 s between two tries while training

const char *sv_app_file_name(sv_app_file f) {
  static const char *const names[SV_APP_N_FILES] = {"model.ply",  "motion.bin", "model.svseq",
                                                    "poses.json", CHECKPOINT,   "run.json"};
  return names[f];
}

// --- one file ------------------------------------------------------------------------------------

sv_unit sv_app_unit(const sv_app *app) {
  const sv_odometry *o = &app->odometry;
  const double rig = app->cfg.rig->scale_sigma, tracked = o->is_tracked ? o->summary.scale_sigma : 0;
  if (app->cfg.rig->n_sub_views < 2 || tracked < 0 || tracked > SV_ODOMETRY_SCALE_DOUBT)
    return (sv_unit){.is_metric = false};
  return (sv_unit){.is_metric = true, .scale_sigma = (float)sqrt(rig * rig + tracked * tracked)};
}

static sv_status write_model(sv_app *app, sv_sink sink, sv_err *err) {
  float up[3];
  sv_pictures_up(&app->trainer, up);
  sv_model_notes notes = sv_driver_notes(&app->trainer);
  notes.up = sv_up_name(up);
  notes.unit = sv_app_unit(app);
  return sv_model_write_ply(&app->trainer.g, &notes, sink, &app->files.ply, err);
}

// A frame for each exposure, live the last ones; the Gaussians then stand where they stood.
static sv_status write_sequence(sv_app *app, sv_sink sink, sv_err *err) {
  if (app->cfg.is_continuous) return sv_app_write_history(app, sink, err);
  sv_trainer *t = &app->trainer;
  float up[3];
  sv_arena scratch = app->scratch;
  sv_sequence_head h = {.n_frames = (uint32_t)sv_app_n_frames(&app->cfg),
                        .is_mip = t->cfg.is_antialiased,
                        .unit = sv_app_unit(app),
                        .dilation_px2 = t->cfg.dilation_px2,
                        .seconds = (float)sv_ns_to_s(app->moving.last_ns - app->moving.first_ns),
                        .radius = t->radius};
  void *state = SV_TAKE(&scratch, uint8_t, sv_deform_sequence_bytes(t->g.n, (int)h.n_frames));
  if (!state) return sv_fail(err, SV_E_NOMEM, "model.svseq: no memory for %u frames", h.n_frames);
  memcpy(h.centre, t->centre, sizeof h.centre);
  sv_pictures_up(t, up);
  sv_copy(h.up, sizeof h.up, sv_up_name(up));
  sv_status s = sv_deform_write_sequence(&app->dynamic.deform, &t->compute, &t->g, &h, state, sink, err);
  sv_deform_at(&app->dynamic.deform, &t->compute, &t->g, app->dynamic.time);
  return s;
}

// A large file on a slow disk is progress, too.
typedef struct {
  sv_app *app;
  sv_store *store;
} beating_sink;

static sv_status write_and_beat(void *self, const void *data, size_t bytes, sv_err *err) {
  const beating_sink *k = self;
  sv_app_beat(k->app);
  return k->store->write(k->store->self, data, bytes, err);
}

static sv_status write_file(sv_app *app, sv_app_file f, sv_sink sink, sv_err *err) {
  const sv_app_files *files = &app->files;
  switch (f) {
  case SV_APP_FILE_MODEL: return write_model(app, sink, err);
  case SV_APP_FILE_MOTION: return sv_deform_write(&app->dynamic.deform, &app->trainer.g, sink, err);
  case SV_APP_FILE_SEQUENCE: return write_sequence(app, sink, err);
  case SV_APP_FILE_POSES: return sv_app_write_poses(app, sink, err);
  case SV_APP_FILE_CHECKPOINT: return sv_checkpoint_write(&app->trainer, sink, err);
  default: return sink.write(sink.self, files->report, files->report_bytes, err);
  }
}

static sv_status commit(sv_app *app, sv_store *st, sv_app_file f, sv_err *err) {
  if (f != SV_APP_FILE_CHECKPOINT || !st->commit_over) return st->commit(st->self, err);
  // A damaged checkpoint, or one of an earlier run, never takes the place of a good one.
  return st->commit_over(st->self, CHECKPOINT_1, st == &app->port.store && app->files.has_checkpoint, err);
}

static sv_status put(sv_app *app, sv_store *st, sv_app_file f, sv_err *err) {
  sv_status s = st->begin(st->self, sv_app_file_name(f), err);
  if (s < 0) return s;
  beating_sink sink = {.app = app, .store = st};
  s = write_file(app, f, (sv_sink){.self = &sink, .write = write_and_beat}, err);
  if (s < 0) {
    st->abandon(st->self); // the old file is still there
    return s;
  }
  s = commit(app, st, f, err);
  if (s >= 0 && f == SV_APP_FILE_CHECKPOINT && st == &app->port.store) app->files.has_checkpoint = true;
  return s;
}

sv_status sv_app_save_model(sv_app *app, sv_err *err) {
  return put(app, &app->port.store, SV_APP_FILE_MODEL, err);
}
sv_status sv_app_save_motion(sv_app *app, sv_err *err) {
  return put(app, &app->port.store, SV_APP_FILE_MOTION, err);
}
sv_status sv_app_save_checkpoint(sv_app *app, sv_err *err) {
  return put(app, &app->port.store, SV_APP_FILE_CHECKPOINT, err);
}

// --- while training ------------------------------------------------------------------------------

sv_status sv_app_save_running(sv_app *app, double now_s, sv_err *err) {
  sv_app_files *f = &app->files;
  sv_status s = sv_app_save_checkpoint(app, err);
  if (s >= 0 && f->n_failed) sv_app_log(app, SV_LOG_INFO, CHECKPOINT " is saved again");
  if (s >= 0) f->n_failed = 0;
  if (s != SV_E_IO) return s;
  const int wait_s = 1 << sv_mini(f->n_failed++, CAP_DOUBLINGS);
  f->retry_s = now_s + wait_s;
  sv_app_log(app, SV_LOG_WARN, "%s; the run goes on, next try in %d s", err->text, wait_s);
  return SV_OK;
}

// --- at the end ----------------------------------------------------------------------------------

static sv_status put_with_patience(sv_app *app, sv_app_file f, sv_err *err) {
  const sv_clock *m = &app->port.machine;
  sv_status s = put(app, &app->port.store, f, err);
  for (int i = 1; s == SV_E_IO && i < N_TRIES && !app->files.is_store_lost; i++) {
    if (i == 1) sv_app_log(app, SV_LOG_WARN, "%s; trying again for some seconds", err->text);
    sv_app_beat(app);
    m->sleep_until_ns(m->self, m->now_ns(m->self) + (FIRST_WAIT_NS << (i - 1)));
    s = put(app, &app->port.store, f, err);
  }
  if (s == SV_E_IO) app->files.is_store_lost = true;
  return s;
}

static sv_status put_surely(sv_app *app, sv_app_file f, sv_err *err) {
  sv_err second;
  sv_store *rescue = &app->port.rescue;
  sv_status s = put_with_patience(app, f, err);
  if (s != SV_E_IO || !rescue->begin) return s;
  if (put(app, rescue, f, &second) < 0) {
    sv_app_log(app, SV_LOG_WARN, "%s", second.text);
    return s;
  }
  app->files.rescued |= 1u << f;
  sv_app_log(app, SV_LOG_WARN, "%s is saved in %s instead", sv_app_file_name(f), app->port.rescue_dir);
  return SV_OK;
}

typedef sv_status (*put_fn)(sv_app *app, sv_app_file f, sv_err *err);

static sv_status put_once(sv_app *app, sv_app_file f, sv_err *err) {
  return put(app, &app->port.store, f, err);
}

// Each is tried; of the failures the first is told.
static sv_status save_each(sv_app *app, put_fn put_file, sv_err *err) {
  const bool is_wanted[SV_APP_N_FILES] = {
      [SV_APP_FILE_MODEL] = true,
      [SV_APP_FILE_MOTION] = app->cfg.is_dynamic,
      [SV_APP_FILE_SEQUENCE] =
          sv_app_has_sequence(&app->cfg) && (!app->cfg.is_continuous || sv_app_has_past(app)),
      [SV_APP_FILE_POSES] = app->cfg.is_refining || app->odometry.is_tracked,
      [SV_APP_FILE_CHECKPOINT] = true};
  sv_status first = SV_OK;
  if (app->cfg.is_refining) sv_app_take_poses(app);
  sv_app_note_history(app);
  for (int f = 0; f < SV_APP_N_FILES; f++) {
    sv_err why;
    sv_status s = is_wanted[f] ? put_file(app, (sv_app_file)f, &why) : SV_OK;
    if (s >= 0 || first < 0) continue;
    first = s;
    *err = why;
  }
  sv_status shown = sv_app_publish_preview(app);
  return first < 0 ? first : shown;
}

sv_status sv_app_save_all(sv_app *app, sv_err *err) { return save_each(app, put_once, err); }
sv_status sv_app_save_final(sv_app *app, sv_err *err) { return save_each(app, put_surely, err); }

sv_status sv_app_put_report(sv_app *app, sv_err *err) { return put_surely(app, SV_APP_FILE_REPORT, err); }

// --- resume --------------------------------------------------------------------------------------

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

static sv_status resume_from(sv_app *app, const char *name, sv_err *err) {
  size_t bytes;
  sv_store *st = &app->port.store;
  sv_status s = st->read(st->self, name, app->files.checkpoint, app->files.checkpoint_bytes, &bytes, err);
  if (s == SV_E_NOMEM)
    return sv_fail(err, s,
                   "%s is larger than this run's %zu bytes: it was made with other settings or by an older "
                   "version",
                   name, app->files.checkpoint_bytes);
  if (s >= 0) s = sv_checkpoint_read(&app->trainer, name, app->files.checkpoint, bytes, err);
  if (s >= 0) sv_app_log(app, SV_LOG_INFO, "resumed at step %u from %s", app->trainer.step, name);
  return s;
}

// Not of another run: that is a mistake of who started this one.
static bool is_damage(sv_status s) {
  return s == SV_E_NOT_FOUND || s == SV_E_IO || s == SV_E_NOMEM || s == SV_E_FORMAT || s == SV_E_CORRUPT;
}

sv_status sv_app_resume(sv_app *app, sv_err *err) {
  sv_err older_err;
  sv_status s = resume_from(app, CHECKPOINT, err);
  app->files.has_checkpoint = s >= 0;
  if (s >= 0 || !is_damage(s)) return s;
  sv_status older = resume_from(app, CHECKPOINT_1, &older_err);
  if (older >= 0) {
    sv_app_log(app, SV_LOG_WARN, "%s; going on from the checkpoint before it", err->text);
    return SV_OK;
  }
  if (s == SV_E_NOT_FOUND && older == SV_E_NOT_FOUND) return SV_AGAIN;
  if (s == SV_E_NOT_FOUND) {
    *err = older_err;
    return older;
  }
  if (s == SV_E_NOMEM) err->status = SV_E_RANGE;
  return s == SV_E_NOMEM ? SV_E_RANGE : s;
}
