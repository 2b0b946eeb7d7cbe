// SPDX-License-Identifier: Apache-2.0
#include "src/run/app.h"

#include <math.h>
#include <stdarg.h>
#include <string.h>

#include "src/base/mathx.h"
#include "src/deform/deform_sequence.h"
#include "src/train/checkpoint.h"

#define MAX_LAST_TURN_S 1
#define QUEUE_LEN       4
#define CAP_READY       2    // exposures that may wait for a training step to end
#define RELEASE_AT      0.8f // progress
#define MEASURED_VIEWS  13   // while training: not a multiple of the usual numbers of sub-views

const char *sv_app_state_name(sv_app_state s) {
  static const char *const names[] = {"idle", "capturing", "training", "saving", "done", "failed"};
  return (unsigned)s < sizeof names / sizeof *names ? names[s] : "?";
}

void sv_app_log(sv_app *app, sv_log_level level, const char *fmt, ...) {
  char line[256];
  va_list ap;
  va_start(ap, fmt);
  sv_vfmt(line, sizeof line, fmt, ap);
  va_end(ap);
  if (app->port.console.log) app->port.console.log(app->port.console.self, level, line);
  sv_preview_event(&app->preview, level, line);
}

bool sv_app_is_stop_requested(const sv_app *app) {
  const sv_console *c = &app->port.console;
  return c->is_stop_requested && c->is_stop_requested(c->self);
}

void sv_app_beat(sv_app *app) { sv_beat(app->port.heartbeats, SV_BEAT_MAIN); }

// The first image of the newest exposure where exposures are replaced, else of the first one.
static int shown_image(const sv_app *app) {
  const sv_exposures *e = &app->exposures;
  const int n = sv_maxi(app->trainer.n_measurements, app->trainer.n_views);
  if (!app->cfg.is_continuous || e->n < 1) return 0;
  return (e->i_next + e->n - 1) % e->n * (n / e->n);
}

sv_pictures sv_app_pictures(sv_app *app) {
  return (sv_pictures){
      .t = &app->trainer, .publish = &app->port.publish, .rgb = app->picture, .i_shown = shown_image(app)};
}

sv_status sv_app_publish_preview(sv_app *app) {
  const sv_pictures p = sv_app_pictures(app);
  return sv_pictures_publish(&p);
}

sv_heat sv_app_heat(sv_app *app) {
  const sv_thermometer *t = &app->port.thermometer;
  if (t->read) app->heat = t->read(t->self);
  if (!(app->hottest_c >= app->heat.temperature_c)) app->hottest_c = app->heat.temperature_c;
  return app->heat;
}

static bool is_multiplexed(const sv_app_cfg *c) { return c->rig->forward == SV_FORWARD_MULTIPLEXED; }

// Odometry finds the rig's poses.
static bool is_handheld(const sv_app_cfg *c) {
  return c->is_tracking && sv_odometry_can(c->rig, c->n_exposures);
}

static size_t history_state(const sv_app_cfg *c) {
  const sv_history_cfg h = sv_app_history_cfg(c);
  return sv_history_state_bytes(&h);
}

// Of the start: the driver's, and before it the views in a row. At the end: a sequence's.
static size_t scratch_bytes(const sv_app_cfg *c, const sv_train_cfg *t) {
  const size_t start = sv_driver_scratch_bytes(t, t->n_gaussians),
               views =
                   (size_t)c->n_exposures * (size_t)c->rig->n_sub_views * sizeof(sv_view) + SV_ARENA_ALIGN;
  const size_t most = start > views ? start : views,
               sequence = sv_app_has_history(c) ? history_state(c)
                          : sv_app_has_sequence(c)
                              ? sv_deform_sequence_bytes(t->n_gaussians, sv_app_n_frames(c))
                              : 0;
  return most > sequence + SV_ARENA_ALIGN ? most : sequence + SV_ARENA_ALIGN;
}

static void show_frame(void *self, const sv_frame *f) {
  sv_app *app = self;
  sv_preview_frame(&app->preview, f);
}

