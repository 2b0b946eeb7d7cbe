// SPDX-License-Identifier: Apache-2.0
#include "src/sync/capture_queue.h"

#include <math.h>
#include <string.h>

#define CAP_EVENTS 32
#define MAX_FRAMES 64 // of one step, so that a flood of frames does not hold up the caller

static sv_sync_cfg sync_cfg(const sv_capture_queue_cfg *c, const sv_sync_camera *cameras) {
  return (sv_sync_cfg){.n_cameras = c->n_cameras,
                       .cameras = cameras,
                       .skew_limit_ns = c->skew_limit_ns,
                       .queue_len = c->queue_len};
}

static sv_ns period_ns(const sv_capture_queue_cfg *c) {
  double fps = c->caps[0].fps;
  return fps > 0 ? (sv_ns)floor(1e9 / fps + 0.5) : 0;
}

static sv_ns deadline_ns(const sv_capture_queue_cfg *c) {
  double fps = 0;
  for (int i = 0; i < c->n_cameras; i++)
    if (c->caps[i].fps > fps) fps = c->caps[i].fps;
  return fps > 0 ? (sv_ns)floor(1e9 / fps + 0.5) : 0;
}

// What the arena holds; sv_capture_queue itself is too large for a stack frame.
typedef struct {
  sv_frame_length frame_length;
  sv_camera_stat *stats;
  sv_camera_caps *caps;
  char *line;
  sv_exposure_slot *slots;
  sv_frame *frames; // [n_slots][n_cameras]
  int *free;
  int n_slots;
} parts_t;

// sync: NULL on a dry arena.
static sv_status carve(parts_t *p, sv_sync *sync, const sv_capture_queue_cfg *c, sv_arena *a) {
  size_t n = (size_t)c->n_cameras;
  sv_arena_part_begin(a, "sync");
  sv_sync_camera *cameras = SV_TAKE(a, sv_sync_camera, n), dry = {0};
  for (int i = 0; cameras && i < c->n_cameras; i++) cameras[i] = sv_sync_camera_of(&c->caps[i]);
  if (a->status < 0) return a->status;
  sv_sync_cfg sc = sync_cfg(c, cameras ? cameras : &dry);
  sv_status s = SV_OK;
  if (sync) s = sv_sync_init(sync, &sc, a);
  else (void)SV_TAKE(a, uint8_t, sv_sync_bytes(&sc));
  if (s < 0) return s;
  if (c->method == SV_SYNC_METHOD_FRAME_LENGTH && period_ns(c) > 0) {
    sv_frame_length_cfg fc = {.n_cameras = c->n_cameras, .period_ns = period_ns(c)};
    s = sv_frame_length_init(&p->frame_length, &fc, a);
    if (s < 0) return s;
  }
  p->n_slots = c->cap_ready + 1; // the capture side always has one to put the next exposure in
  p->stats = SV_TAKE(a, sv_camera_stat, n);
  p->caps = SV_TAKE(a, sv_camera_caps, n);
  p->line = SV_TAKE(a, char, SV_CAPTURE_QUEUE_LINE_BYTES);
  p->slots = SV_TAKE(a, sv_exposure_slot, p->n_slots);
  p->frames = SV_TAKE(a, sv_frame, (size_t)p->n_slots * n);
  p->free = SV_TAKE(a, int, p->n_slots);
  return a->status;
}

static sv_status carve_rings(sv_ring *events, sv_ring *ready, sv_ring *done, const sv_capture_queue_cfg *c,
                             sv_arena *a) {
  sv_status s = sv_ring_init(events, CAP_EVENTS, sizeof(sv_camera_event), a);
  if (s >= 0) s = sv_ring_init(ready, (uint32_t)c->cap_ready, sizeof(int), a);
  // One more than can be under way: giving back never finds it full.
  if (s >= 0) s = sv_ring_init(done, (uint32_t)c->cap_ready + 1, sizeof(int), a);
  return s < 0 ? s : a->status;
}

size_t sv_capture_queue_bytes(const sv_capture_queue_cfg *cfg) {
  sv_arena dry = sv_arena_dry();
  parts_t p = {0};
  sv_ring events, ready, done;
  sv_status s = carve(&p, NULL, cfg, &dry);
  if (s >= 0) s = carve_rings(&events, &ready, &done, cfg, &dry);
  return s < 0 ? 0 : dry.used_bytes;
}

