// SPDX-License-Identifier: Apache-2.0
// From cameras to the pool of exposures: first until it is full, and, in a live run, on while
// training goes on.
#include <string.h>

#include "src/run/app.h"

#define WAIT_NS (100 * SV_NS_PER_MS)
#define REST_NS (2 * SV_NS_PER_MS) // in a piece, between two looks at the cameras

// One camera failed; the others go on, and the timeout ends a capture that cannot complete.
static void note_errors(sv_app *app) {
  uint64_t n = atomic_load(&app->queue.n_device_errors);
  if (n && !app->capture.n_device_errors)
    sv_app_log(app, SV_LOG_WARN, "camera %d: %s", atomic_load(&app->queue.i_broken),
               sv_status_text(atomic_load(&app->queue.broken_status)));
  app->capture.n_device_errors = n;
}

// True when a camera has come back: it gets the time that all had at the start.
static bool log_events(sv_app *app) {
  char line[256];
  sv_camera_event e;
  bool is_back = false;
  while (sv_capture_queue_pop_event(&app->queue, &e) == SV_OK) {
    sv_str s = sv_str_make(line, sizeof line);
    sv_camera_event_line(&s, &e, app->cfg.caps, app->cfg.n_cameras);
    sv_app_log(app, SV_LOG_WARN, "%s", line);
    is_back |= e.kind == SV_CAMERA_RETURNED;
  }
  return is_back;
}

static void log_live(sv_app *app) {
  char line[640];
  sv_str s = sv_str_make(line, sizeof line);
  sv_str_add(&s, "capture  %d/%d exposures", app->exposures.n, app->cfg.n_exposures);
  if (sv_capture_queue_line(&app->queue, &s) == SV_OK && app->port.console.log)
    app->port.console.log(app->port.console.self, SV_LOG_LIVE, line);
}

// The next exposure into the pool. AGAIN: none is ready; DROPPED: there was one, but damaged.
static sv_status keep_exposure(sv_app *app, sv_err *err) {
  sv_exposure_slot *slot;
  sv_status s = sv_capture_queue_take(&app->queue, &slot);
  if (s != SV_OK) return s;
  s = sv_exposures_add(&app->exposures, &slot->exposure, slot->frames, app->k, &app->port.pool, err);
  sv_capture_queue_give_back(&app->queue, slot, true);
  if (s == SV_E_FORMAT || s == SV_E_CORRUPT) { // a damaged picture costs its exposure, not the run
    if (!app->capture.n_bad_exposures++) sv_app_log(app, SV_LOG_WARN, "%s", err->text);
    return SV_DROPPED;
  }
  if (s >= 0) sv_preview_exposure(app);
  return s;
}

static sv_status take_exposures(sv_app *app, sv_err *err) {
  sv_status s = SV_OK;
  while (app->exposures.n < app->cfg.n_exposures &&
         ((s = keep_exposure(app, err)) == SV_OK || s == SV_DROPPED)) {
  }
  return s < 0 ? s : SV_OK;
}

static sv_status capture_loop(sv_app *app, sv_err *err) {
  sv_clock *clk = &app->port.clock;
  sv_ns last_ns = clk->now_ns(clk->self);
  while (app->exposures.n < app->cfg.n_exposures) {
    sv_ns now = clk->now_ns(clk->self);
    sv_app_beat(app);
    if (sv_app_is_stop_requested(app) || sv_preview_tick(app) < 0) return SV_E_INTERRUPTED;
    if (now - last_ns > app->cfg.capture_timeout_ns)
      return sv_fail(err, SV_E_TIMEOUT,
                     "no synchronized exposure for %.0f s (%d of %d captured); check that every camera "
                     "delivers frames, or "
                     "raise --skew-limit (%g ms)",
                     sv_ns_to_s(now - last_ns), app->exposures.n, app->cfg.n_exposures,
                     sv_ns_to_ms(app->cfg.skew_limit_ns));
    sv_status s = sv_capture_queue_step(&app->queue, now + WAIT_NS);
    note_errors(app);
    if (log_events(app)) last_ns = now;
    if (s == SV_END) break;
    if (s != SV_OK && s != SV_E_DEVICE) continue;
    int before = app->exposures.n;
    if ((s = take_exposures(app, err)) < 0) return s;
    if (app->exposures.n > before) {
      last_ns = clk->now_ns(clk->self);
      log_live(app);
    }
  }
  return SV_OK;
}

