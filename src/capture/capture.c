// SPDX-License-Identifier: Apache-2.0
// From cameras to the pool of exposures: first until it is full, and, in a continuous run, on
// while training goes on.
#include "src/capture/capture.h"

#include <stdarg.h>
#include <string.h>

#include "src/base/str.h"
#include "src/capture/meter.h"
#include "src/port/heartbeat.h"

#define WAIT_NS    (100 * SV_NS_PER_MS)
#define MIN_POINTS 32                 // that say where the scene is
#define REST_NS    (2 * SV_NS_PER_MS) // in a piece, between two looks at the cameras

void sv_capture_side_init(sv_capture_side *c, const sv_capture_side_cfg *cfg) {
  memset(c, 0, sizeof *c);
  c->cfg = *cfg;
  sv_guidance_init(&c->guidance, &cfg->guidance);
  c->governor.duty = c->governor.least_duty = 1;
}

void sv_capture_side_log(sv_capture_side *c, sv_log_level level, const char *fmt, ...) {
  char line[256];
  va_list ap;
  va_start(ap, fmt);
  sv_vfmt(line, sizeof line, fmt, ap);
  va_end(ap);
  c->cfg.calls.log(c->cfg.calls.self, level, line);
}

// One camera failed; the others go on, and the timeout ends a capture that cannot complete.
static void note_errors(sv_capture_side *c) {
  uint64_t n = atomic_load(&c->cfg.queue->n_device_errors);
  if (n && !c->n_device_errors)
    sv_capture_side_log(c, SV_LOG_WARN, "camera %d: %s", atomic_load(&c->cfg.queue->i_broken),
                        sv_status_text(atomic_load(&c->cfg.queue->broken_status)));
  c->n_device_errors = n;
}

// True when a camera has come back: it gets the time that all had at the start.
static bool log_events(sv_capture_side *c) {
  char line[256];
  sv_camera_event e;
  bool is_back = false;
  while (sv_capture_queue_pop_event(c->cfg.queue, &e) == SV_OK) {
    sv_str s = sv_str_make(line, sizeof line);
    sv_camera_event_line(&s, &e, c->cfg.caps, c->cfg.n_cameras);
    sv_capture_side_log(c, SV_LOG_WARN, "%s", line);
    is_back |= e.kind == SV_CAMERA_RETURNED;
  }
  return is_back;
}

static void log_live(sv_capture_side *c) {
  char line[640];
  sv_str s = sv_str_make(line, sizeof line);
  sv_str_add(&s, "capture  %d/%d exposures  ", c->cfg.exposures->n, c->cfg.n_exposures);
  sv_guidance_line(&c->guidance, &s);
  if (sv_capture_queue_line(c->cfg.queue, &s) == SV_OK && c->cfg.port->console.log)
    c->cfg.port->console.log(c->cfg.port->console.self, SV_LOG_LIVE, line);
}

// --- guidance ------------------------------------------------------------------------------------

static sv_guidance_shot metered(sv_capture_side *c, int i, const sv_pose *rig_from_world) {
  sv_meter_sum all = {{0}, 0};
  for (int k = 0; c->cfg.exposures->sub && k < c->cfg.rig->n_sub_views; k++) {
    sv_image_u8 image;
    sv_view view;
    sv_meter m;
    sv_exposures_get(c->cfg.exposures, i, k, &image, &view);
    if (sv_meter_image(&image, &m)) sv_meter_sum_add(&all, &m);
  }
  return sv_meter_shot(&all, &c->recent, rig_from_world);
}

// Exposure i of the pool, just kept. Where the source tells no pose, odometry finds it now.
static sv_status guide(sv_capture_side *c, int i, sv_err *err) {
  const sv_exposure *e = &c->cfg.exposures->exposure[i];
  sv_odometry *o = c->cfg.odometry;
  const sv_pose *pose = e->has_pose ? &e->rig_from_world : NULL;
  if (!pose && o && o->is_on && o->tracker.n_exposures == i) {
    const sv_status s = sv_odometry_add(o, c->cfg.exposures, i);
    if (s < 0) return sv_fail(err, s, "odometry, exposure %d: %s", i, sv_status_text(s));
    if (o->tracker.is_placed[i]) pose = &o->tracker.pose[i];
    const int n = sv_odometry_cloud(o, c->cloud, SV_CAPTURE_CAP_CLOUD);
    const sv_bounds ball = sv_odometry_bounds(o);
    if (n >= MIN_POINTS) sv_guidance_set_scene(&c->guidance, &ball, c->cloud, n);
  }
  const sv_guidance_shot shot = metered(c, i, pose);
  sv_guidance_keep(&c->guidance, &shot);
  sv_guidance_look(&c->guidance, &shot);
  return SV_OK;
}