sv_status sv_capture_queue_init(sv_capture_queue *in, const sv_capture_queue_cfg *cfg,
                                const sv_source *source, const sv_clock *clock, sv_arena *arena) {
  memset(in, 0, sizeof *in);
  if (cfg->n_cameras < 1 || cfg->cap_ready < 1 || cfg->cap_ready > 64 || !cfg->caps) return SV_E_ARG;
  in->cfg = *cfg;
  in->source = *source;
  in->clock = *clock;
  parts_t p = {0};
  sv_status s = carve(&p, &in->sync, cfg, arena);
  if (s >= 0) s = carve_rings(&in->events, &in->ready, &in->done, cfg, arena);
  in->frame_length = p.frame_length;
  in->stats = p.stats;
  if (in->stats) memset(in->stats, 0, sizeof *in->stats * (size_t)cfg->n_cameras);
  in->caps = p.caps;
  if (in->caps) memcpy(in->caps, cfg->caps, sizeof *in->caps * (size_t)cfg->n_cameras);
  in->line = p.line;
  in->slots = p.slots;
  in->free = p.free;
  in->n_slots = p.n_slots;
  for (int i = 0; s >= 0 && i < in->n_slots; i++) {
    in->slots[i] = (sv_exposure_slot){.frames = p.frames + (size_t)i * (size_t)cfg->n_cameras};
    in->free[in->n_free++] = i;
  }
  in->deadline_ns = deadline_ns(cfg);
  in->cfg.caps = NULL;
  return s;
}

static void count_error(sv_capture_queue *in, int i_camera, sv_status s) {
  atomic_store(&in->i_broken, i_camera);
  atomic_store(&in->broken_status, s);
  atomic_fetch_add(&in->n_device_errors, 1);
}

static void requeue(sv_capture_queue *in, const sv_frame *f) {
  sv_status s = in->source.requeue(in->source.self, f);
  if (s < 0) count_error(in, f->i_camera, s);
}

static void requeue_all(sv_capture_queue *in, const sv_frame *frames) {
  for (int i = 0; i < in->cfg.n_cameras; i++)
    if (frames[i].i_camera >= 0) requeue(in, &frames[i]);
}

static void give_returns_back(sv_capture_queue *in) {
  sv_frame f;
  while (sv_sync_pop_return(&in->sync, &f) == SV_OK) requeue(in, &f);
}

// The frames of a slot go back to their cameras, and the slot is free.
static void free_slot(sv_capture_queue *in, int i) {
  requeue_all(in, in->slots[i].frames);
  in->free[in->n_free++] = i;
}

static void collect_done(sv_capture_queue *in) {
  int i;
  while (sv_ring_pop(&in->done, &i) == SV_OK) {
    if (!in->slots[i].is_used) sv_sync_refuse(&in->sync, &in->slots[i].exposure, in->slots[i].reason);
    free_slot(in, i);
  }
}

#define MOTION_NS (5 * SV_NS_PER_MS) // from poses so long before and after an exposure

// Of a source that tells poses at any time.
static bool tell_motion(const sv_source *source, sv_exposure *e) {
  const double s = sv_ns_to_s(MOTION_NS);
  sv_pose before, after;
  double slope[2];
  if (source->rig_pose(source->self, e->time_ns - MOTION_NS, &before) < 0 ||
      source->rig_pose(source->self, e->time_ns + MOTION_NS, &after) < 0)
    return false;
  sv_motion_slopes(slope, -s, s);
  sv_motion_from(e->motion, slope, &e->rig_from_world, &before, &after);
  return true;
}

// Exposures that are complete go to the user, or, when it has enough to do, nowhere.
static void hand_out(sv_capture_queue *in) {
  for (;;) {
    const int i = in->free[in->n_free - 1];
    sv_exposure_slot *slot = &in->slots[i];
    sv_exposure *e = &slot->exposure;
    if (sv_sync_pop_exposure(&in->sync, e, slot->frames) != SV_OK) return;
    sv_camera_stats_exposure(in->stats, &in->sync, e, slot->frames);
    if (in->n_free == 1) { // all others are with the user
      sv_sync_refuse(&in->sync, e, SV_DROP_OVERLOAD);
      requeue_all(in, slot->frames);
      continue;
    }
    e->has_pose =
        in->source.rig_pose && in->source.rig_pose(in->source.self, e->time_ns, &e->rig_from_world) >= 0;
    if (!e->has_pose) e->rig_from_world = sv_pose_identity();
    e->has_motion = e->has_pose && tell_motion(&in->source, e);
    slot->is_used = false;
    if (sv_ring_push(&in->ready, &i) == SV_OK) in->n_free--; // as large as cap_ready, so never full
  }
}