static void log_ledger(sv_app *app) {
  char line[256];
  sv_ledger l = sv_sync_ledger_sum(&app->queue.sync);
  if (app->exposures.n)
    sv_app_log(app, SV_LOG_INFO,
               "captured %d exposures of %d sub-views; frames: %llu captured = %llu delivered + %llu dropped",
               app->exposures.n + (int)app->exposures.n_replaced, app->cfg.rig->n_sub_views,
               (unsigned long long)l.captured, (unsigned long long)l.delivered,
               (unsigned long long)sv_ledger_dropped(&l));
  for (int i = 0; app->exposures.n && i < app->cfg.n_cameras; i++) {
    sv_str s = sv_str_make(line, sizeof line);
    sv_camera_stats_line(&s, &app->queue.stats[i], sv_sync_ledger(&app->queue.sync, i),
                         app->cfg.caps[i].name);
    sv_app_log(app, SV_LOG_INFO, "  %s", line);
  }
}

static void log_deadlines(sv_app *app) {
  const sv_capture_queue *in = &app->queue;
  if (in->deadline_ns > 0)
    sv_app_log(app, in->n_missed ? SV_LOG_WARN : SV_LOG_INFO,
               "frames dequeued after their deadline of %.1f ms: %llu (median %.2f ms, maximum %.2f ms)",
               sv_ns_to_ms(in->deadline_ns), (unsigned long long)in->n_missed,
               sv_ns_to_ms(sv_skew_percentile_ns(&in->latency, 50)), sv_ns_to_ms(in->latency.max_ns));
}

static sv_status stop(sv_app *app, sv_err *err) {
  sv_status s = sv_capture_queue_stop(&app->queue);
  note_errors(app);
  return s < 0 ? sv_fail(err, s, "the cameras did not stop: %s", sv_status_text(s)) : SV_OK;
}

sv_status sv_app_capture(sv_app *app, sv_err *err) {
  app->state = SV_APP_CAPTURING;
  sv_status s = sv_preview_wait_start(app, err), t;
  if (s >= 0) s = sv_capture_queue_start(&app->queue, err);
  if (s < 0) return s;
  s = capture_loop(app, err);
  app->capture.is_running = app->cfg.is_continuous && s >= 0 && app->exposures.n == app->cfg.n_exposures;
  if (app->capture.is_running) return SV_OK;
  sv_err stop_err;
  // Whatever still waits is dropped as `stopped`, so that the ledger closes
  t = stop(app, &stop_err);
  if (s >= 0 && t < 0) {
    *err = stop_err;
    return t;
  }
  if (s >= 0 && app->exposures.n == 0)
    return sv_fail(err, SV_E_NOT_FOUND,
                   "the source ended without one synchronized exposure (skew limit %g ms)",
                   sv_ns_to_ms(app->cfg.skew_limit_ns));
  log_ledger(app);
  return s;
}

// --- live: capture while training ----------------------------------------------------------------

// The capture side as a thread: dequeues the moment frames come, however long a training step
// takes.
static void capture_thread(void *arg) {
  sv_app *app = arg;
  sv_clock *clk = &app->port.clock;
  sv_status s = SV_OK;
  while (!atomic_load(&app->capture.is_ending) && s != SV_END) {
    sv_beat(app->port.heartbeats, SV_BEAT_CAMERAS);
    s = sv_capture_queue_step(&app->queue, clk->now_ns(clk->self) + 20 * SV_NS_PER_MS);
  }
  sv_beat_rest(app->port.heartbeats, SV_BEAT_CAMERAS);
}

sv_status sv_app_continuous_begin(sv_app *app, sv_err *err) {
  const sv_clock *m = &app->port.machine;
  sv_governor_cfg gc = sv_governor_defaults((sv_ns)(app->cfg.preview_every_s * 1e9));
  app->capture.machine_ns = m->now_ns(m->self);
  sv_governor_init(&app->capture.governor, &gc, app->capture.machine_ns);
  atomic_store(&app->capture.is_ending, false);
  if (!app->capture.is_running || !app->port.worker.start) return SV_OK;
  sv_status s = app->port.worker.start(app->port.worker.self, capture_thread, app);
  app->capture.has_worker = s >= 0;
  return s < 0 ? sv_fail(err, s, "no thread for the cameras: %s", sv_status_text(s)) : SV_OK;
}