sv_status sv_capture_side_keep(sv_capture_side *c, sv_err *err) {
  sv_exposure_slot *slot;
  sv_status s = sv_capture_queue_take(c->cfg.queue, &slot);
  if (s != SV_OK) return s;
  const int i = c->cfg.exposures->i_next;
  s = sv_exposures_add(c->cfg.exposures, &slot->exposure, slot->frames, c->cfg.k, &c->cfg.port->pool, err);
  if (s == SV_DROPPED) {
    const sv_drop_reason reason = c->cfg.exposures->reason;
    sv_capture_queue_refuse(c->cfg.queue, slot, reason);
    if (reason == SV_DROP_BLURRED) {
      c->n_blurred++;
      c->guidance.hint = SV_HINT_STILL;
    } else {
      c->n_not_due++;
    }
    return s;
  }
  sv_capture_queue_give_back(c->cfg.queue, slot, true);
  if (s == SV_E_FORMAT || s == SV_E_CORRUPT) { // a damaged picture costs its exposure, not the run
    if (!c->n_bad_exposures++) sv_capture_side_log(c, SV_LOG_WARN, "%s", err->text);
    return SV_DROPPED;
  }
  if (s >= 0) s = guide(c, i, err);
  if (s >= 0) c->cfg.calls.kept(c->cfg.calls.self);
  return s;
}

static sv_status take_exposures(sv_capture_side *c, sv_err *err) {
  sv_status s = SV_OK;
  while (c->cfg.exposures->n < c->cfg.n_exposures &&
         ((s = sv_capture_side_keep(c, err)) == SV_OK || s == SV_DROPPED)) {
  }
  return s < 0 ? s : SV_OK;
}

// Exposures that came whole, kept or not.
static uint64_t n_complete(const sv_capture_side *c) {
  return (uint64_t)c->cfg.exposures->n + c->n_blurred + c->n_not_due;
}

static sv_status capture_loop(sv_capture_side *c, sv_err *err) {
  const sv_capture_calls *calls = &c->cfg.calls;
  const sv_clock *clk = &c->cfg.port->clock;
  sv_ns last_ns = clk->now_ns(clk->self);
  while (c->cfg.exposures->n < c->cfg.n_exposures) {
    sv_ns now = clk->now_ns(clk->self);
    if (calls->poll(calls->self) < 0 || calls->serve(calls->self) < 0) return SV_E_INTERRUPTED;
    if (now - last_ns > c->cfg.timeout_ns)
      return sv_fail(err, SV_E_TIMEOUT,
                     "no synchronized exposure for %.0f s (%d of %d captured); check that every camera "
                     "delivers frames, or "
                     "raise --skew-limit (%g ms)",
                     sv_ns_to_s(now - last_ns), c->cfg.exposures->n, c->cfg.n_exposures,
                     sv_ns_to_ms(c->cfg.skew_limit_ns));
    sv_status s = sv_capture_queue_step(c->cfg.queue, now + WAIT_NS);
    note_errors(c);
    if (log_events(c)) last_ns = now;
    if (s == SV_END) break;
    if (s != SV_OK && s != SV_E_DEVICE) continue;
    const uint64_t before = n_complete(c);
    if ((s = take_exposures(c, err)) < 0) return s;
    if (n_complete(c) > before) {
      last_ns = clk->now_ns(clk->self);
      log_live(c);
    }
  }
  return SV_OK;
}