static void align(sv_capture_queue *in, int c) {
  sv_frame_length *fl = &in->frame_length;
  int64_t set_ns = 0;
  sv_ns wanted_ns, was_ns;
  if (!in->source.set_control || !fl->cameras || !in->sync.streams[c].has_host) return;
  if (!sv_frame_length_frame(fl, c, in->sync.streams[c].last_mid_host_ns, &wanted_ns)) return;
  was_ns = fl->cameras[c].set_ns;
  sv_status s = in->source.set_control(in->source.self, c, SV_CONTROL_FRAME_DURATION_NS, wanted_ns, &set_ns);
  if (s < 0) { // once: it is left alone from now on
    sv_camera_event e = {SV_CAMERA_FREE, c, in->clock.now_ns(in->clock.self), s, NULL};
    set_ns = 0;
    s = sv_ring_push(&in->events, &e);
    (void)s; // full: nobody asks
  }
  sv_frame_length_set(fl, c, set_ns);
  if (set_ns > 0) sv_sync_lengthened(&in->sync, c, set_ns - was_ns);
}

static void take_frame(sv_capture_queue *in, const sv_frame *f) {
  int c = f->i_camera;
  uint64_t n_steps =
      c >= 0 && c < in->cfg.n_cameras ? in->sync.streams[c].events[SV_SYNC_EVENT_CLOCK_STEP] : 0;
  sv_ns late_ns = in->clock.now_ns(in->clock.self) - f->arrival_ns;
  sv_status s = sv_sync_push(&in->sync, f);
  sv_skew_add(&in->latency, late_ns > 0 ? late_ns : 0);
  in->n_missed += in->deadline_ns > 0 && late_ns > in->deadline_ns;
  // A frame of no camera of ours, or with a full return queue, which is drained after each frame
  if (s < 0) {
    count_error(in, c, s);
    requeue(in, f);
    return;
  }
  sv_camera_stat_frame(&in->stats[c], f);
  if (in->frame_length.cameras) {
    if (in->sync.streams[c].events[SV_SYNC_EVENT_CLOCK_STEP] != n_steps)
      sv_frame_length_forget(&in->frame_length, c);
    else if (s == SV_OK) align(in, c);
  }
  hand_out(in);
  give_returns_back(in);
}

static void collect_events(sv_capture_queue *in) {
  sv_camera_event e;
  while (in->source.event && in->source.event(in->source.self, &e) == SV_OK) {
    sv_status s = sv_ring_push(&in->events, &e);
    (void)s; // full: nobody asks
  }
}

enum { LINE_NONE, LINE_WANTED, LINE_READY };

static void make_line(sv_capture_queue *in) {
  if (atomic_load(&in->line_state) != LINE_WANTED) return;
  sv_str s = sv_str_make(in->line, SV_CAPTURE_QUEUE_LINE_BYTES);
  sv_camera_stats_live(&s, in->stats, &in->sync, in->caps);
  atomic_store(&in->line_state, LINE_READY);
}

sv_status sv_capture_queue_step(sv_capture_queue *in, sv_ns until_ns) {
  sv_status result = SV_AGAIN;
  collect_done(in);
  make_line(in);
  for (int n = 0; n < MAX_FRAMES; n++) {
    sv_frame f = {.i_camera = -1};
    sv_status s = in->source.dequeue(in->source.self, &f, n ? in->clock.now_ns(in->clock.self) : until_ns);
    collect_events(in);
    if (s == SV_AGAIN || s == SV_END) return n ? result : s;
    if (s < 0) {
      count_error(in, f.i_camera, s);
      in->clock.sleep_until_ns(in->clock.self, in->clock.now_ns(in->clock.self) + SV_NS_PER_MS);
      return s;
    }
    result = SV_OK;
    if (in->cfg.on_frame) in->cfg.on_frame(in->cfg.on_frame_self, &f);
    take_frame(in, &f);
    collect_done(in);
  }
  return result;
}