// Without a thread: the cameras' time, which is virtual, goes on by what the machine's did.
static void catch_up(sv_app *app) {
  const sv_clock *m = &app->port.machine;
  sv_clock *clk = &app->port.clock;
  if (app->capture.has_worker) return;
  sv_ns now_ns = m->now_ns(m->self), host_ns = clk->now_ns(clk->self);
  clk->sleep_until_ns(clk->self, host_ns + (now_ns - app->capture.machine_ns));
  app->capture.machine_ns = now_ns;
  sv_status s = sv_capture_queue_step(&app->queue, clk->now_ns(clk->self));
  (void)s; // AGAIN, END: nothing to do; errors are counted
}

// The newest exposure takes the place of the oldest, in the pool and in what is trained on.
static sv_status replace_oldest(sv_app *app, sv_err *err) {
  int slot = app->exposures.i_next, i_view = 0, n = sv_app_n_trained_sub_views(&app->cfg);
  sv_status s = sv_app_leave_exposure(app);
  if (s < 0) return s;
  s = keep_exposure(app, err);
  if (s != SV_OK || app->cfg.rig->forward == SV_FORWARD_MULTIPLEXED)
    return s; // lenses are in the pool itself
  for (int i = 0; i < app->cfg.rig->n_sub_views; i++) {
    sv_image_u8 image;
    sv_view view;
    if (!sv_app_is_trained_on(&app->cfg, i)) continue;
    sv_exposures_get(&app->exposures, slot, i, &image, &view);
    view.time = sv_app_time_of(app, app->exposures.exposure[slot].time_ns);
    sv_train_replace_view(&app->trainer, slot * n + i_view++, &view, &image);
  }
  return sv_app_enter_exposure(app, slot);
}

// Less training when the processor is hot, and a sentence when that begins and when it ends.
static void heed_heat(sv_app *app, sv_ns now_ns) {
  sv_governor *g = &app->capture.governor;
  if (!app->port.thermometer.read || now_ns - g->heat_ns < SV_NS_PER_S) return;
  const sv_heat heat = sv_app_heat(app);
  if (!sv_governor_heat(g, &heat, now_ns)) return;
  if (g->duty >= 1)
    sv_app_log(app, SV_LOG_INFO, "the processor has cooled down to %.0f C; training at full rate again",
               heat.temperature_c);
  else if (heat.is_throttled == 1)
    sv_app_log(
        app, SV_LOG_WARN,
        "the processor slows down for heat or power; training rests at times so that no frame is lost");
  else
    sv_app_log(
        app, SV_LOG_WARN,
        "the processor is at %.0f C; training rests at times so that it does not slow down and lose frames",
        heat.temperature_c);
}

static sv_status do_work(sv_app *app, sv_work work, sv_err *err) {
  const sv_clock *m = &app->port.machine;
  const sv_ns rest_ns = app->capture.governor.rest_ns;
  switch (work) {
  case SV_WORK_EXPOSURE: return replace_oldest(app, err);
  case SV_WORK_PREVIEW: return sv_app_publish_preview(app);
  default:
    m->sleep_until_ns(m->self, m->now_ns(m->self) + (rest_ns < REST_NS ? rest_ns : REST_NS));
    return SV_OK;
  }
}

sv_status sv_app_continuous_turn(sv_app *app, bool *is_train, sv_err *err) {
  const sv_clock *m = &app->port.machine;
  *is_train = true;
  if (!app->capture.is_running) return SV_OK;
  catch_up(app);
  note_errors(app);
  (void)log_events(app);
  sv_ns from_ns = m->now_ns(m->self);
  heed_heat(app, from_ns);
  bool is_ready = sv_capture_queue_n_ready(&app->queue) > 0 && sv_app_is_exposure_due(app);
  sv_work work = sv_governor_next(&app->capture.governor, from_ns, is_ready);
  *is_train = work == SV_WORK_TRAIN;
  if (*is_train) return SV_OK;
  sv_status s = do_work(app, work, err);
  sv_governor_done(&app->capture.governor, work, from_ns, m->now_ns(m->self));
  return s < 0 ? s : SV_OK;
}

void sv_app_continuous_trained(sv_app *app, double from_s, double now_s) {
  if (app->capture.is_running)
    sv_governor_done(&app->capture.governor, SV_WORK_TRAIN, (sv_ns)(from_s * 1e9), (sv_ns)(now_s * 1e9));
}

sv_status sv_app_continuous_end(sv_app *app, sv_err *err) {
  if (!app->capture.is_running) return SV_OK;
  atomic_store(&app->capture.is_ending, true);
  if (app->capture.has_worker) app->port.worker.join(app->port.worker.self);
  app->capture.has_worker = false;
  app->capture.is_running = false;
  sv_status s = stop(app, err);
  log_ledger(app);
  log_deadlines(app);
  return s;
}