static void log_ledger(sv_capture_side *c) {
  char line[256];
  sv_ledger l = sv_sync_ledger_sum(&c->cfg.queue->sync);
  if (c->cfg.exposures->n)
    sv_capture_side_log(
        c, SV_LOG_INFO,
        "captured %d exposures of %d sub-views; frames: %llu captured = %llu delivered + %llu dropped",
        c->cfg.exposures->n + (int)c->cfg.exposures->n_replaced, c->cfg.rig->n_sub_views,
        (unsigned long long)l.captured, (unsigned long long)l.delivered,
        (unsigned long long)sv_ledger_dropped(&l));
  for (int i = 0; c->cfg.exposures->n && i < c->cfg.n_cameras; i++) {
    sv_str s = sv_str_make(line, sizeof line);
    sv_camera_stats_line(&s, &c->cfg.queue->stats[i], sv_sync_ledger(&c->cfg.queue->sync, i),
                         c->cfg.caps[i].name);
    sv_capture_side_log(c, SV_LOG_INFO, "  %s", line);
  }
}

static void log_deadlines(sv_capture_side *c) {
  const sv_capture_queue *in = c->cfg.queue;
  if (in->deadline_ns > 0)
    sv_capture_side_log(
        c, in->n_missed ? SV_LOG_WARN : SV_LOG_INFO,
        "frames dequeued after their deadline of %.1f ms: %llu (median %.2f ms, maximum %.2f ms)",
        sv_ns_to_ms(in->deadline_ns), (unsigned long long)in->n_missed,
        sv_ns_to_ms(sv_skew_percentile_ns(&in->latency, 50)), sv_ns_to_ms(in->latency.max_ns));
}

static sv_status stop(sv_capture_side *c, sv_err *err) {
  sv_status s = sv_capture_queue_stop(c->cfg.queue);
  note_errors(c);
  return s < 0 ? sv_fail(err, s, "the cameras did not stop: %s", sv_status_text(s)) : SV_OK;
}

static void log_guidance(sv_capture_side *c) {
  const double coverage = sv_guidance_coverage(&c->guidance);
  if (coverage >= 0)
    sv_capture_side_log(
        c, SV_LOG_INFO,
        "%d of %d exposures are good; they cover %.0f %% of the directions around the scene%s",
        c->guidance.n_good, c->guidance.n_kept, 100 * coverage,
        coverage < SV_GUIDANCE_ENOUGH ? "" : ", which is enough");
}

sv_status sv_capture_side_run(sv_capture_side *c, sv_err *err) {
  sv_status s = sv_capture_queue_start(c->cfg.queue, err), t;
  if (s < 0) return s;
  s = capture_loop(c, err);
  c->is_running = c->cfg.is_continuous && s >= 0 && c->cfg.exposures->n == c->cfg.n_exposures;
  if (c->is_running) return SV_OK;
  sv_err stop_err;
  // Whatever still waits is dropped as `stopped`, so that the ledger closes
  t = stop(c, &stop_err);
  if (s >= 0 && t < 0) {
    *err = stop_err;
    return t;
  }
  if (s >= 0 && c->cfg.exposures->n == 0)
    return sv_fail(err, SV_E_NOT_FOUND,
                   "the source ended without one synchronized exposure (skew limit %g ms)",
                   sv_ns_to_ms(c->cfg.skew_limit_ns));
  log_ledger(c);
  if (c->n_blurred)
    sv_capture_side_log(
        c, SV_LOG_INFO,
        "left out %llu exposures that are clearly less sharp than those before them; move more "
        "slowly, or shorten the shutter",
        (unsigned long long)c->n_blurred);
  log_guidance(c);
  return s;
}

// --- continuous: capture while training ----------------------------------------------------------

// The capture side as a thread: dequeues the moment frames come, however long a training step
// takes.
static void capture_thread(void *arg) {
  sv_capture_side *c = arg;
  const sv_clock *clk = &c->cfg.port->clock;
  sv_status s = SV_OK;
  while (!atomic_load(&c->is_ending) && s != SV_END) {
    sv_beat(c->cfg.port->heartbeats, SV_BEAT_CAMERAS);
    s = sv_capture_queue_step(c->cfg.queue, clk->now_ns(clk->self) + 20 * SV_NS_PER_MS);
  }
  sv_beat_rest(c->cfg.port->heartbeats, SV_BEAT_CAMERAS);
}

sv_status sv_capture_side_begin(sv_capture_side *c, sv_err *err) {
  const sv_clock *m = &c->cfg.port->machine;
  sv_governor_cfg gc = sv_governor_defaults((sv_ns)(c->cfg.preview_every_s * 1e9));
  c->machine_ns = m->now_ns(m->self);
  sv_governor_init(&c->governor, &gc, c->machine_ns);
  atomic_store(&c->is_ending, false);
  if (!c->is_running || !c->cfg.port->worker.start) return SV_OK;
  sv_status s = c->cfg.port->worker.start(c->cfg.port->worker.self, capture_thread, c);
  c->has_worker = s >= 0;
  return s < 0 ? sv_fail(err, s, "no thread for the cameras: %s", sv_status_text(s)) : SV_OK;
}