static sv_capture_queue_cfg queue_cfg(const sv_app_cfg *c, sv_app *app) {
  return (sv_capture_queue_cfg){.n_cameras = c->n_cameras,
                                .caps = c->caps,
                                .skew_limit_ns = c->skew_limit_ns,
                                .queue_len = QUEUE_LEN,
                                .cap_ready = CAP_READY,
                                .method = c->sync_method,
                                .on_frame = c->has_preview ? show_frame : NULL,
                                .on_frame_self = app};
}

// The way from the cameras to the pool, and odometry.
static sv_status carve_capture(sv_app *app, const sv_app_cfg *c, const sv_train_cfg *t, const sv_kernels *k,
                               sv_arena *a, sv_err *err) {
  sv_arena_part_begin(a, "sync");
  sv_capture_queue_cfg qc = queue_cfg(c, app);
  if (a->base) {
    sv_status s = sv_capture_queue_init(&app->queue, &qc, &app->port.source, &app->port.clock, a);
    if (s < 0)
      return sv_fail(err, s, "frame synchronization of %d cameras with a skew limit of %g ms: %s",
                     c->n_cameras, sv_ns_to_ms(c->skew_limit_ns), sv_status_text(s));
  } else {
    SV_TAKE(a, uint8_t, sv_capture_queue_bytes(&qc));
  }
  sv_arena_part_begin(a, "exposures");
  const sv_exposures_cfg ec = {.rig = c->rig,
                               .cap_exposures = c->n_exposures,
                               .caps = c->caps,
                               .n_cameras = c->n_cameras,
                               .n_threads = t->n_threads,
                               .decoder = &app->port.decoder,
                               .is_blur_dropped = is_handheld(c) && !c->is_blur_kept,
                               .spacing = c->spacing,
                               .hold_out = c->hold_out,
                               .is_deep = c->is_deep};
  sv_status s = sv_exposures_init(&app->exposures, &ec, a, err);
  const sv_odometry_cfg oc = {.rig = c->rig,
                              .cap_exposures = c->n_exposures,
                              .pool = a->base ? &app->exposures : NULL,
                              .k = k,
                              .seed = c->train.seed,
                              .imu = c->imu,
                              .is_rolling = t->is_rolling,
                              .heartbeats = app->port.heartbeats};
  if (s >= 0 && is_handheld(c)) s = sv_odometry_init(&app->odometry, &oc, a, err);
  return s;
}

static sv_status carve_training(sv_app *app, const sv_app_cfg *c, const sv_train_cfg *t, sv_compute compute,
                                sv_arena *a, sv_err *err) {
  const sv_dynamic_cfg dynamic = sv_app_dynamic_cfg(c);
  const sv_prior_cfg prior = sv_app_prior_cfg(c, t->cap_views);
  const sv_history_cfg history = sv_app_history_cfg(c);
  sv_status s = sv_trainer_init(&app->trainer, t, compute, a, err);
  if (s < 0) return s;
  app->trainer.light = app->exposures.light;
  app->trainer.n_light = c->is_deep ? 1 + c->n_cameras : 0;
  s = sv_dynamic_init(&app->dynamic, &dynamic, &app->trainer, a, err);
  if (s >= 0) s = sv_prior_init(&app->prior, &prior, &app->trainer, a, err);
  if (s < 0) return s;
  if (history.n > 0) sv_arena_part_begin(a, "history");
  sv_history_carve(&app->moving.history, &history, a);
  sv_arena_part_begin(a, "start-up scratch");
  app->points = SV_TAKE(a, sv_point, t->n_gaussians);
  app->scratch = sv_arena_sub(a, scratch_bytes(c, t));
  return SV_OK;
}

// What leaves the run: files, preview.jpg, the page.
static void carve_output(sv_app *app, const sv_app_cfg *c, sv_arena *a) {
  int w, h;
  sv_arena_part_begin(a, "checkpoint and report");
  app->files.report = SV_TAKE(a, char, SV_APP_REPORT_BYTES);
  app->files.checkpoint_bytes = c->is_resume ? sv_checkpoint_bytes(&app->trainer) : 0;
  app->files.checkpoint = SV_TAKE(a, uint8_t, app->files.checkpoint_bytes);
  sv_pictures_size(c->rig, c->caps, c->n_cameras, &w, &h);
  app->picture = SV_TAKE(a, uint8_t, (size_t)w * (size_t)h * 3);
  sv_preview_carve(&app->preview, &(sv_preview_parts){c->has_preview, c->has_screen, c->n_cameras}, a);
}