sv_status sv_capture_queue_check(const sv_capture_queue *in, sv_err *err) {
  const sv_source *src = &in->source;
  if (in->cfg.method == SV_SYNC_METHOD_TRIGGER && !src->trigger)
    return sv_fail(err, SV_E_UNSUPPORTED,
                   "the cameras of this source have no trigger line; expected --sync free or frame-length");
  if (in->cfg.method == SV_SYNC_METHOD_FRAME_LENGTH && !(src->set_control && in->frame_length.cameras))
    return sv_fail(err, SV_E_UNSUPPORTED, "the cameras of this source %s; expected --sync free",
                   src->set_control ? "report no frame rate (set fps=)" : "cannot change their frame length");
  return SV_OK;
}

// The source's first event names the camera and what is wrong with it.
static sv_status not_started(sv_capture_queue *in, sv_status s, const char *what, sv_err *err) {
  char text[256];
  sv_str why = sv_str_make(text, sizeof text);
  sv_camera_event e;
  if (in->source.event && in->source.event(in->source.self, &e) == SV_OK)
    sv_camera_event_line(&why, &e, in->caps, in->cfg.n_cameras);
  else sv_str_add(&why, "%s", sv_status_text(s));
  return sv_fail(err, s, "the cameras %s: %s", what, text);
}

sv_status sv_capture_queue_start(sv_capture_queue *in, sv_err *err) {
  sv_source *src = &in->source;
  sv_status s = sv_capture_queue_check(in, err);
  if (s < 0) return s;
  if (src->trigger) s = src->trigger(src->self, in->cfg.method == SV_SYNC_METHOD_TRIGGER);
  if (s < 0) return not_started(in, s, "cannot be switched to their trigger line", err);
  s = src->start(src->self);
  if (s < 0) return not_started(in, s, "did not start", err);
  in->is_running = true;
  return SV_OK;
}

sv_status sv_capture_queue_stop(sv_capture_queue *in) {
  int i;
  if (!in->is_running) return SV_OK;
  collect_done(in);
  while (sv_ring_pop(&in->ready, &i) == SV_OK) {
    sv_sync_refuse(&in->sync, &in->slots[i].exposure, SV_DROP_STOPPED);
    free_slot(in, i);
  }
  while (sv_sync_flush(&in->sync) == SV_E_FULL) give_returns_back(in);
  give_returns_back(in);
  in->is_running = false;
  return in->source.stop(in->source.self);
}

// --- the user's side -----------------------------------------------------------------------------

sv_status sv_capture_queue_take(sv_capture_queue *in, sv_exposure_slot **slot) {
  int i;
  sv_status s = sv_ring_pop(&in->ready, &i);
  if (s == SV_OK) *slot = &in->slots[i];
  return s;
}

static void give_slot_back(sv_capture_queue *in, const sv_exposure_slot *slot) {
  const int i = (int)(slot - in->slots);
  // The ring holds more than can be under way, so it takes this one.
  if (sv_ring_push(&in->done, &i) != SV_OK) count_error(in, -1, SV_E_FULL);
}

void sv_capture_queue_give_back(sv_capture_queue *in, sv_exposure_slot *slot, bool is_used) {
  slot->is_used = is_used;
  slot->reason = SV_DROP_OVERLOAD;
  give_slot_back(in, slot);
}

void sv_capture_queue_refuse(sv_capture_queue *in, sv_exposure_slot *slot, sv_drop_reason reason) {
  slot->is_used = false;
  slot->reason = reason;
  give_slot_back(in, slot);
}

sv_status sv_capture_queue_line(sv_capture_queue *in, sv_str *out) {
  int state = atomic_load(&in->line_state);
  if (state == LINE_READY) sv_str_add(out, "%s", in->line);
  // The next one is made meanwhile
  if (state != LINE_WANTED) atomic_store(&in->line_state, LINE_WANTED);
  return state == LINE_READY ? SV_OK : SV_AGAIN;
}

int sv_capture_queue_n_ready(sv_capture_queue *in) { return (int)sv_ring_count(&in->ready); }
sv_status sv_capture_queue_pop_event(sv_capture_queue *in, sv_camera_event *event) {
  return sv_ring_pop(&in->events, event);
}