// Without a thread: the cameras' time, which is virtual, goes on by what the machine's did.
static void catch_up(sv_capture_side *c) {
  const sv_clock *m = &c->cfg.port->machine;
  const sv_clock *clk = &c->cfg.port->clock;
  if (c->has_worker) return;
  sv_ns now_ns = m->now_ns(m->self), host_ns = clk->now_ns(clk->self);
  clk->sleep_until_ns(clk->self, host_ns + (now_ns - c->machine_ns));
  c->machine_ns = now_ns;
  sv_status s = sv_capture_queue_step(c->cfg.queue, clk->now_ns(clk->self));
  (void)s; // AGAIN, END: nothing to do; errors are counted
}

// Less training when the processor is hot, and a sentence when that begins and when it ends.
static void heed_heat(sv_capture_side *c, sv_ns now_ns) {
  sv_governor *g = &c->governor;
  if (!c->cfg.port->thermometer.read || now_ns - g->heat_ns < SV_NS_PER_S) return;
  const sv_heat heat = c->cfg.calls.heat(c->cfg.calls.self);
  if (!sv_governor_heat(g, &heat, now_ns)) return;
  if (g->duty >= 1)
    sv_capture_side_log(c, SV_LOG_INFO,
                        "the processor has cooled down to %.0f C; training at full rate again",
                        heat.temperature_c);
  else if (heat.is_throttled == 1)
    sv_capture_side_log(
        c, SV_LOG_WARN,
        "the processor slows down for heat or power; training rests at times so that no frame is lost");
  else
    sv_capture_side_log(
        c, SV_LOG_WARN,
        "the processor is at %.0f C; training rests at times so that it does not slow down and lose frames",
        heat.temperature_c);
}

static sv_status do_work(sv_capture_side *c, sv_work work, sv_err *err) {
  const sv_clock *m = &c->cfg.port->machine;
  const sv_ns rest_ns = c->governor.rest_ns;
  switch (work) {
  case SV_WORK_EXPOSURE: return c->cfg.calls.replace(c->cfg.calls.self, err);
  case SV_WORK_PREVIEW: return c->cfg.calls.publish(c->cfg.calls.self);
  default:
    m->sleep_until_ns(m->self, m->now_ns(m->self) + (rest_ns < REST_NS ? rest_ns : REST_NS));
    return SV_OK;
  }
}

sv_status sv_capture_side_turn(sv_capture_side *c, bool *is_train, sv_err *err) {
  const sv_clock *m = &c->cfg.port->machine;
  *is_train = true;
  if (!c->is_running) return SV_OK;
  catch_up(c);
  note_errors(c);
  (void)log_events(c);
  sv_ns from_ns = m->now_ns(m->self);
  heed_heat(c, from_ns);
  bool is_ready =
      sv_capture_queue_n_ready(c->cfg.queue) > 0 && c->cfg.calls.is_exposure_due(c->cfg.calls.self);
  sv_work work = sv_governor_next(&c->governor, from_ns, is_ready);
  *is_train = work == SV_WORK_TRAIN;
  if (*is_train) return SV_OK;
  sv_status s = do_work(c, work, err);
  sv_governor_done(&c->governor, work, from_ns, m->now_ns(m->self));
  return s < 0 ? s : SV_OK;
}

void sv_capture_side_trained(sv_capture_side *c, double from_s, double now_s) {
  if (c->is_running)
    sv_governor_done(&c->governor, SV_WORK_TRAIN, (sv_ns)(from_s * 1e9), (sv_ns)(now_s * 1e9));
}

sv_status sv_capture_side_end(sv_capture_side *c, sv_err *err) {
  if (!c->is_running) return SV_OK;
  atomic_store(&c->is_ending, true);
  if (c->has_worker) c->cfg.port->worker.join(c->cfg.port->worker.self);
  c->has_worker = false;
  c->is_running = false;
  sv_status s = stop(c, err);
  log_ledger(c);
  log_deadlines(c);
  return s;
}