static sv_status carve(sv_app *app, const sv_app_cfg *c, const sv_train_cfg *t, sv_compute compute,
                       sv_arena *a, sv_err *err) {
  sv_status s = carve_capture(app, c, t, compute.k, a, err);
  if (s >= 0) s = carve_training(app, c, t, compute, a, err);
  if (s < 0) return s;
  carve_output(app, c, a);
  return a->status < 0 ? sv_fail(err, a->status, "the memory block is too small") : SV_OK;
}

// --- capture -------------------------------------------------------------------------------------

static void log_line(void *self, sv_log_level level, const char *line) {
  sv_app_log(self, level, "%s", line);
}

static sv_status poll(void *self) {
  sv_app_beat(self);
  return sv_app_is_stop_requested(self) ? SV_E_INTERRUPTED : SV_OK;
}

static sv_status serve_page(void *self) {
  sv_app *app = self;
  return sv_preview_tick(&app->preview);
}

static void show_exposure(void *self) {
  sv_app *app = self;
  sv_preview_exposure(&app->preview);
}

static sv_heat heat_now(void *self) { return sv_app_heat(self); }
static bool is_exposure_due(void *self) { return sv_app_is_exposure_due(self); }
// The turn of the newest exposure is completed, unless that takes long.
static bool may_end(void *self) {
  const sv_app *app = self;
  return app->cfg.exposure_s > MAX_LAST_TURN_S || sv_app_is_exposure_due(app);
}
static sv_status publish(void *self) { return sv_app_publish_preview(self); }

// The newest exposure takes the place of the oldest, in the pool and in what is trained on.
static sv_status replace_oldest(void *self, sv_err *err) {
  sv_app *app = self;
  int slot = app->exposures.i_next, i_view = 0, n = sv_app_n_trained_sub_views(&app->cfg);
  sv_status s = sv_app_leave_exposure(app);
  if (s < 0) return s;
  s = sv_capture_side_keep(&app->capture, err);
  if (s != SV_OK || is_multiplexed(&app->cfg)) return s; // lenses are in the pool itself
  for (int i = 0; i < app->cfg.rig->n_sub_views; i++) {
    sv_image_u8 image;
    sv_view view;
    if (!sv_app_is_trained_on(&app->cfg, i)) continue;
    sv_exposures_get(&app->exposures, slot, i, &image, &view);
    view.time = sv_app_time_of(app, app->exposures.exposure[slot].time_ns);
    sv_train_replace_view(&app->trainer, slot * n + i_view, &view, &image);
    sv_app_describe_view(app, slot * n + i_view++, slot, i);
  }
  return sv_app_enter_exposure(app, slot);
}

static sv_guidance_cfg guidance_cfg(const sv_app_cfg *c) {
  sv_guidance_cfg g = c->guidance;
  g.rig = c->is_dynamic ? NULL : c->rig; // a moving scene is not walked around
  if (c->has_bounds) g.bounds = c->bounds;
  return g;
}

static void init_capture(sv_app *app) {
  const sv_app_cfg *c = &app->cfg;
  const sv_capture_side_cfg cfg = {.queue = &app->queue,
                                   .exposures = &app->exposures,
                                   .port = &app->port,
                                   .k = app->k,
                                   .rig = c->rig,
                                   .caps = c->caps,
                                   .n_cameras = c->n_cameras,
                                   .n_exposures = c->n_exposures,
                                   .skew_limit_ns = c->skew_limit_ns,
                                   .timeout_ns = c->capture_timeout_ns,
                                   .is_continuous = c->is_continuous,
                                   .preview_every_s = c->preview_every_s,
                                   .odometry = &app->odometry,
                                   .guidance = guidance_cfg(c),
                                   .calls = {.self = app,
                                             .log = log_line,
                                             .poll = poll,
                                             .serve = serve_page,
                                             .kept = show_exposure,
                                             .heat = heat_now,
                                             .is_exposure_due = is_exposure_due,
                                             .replace = replace_oldest,
                                             .publish = publish}};
  sv_capture_side_init(&app->capture, &cfg);
}

static bool is_stopping(void *self) { return sv_app_is_stop_requested(self); }
static sv_status save(void *self, sv_err *err) { return sv_app_save_all(self, err); }
static void beat(void *self) { sv_app_beat(self); }
static sv_unit unit(void *self) { return sv_app_unit(self); }
static sv_status write_history(void *self, sv_sink sink, sv_err *err) {
  return sv_app_write_history(self, sink, err);
}
static float time_of(void *self, sv_ns time_ns) { return sv_app_time_of(self, time_ns); }

static void init_preview(sv_app *app) {
  const sv_app_cfg *c = &app->cfg;
  const sv_preview_cfg cfg = {.port = &app->port,
                              .k = app->k,
                              .arena = app->arena,
                              .queue = &app->queue,
                              .capture = &app->capture,
                              .exposures = &app->exposures,
                              .trainer = &app->trainer,
                              .dynamic = &app->dynamic,
                              .history = &app->moving.history,
                              .driver = &app->driver,
                              .rig = c->rig,
                              .caps = c->caps,
                              .n_cameras = c->n_cameras,
                              .n_exposures = c->n_exposures,
                              .source_name = c->source_name,
                              .board_name = c->board_name,
                              .steps = c->steps,
                              .time_limit_s = c->time_limit_s,
                              .is_session = c->is_session,
                              .starts_at_once = c->starts_at_once,
                              .has_budget =
                                  c->is_session && !c->starts_at_once && !c->is_dynamic && !c->is_continuous,
                              .calls = {.self = app,
                                        .log = log_line,
                                        .beat = beat,
                                        .is_stopping = is_stopping,
                                        .save = save,
                                        .heat = heat_now,
                                        .unit = unit,
                                        .time_of = time_of,
                                        .write_history = write_history}};
  sv_preview_init(&app->preview, &cfg);
}

static const char *why_untracked(const sv_app_cfg *c) {
  return c->is_continuous    ? "--live does not track"
         : is_multiplexed(c) ? "a multiplexed sensor is not tracked"
                             : "tracking is off";
}

// The budget that was chosen on the page scales the steps, the time, and the schedules with them.
static void apply_budget(sv_app *app) {
  const float factor = sv_preview_budget_factor(app->preview.budget);
  if (factor == 1) return;
  if (app->cfg.steps) app->cfg.steps = (uint32_t)sv_maxf(1, (float)app->cfg.steps * factor);
  app->cfg.time_limit_s *= (double)factor;
  app->preview.cfg.steps = app->cfg.steps;
  app->preview.cfg.time_limit_s = app->cfg.time_limit_s;
  if (app->cfg.steps) app->trainer.cfg.expected_steps = (int)app->cfg.steps;
}

static sv_status capture(sv_app *app, sv_err *err) {
  app->state = SV_APP_CAPTURING;
  sv_status s = sv_preview_wait_start(&app->preview, err);
  apply_budget(app);
  if (s >= 0) s = sv_capture_side_run(&app->capture, err);
  if (s >= 0) s = sv_capture_side_track(&app->capture, &app->odometry, why_untracked(&app->cfg), err);
  return s;
}

// --- memory --------------------------------------------------------------------------------------

sv_status sv_app_plan(sv_app *app, const sv_app_cfg *cfg, int n_threads, sv_arena *dry, sv_err *err) {
  sv_train_cfg t = sv_app_train_cfg(cfg, n_threads);
  memset(app, 0, sizeof *app);
  return carve(app, cfg, &t, (sv_compute){0}, dry, err);
}

sv_status sv_app_init(sv_app *app, const sv_app_cfg *cfg, const sv_kernels *k, const sv_port *port,
                      sv_arena *arena, sv_err *err) {
  if (cfg->n_exposures < 1)
    return sv_fail(err, SV_E_ARG, "%d exposures asked for, expected at least 1", cfg->n_exposures);
  if (is_multiplexed(cfg) && sv_app_n_trained_sub_views(cfg) != cfg->rig->n_sub_views)
    return sv_fail(
        err, SV_E_UNSUPPORTED,
        "rig \"%s\" is multiplexed: its sub-views overlap on their sensor and can only be trained on "
        "together, not %d of %d",
        cfg->rig->name, sv_app_n_trained_sub_views(cfg), cfg->rig->n_sub_views);
  if (is_multiplexed(cfg) && cfg->hold_out > 0)
    return sv_fail(err, SV_E_UNSUPPORTED,
                   "rig \"%s\" is multiplexed: its pixels show several sub-views, so none can be held out",
                   cfg->rig->name);
  if (cfg->is_deep && (is_multiplexed(cfg) || cfg->is_dynamic || cfg->prior))
    return sv_fail(err, SV_E_UNSUPPORTED,
                   "16 bits a value are for still scenes without a prior, and not for multiplexed sensors");
  if (!sv_app_n_trained_sub_views(cfg))
    return sv_fail(err, SV_E_ARG, "none of the chosen sub-views is in rig \"%s\", which has %d",
                   cfg->rig->name, cfg->rig->n_sub_views);
  memset(app, 0, sizeof *app);
  app->cfg = *cfg;
  app->k = k;
  app->port = *port;
  app->port.pool = sv_watch_pool(&app->pool, &port->pool, port->heartbeats);
  app->heat = (sv_heat){.temperature_c = (double)NAN, .is_throttled = -1};
  app->hottest_c = (double)NAN;
  init_capture(app);
  app->arena = arena;
  init_preview(app);
  sv_train_cfg t = sv_app_train_cfg(cfg, port->pool.n_threads);
  size_t left = arena->cap_bytes - arena->used_bytes, used = arena->used_bytes;
  sv_status s = carve(app, cfg, &t, (sv_compute){k, &app->port.pool}, arena, err);
  if (s == SV_E_NOMEM) {
    sv_arena dry = sv_arena_dry();
    if (sv_app_plan(app, cfg, port->pool.n_threads, &dry, err) < 0) return SV_E_NOMEM;
    return sv_fail(
        err, s,
        "the run needs %zu MiB, this board's block has %zu MiB; reduce --exposures (%d) or --gaussians (%d)",
        (dry.used_bytes + used + 1048575) >> 20, (left + used) >> 20, cfg->n_exposures, t.n_gaussians);
  }
  app->trainer.origin = sv_app_origin(cfg->source_name);
  if (s >= 0) sv_arena_seal(arena);
  return s;
}

// --- between steps -------------------------------------------------------------------------------

// All pixels are trained on in the last part of a run that has judged itself by some of them.
static sv_status release_held(sv_app *app, float progress) {
  const bool is_due = app->driver.plateau.n_steps || progress >= RELEASE_AT;
  if (!app->cfg.is_held_released || app->released_psnr > 0 || !is_due) return SV_OK;
  double db;
  sv_status s = sv_app_held_out_psnr(app, app->trainer.n_views, &db);
  if (s < 0) return s;
  app->released_psnr = db;
  sv_app_hold(app, false);
  return SV_OK;
}

static sv_status before_step(void *self, float progress, sv_driver_turn *turn, sv_err *err) {
  sv_app *app = self;
  bool is_train = true;
  sv_app_beat(app);
  sv_status s = release_held(app, progress);
  if (s < 0) return sv_fail(err, s, "quality on held-out pixels: %s", sv_status_text(s));
  s = sv_preview_between_steps(&app->preview, &turn->away_s, err);
  if (s >= 0) s = sv_capture_side_turn(&app->capture, &is_train, err);
  turn->is_other_work = !is_train;
  turn->has_taken_time = app->capture.is_running;
  return s;
}

static bool is_due(double every_s, double last_s, double now_s) {
  return every_s > 0 && now_s - last_s >= every_s;
}

static sv_status after_step(void *self, double from_s, double *now_s, sv_err *err) {
  sv_app *app = self;
  const sv_app_cfg *c = &app->cfg;
  const sv_clock *m = &app->port.machine;
  sv_app_files *f = &app->files;
  const bool is_save =
                 is_due(c->save_every_s, f->checkpoint_s, *now_s) && (!f->n_failed || *now_s >= f->retry_s),
             is_picture = is_due(c->picture_every_s, f->picture_s, *now_s);
  sv_capture_side_trained(&app->capture, from_s, *now_s);
  if (!is_save && !is_picture) return SV_OK;
  sv_status s = is_save ? sv_app_save_running(app, *now_s, err) : SV_OK;
  if (s >= 0) s = sv_app_publish_preview(app);
  if (s < 0) return s;
  *now_s = sv_ns_to_s(m->now_ns(m->self));
  if (is_save && !f->n_failed) f->checkpoint_s = *now_s;
  f->picture_s = *now_s;
  return SV_OK;
}

// The quality of the newest exposures, each when it made room for the next, and the cameras that
// run while training goes on, as they were at the last such line.
static void add_live(void *self, sv_str *line) {
  sv_app *app = self;
  if (app->moving.n_scored) sv_str_add(line, "  newest %.1f dB", app->moving.psnr_late);
  sv_status s = app->capture.is_running ? sv_capture_queue_line(&app->queue, line) : SV_AGAIN;
  (void)s; // AGAIN: the line goes without
}

static sv_status measure(void *self, double *psnr) {
  return sv_app_held_out_psnr(self, MEASURED_VIEWS, psnr);
}

static sv_status train(sv_app *app, sv_err *err) {
  const sv_clock *m = &app->port.machine;
  const sv_driver_cfg cfg = {.n_steps = app->cfg.steps,
                             .limit_s = app->cfg.time_limit_s,
                             .steady_progress = sv_app_steady_progress(&app->cfg),
                             .clock = *m,
                             .scratch = &app->scratch,
                             .console = app->port.console,
                             .self = app,
                             .before_step = before_step,
                             .may_end = app->cfg.is_continuous ? may_end : NULL,
                             .after_step = after_step,
                             .least_db_per_s = app->cfg.least_db_per_s,
                             .measure = measure,
                             .add_progress = add_live};
  app->files.checkpoint_s = app->files.picture_s = sv_ns_to_s(m->now_ns(m->self));
  return sv_driver_run(&app->driver, &cfg, &app->trainer, err);
}

// A request to stop says what it stopped. is_trained: some steps were made.
static sv_status end_state(sv_app *app, sv_status s, bool is_trained, sv_err *err) {
  const bool is_saved = s == SV_E_INTERRUPTED && is_trained;
  if (is_saved) sv_fail(err, s, "stopped by request after %u steps; the model is saved", app->trainer.step);
  else if (s == SV_E_INTERRUPTED && app->state == SV_APP_CAPTURING)
    sv_fail(err, s, "stopped by request after %d of %d exposures, before training: nothing was saved",
            app->exposures.n, app->cfg.n_exposures);
  else if (s == SV_E_INTERRUPTED)
    sv_fail(err, s, "stopped by request before the first step: nothing was saved");
  app->state = s < 0 && !is_saved ? SV_APP_FAILED : SV_APP_DONE;
  return s;
}

static sv_status run_all(sv_app *app, sv_err *err) {
  sv_status s = capture(app, err), saved, ended;
  sv_err end_err;
  if (s >= 0)
    // From here on cameras are served whatever takes how long
    s = sv_capture_side_begin(&app->capture, err);
  if (s >= 0) s = sv_app_start_training(app, err);
  if (s >= 0) {
    app->state = SV_APP_TRAINING;
    sv_preview_show_model(&app->preview); // the first rough model, at once
    sv_preview_show(&app->preview, SV_FEED_STATUS_TRAINING, NULL);
    s = train(app, err);
  }
  ended = sv_capture_side_end(&app->capture, &end_err);
  if (ended < 0 && s >= 0) {
    s = ended;
    *err = end_err;
  }
  const bool is_trained =
      app->driver.step_time.n > 0; // else what an earlier run left in the folder is worth more
  if (s >= 0 || (s == SV_E_INTERRUPTED && is_trained && !app->preview.is_new_requested)) {
    sv_preview_show(&app->preview, SV_FEED_STATUS_SAVING, NULL);
    app->state = SV_APP_SAVING;
    saved = sv_app_save_final(app, err);
    if (saved < 0) s = saved;
  }
  return end_state(app, s, is_trained, err);
}

sv_status sv_app_run(sv_app *app, sv_err *err) {
  sv_preview_start(&app->preview);
  sv_status s = run_all(app, err);
  sv_preview_show_model(&app->preview);
  if (app->state == SV_APP_FAILED && !app->preview.is_new_requested)
    sv_preview_show(&app->preview, SV_FEED_STATUS_FAILED, err ? err->text : "");
  else sv_preview_show(&app->preview, SV_FEED_STATUS_DONE, NULL);
  return s;
}
