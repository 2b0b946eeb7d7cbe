// SPDX-License-Identifier: Apache-2.0
#include "src/sync/sync.h"

#include <math.h>
#include <string.h>

#define MAX_GAP_FRAMES  10000 // a larger leap of the sequence number is a restart, not a loss
#define MAX_LATE        128   // after so many in a row the path is another one
#define MAX_LATE_FIRST  16    // the same when none has come in time yet
#define MAX_ODD         3     // spacings in a row after which the frame rate is another one
#define SEEN_FRAMES     64
#define CAP_QUEUE       64
#define MAX_STAMP_NS    (INT64_MAX / 4) // sums and differences of two stamps stay in range
#define MAX_EXPOSURE_NS (10 * SV_NS_PER_S)

static bool cfg_is_good(const sv_sync_cfg *c) {
  return c->n_cameras >= 1 && c->n_cameras <= SV_CAP_SUB_VIEWS && c->cameras && c->queue_len >= 2 &&
         c->queue_len <= CAP_QUEUE && c->skew_limit_ns >= 0 && c->skew_limit_ns < MAX_STAMP_NS &&
         c->min_cameras >= 0 && c->min_cameras <= c->n_cameras && c->max_wait_ns >= 0 &&
         c->step_limit_ns >= 0 && c->max_drift >= 0 && c->max_drift < 0.1;
}

// What the arena holds; sv_sync itself is too large for a stack frame.
typedef struct {
  sv_sync_stream *streams;
  sv_frame *returns;
  int cap_returns;
} parts_t;

static parts_t carve(const sv_sync_cfg *cfg, sv_arena *a) {
  parts_t p;
  sv_arena_part_begin(a, "sync");
  p.streams = SV_TAKE(a, sv_sync_stream, cfg->n_cameras);
  // One push returns at most its own queue or one frame a camera, and itself; a flush returns all.
  p.cap_returns = cfg->n_cameras * (cfg->queue_len + 2) + cfg->queue_len + 2;
  p.returns = SV_TAKE(a, sv_frame, p.cap_returns);
  for (int c = 0; c < cfg->n_cameras; c++) {
    sv_sync_entry *queue = SV_TAKE(a, sv_sync_entry, cfg->queue_len);
    if (!a->base || a->status < 0) continue;
    memset(&p.streams[c], 0, sizeof p.streams[c]);
    p.streams[c].queue = queue;
  }
  return p;
}

size_t sv_sync_bytes(const sv_sync_cfg *cfg) {
  if (!cfg_is_good(cfg)) return 0;
  sv_arena dry = sv_arena_dry();
  carve(cfg, &dry);
  return dry.used_bytes;
}

sv_status sv_sync_init(sv_sync *s, const sv_sync_cfg *cfg, sv_arena *arena) {
  memset(s, 0, sizeof *s);
  if (!cfg_is_good(cfg)) return SV_E_ARG;
  parts_t p = carve(cfg, arena);
  if (arena->status < 0) return arena->status;
  s->streams = p.streams;
  s->returns = p.returns;
  s->cap_returns = p.cap_returns;
  s->cfg = *cfg;
  s->cfg.cameras = NULL;
  if (!s->cfg.min_cameras) s->cfg.min_cameras = cfg->n_cameras;
  if (!s->cfg.max_wait_ns) s->cfg.max_wait_ns = 500 * SV_NS_PER_MS;
  if (!s->cfg.step_limit_ns) s->cfg.step_limit_ns = SV_NS_PER_S;
  if (s->cfg.max_drift == 0) s->cfg.max_drift = 1e-3;
  s->now_ns = -MAX_STAMP_NS;
  for (int c = 0; c < cfg->n_cameras; c++) {
    bool is_common = cfg->clock_mode == SV_SYNC_CLOCK_COMMON ||
                     (cfg->clock_mode == SV_SYNC_CLOCK_AUTO && cfg->cameras[c].clock == SV_CLOCK_MONOTONIC);
    s->streams[c].stamp = cfg->cameras[c].stamp;
    sv_timestamp_filter_init(&s->streams[c].filter, cfg->cameras[c].stamp_noise_ns);
    sv_clock_model_init(&s->streams[c].clock, is_common, s->cfg.step_limit_ns, s->cfg.max_drift,
                        cfg->cameras[c].transport_ns);
  }
  return SV_OK;
}

// --- small parts ---------------------------------------------------------------------------------
static void event(sv_sync *s, sv_sync_event_kind kind, int i_camera, sv_ns host_ns, int64_t detail) {
  s->streams[i_camera].events[kind]++;
  if (s->n_events == SV_SYNC_CAP_EVENTS) {
    s->i_event = (s->i_event + 1) % SV_SYNC_CAP_EVENTS;
    s->n_events--;
    s->n_events_lost++;
  }
  s->events[(s->i_event + s->n_events++) % SV_SYNC_CAP_EVENTS] =
      (sv_sync_event){kind, i_camera, host_ns, detail};
}

static int n_free_returns(const sv_sync *s) { return s->cap_returns - s->n_returns; }

static void give_back(sv_sync *s, const sv_frame *f, sv_drop_reason reason) {
  s->streams[f->i_camera].ledger.dropped[reason]++;
  s->returns[(s->i_return + s->n_returns++) % s->cap_returns] = *f;
}

static sv_sync_entry *entry(const sv_sync *s, int c, int i) {
  sv_sync_stream *st = &s->streams[c];
  return &st->queue[(st->i_head + i) % s->cfg.queue_len];
}

static sv_frame take_head(sv_sync *s, int c) {
  sv_sync_stream *st = &s->streams[c];
  sv_frame f = entry(s, c, 0)->frame;
  st->i_head = (st->i_head + 1) % s->cfg.queue_len;
  st->n_queued--;
  st->ledger.pending--;
  return f;
}

static void drop_head(sv_sync *s, int c, sv_drop_reason reason) {
  sv_frame f = take_head(s, c);
  give_back(s, &f, reason);
}

static sv_ns mid_host_ns(const sv_sync_stream *st, const sv_frame *f, sv_ns steady_ns) {
  sv_ns half_ns = f->exposure_ns > 0 && f->exposure_ns <= MAX_EXPOSURE_NS ? f->exposure_ns / 2 : 0;
  sv_ns t_ns = sv_clock_model_host_ns(&st->clock, steady_ns);
  return st->stamp == SV_STAMP_START ? t_ns + half_ns : st->stamp == SV_STAMP_END ? t_ns - half_ns : t_ns;
}

// --- push: what kind of frame is it --------------------------------------------------------------
static bool stamps_are_possible(const sv_frame *f) {
  return f->camera_ns > -MAX_STAMP_NS && f->camera_ns < MAX_STAMP_NS && f->arrival_ns > -MAX_STAMP_NS &&
         f->arrival_ns < MAX_STAMP_NS;
}

// Whether the camera's clock was set between the last frame and this one, judged by the host's
// clock.
static sv_ns clock_jump_ns(const sv_sync *s, const sv_sync_stream *st, const sv_frame *f, uint32_t n_frames,
                           bool goes_on) {
  sv_ns jump_ns = (f->camera_ns - st->last_camera_ns) - (f->arrival_ns - st->last_arrival_ns), off_ns;
  // A steady frame rate tells smaller jumps: the stamp is off, and the frame did not come so much
  // later or earlier.
  if (sv_timestamp_filter_is_off(&st->filter, f->camera_ns, n_frames, &off_ns)) {
    sv_ns left_ns = jump_ns - off_ns;
    if (left_ns < 0) left_ns = -left_ns;
    if (left_ns < (off_ns < 0 ? -off_ns : off_ns) / 2) return off_ns;
  }
  // The last one may have been late, and this one in time: then nothing was set.
  return !goes_on && (jump_ns > s->cfg.step_limit_ns || jump_ns < -s->cfg.step_limit_ns) ? jump_ns : 0;
}

static void advance_sequence(sv_sync *s, int c, const sv_frame *f, uint32_t delta) {
  sv_sync_stream *st = &s->streams[c];
  if (delta > 1) { // the sensor took them, nobody will ever hand them over
    st->ledger.captured += delta - 1;
    st->ledger.dropped[SV_DROP_SEQUENCE_GAP] += delta - 1;
    event(s, SV_SYNC_EVENT_SEQUENCE_GAP, c, f->arrival_ns, (int64_t)delta - 1);
  }
  st->seen = delta < SEEN_FRAMES ? st->seen << delta | 1 : 1;
  st->last_sequence = f->sequence;
}

static void reset_sequence(sv_sync *s, int c, const sv_frame *f) {
  event(s, SV_SYNC_EVENT_SEQUENCE_RESET, c, f->arrival_ns, (int64_t)s->streams[c].last_sequence);
  s->streams[c].seen = 1;
  s->streams[c].last_sequence = f->sequence;
}

// A frame older than the newest one. If its number was missing, it was counted as a gap already:
// the count moves to this reason instead of growing.
static sv_status drop_old(sv_sync *s, int c, const sv_frame *f, int32_t delta) {
  sv_sync_stream *st = &s->streams[c];
  uint64_t bit = delta > -SEEN_FRAMES && delta < 0 ? (uint64_t)1 << -delta : 0;
  if (bit && !(st->seen & bit) && st->ledger.dropped[SV_DROP_SEQUENCE_GAP]) {
    st->seen |= bit;
    st->ledger.captured--;
    st->ledger.dropped[SV_DROP_SEQUENCE_GAP]--;
  } else if (bit && (st->seen & bit)) {
    event(s, SV_SYNC_EVENT_DUPLICATE, c, f->arrival_ns, (int64_t)f->sequence);
    give_back(s, f, SV_DROP_DUPLICATE);
    return SV_DROPPED;
  }
  event(s, SV_SYNC_EVENT_OUT_OF_ORDER, c, f->arrival_ns, (int64_t)f->sequence);
  give_back(s, f, SV_DROP_OUT_OF_ORDER);
  return SV_DROPPED;
}

// OK: go on with the frame. A sequence number that stands still while time goes on is accepted:
// some drivers do not count.
static sv_status check_order(sv_sync *s, int c, const sv_frame *f, sv_ns jump_ns) {
  sv_sync_stream *st = &s->streams[c];
  if (!st->has_last) {
    st->seen = 1;
    st->last_sequence = f->sequence;
    return SV_OK;
  }
  int32_t delta = (int32_t)(f->sequence - st->last_sequence);
  sv_ns dt_ns = f->camera_ns - st->last_camera_ns;
  bool is_back = dt_ns <= 0 && !jump_ns;
  if (dt_ns == 0) { // one instant, one frame
    if (delta > 0 && delta <= MAX_GAP_FRAMES) advance_sequence(s, c, f, (uint32_t)delta);
    event(s, SV_SYNC_EVENT_DUPLICATE, c, f->arrival_ns, (int64_t)f->sequence);
    give_back(s, f, SV_DROP_DUPLICATE);
    return SV_DROPPED;
  }
  if (delta > 0 && delta <= MAX_GAP_FRAMES) {
    advance_sequence(s, c, f, (uint32_t)delta);
    return is_back ? drop_old(s, c, f, 0) : SV_OK;
  }
  if (is_back) return drop_old(s, c, f, delta);
  if (delta != 0) reset_sequence(s, c, f);
  return SV_OK;
}

static sv_status drop_bad(sv_sync *s, int c, const sv_frame *f) {
  sv_sync_stream *st = &s->streams[c];
  int32_t delta = (int32_t)(f->sequence - st->last_sequence);
  // Its number still tells that no frame is missing here; its time is not to be trusted.
  if (st->has_last && delta > 0 && delta <= MAX_GAP_FRAMES) advance_sequence(s, c, f, (uint32_t)delta);
  event(s, SV_SYNC_EVENT_BAD_FRAME, c, stamps_are_possible(f) ? f->arrival_ns : s->now_ns,
        (int64_t)f->sequence);
  give_back(s, f, SV_DROP_ERROR_FLAG);
  return SV_DROPPED;
}

static sv_status drop_step(sv_sync *s, int c, const sv_frame *f, sv_ns step_ns) {
  event(s, SV_SYNC_EVENT_CLOCK_STEP, c, f->arrival_ns, step_ns);
  // What waits was stamped before the step; its order against what comes is not known any more.
  while (s->streams[c].n_queued) drop_head(s, c, SV_DROP_CLOCK_STEP);
  s->streams[c].has_host = false;
  s->streams[c].is_closed = false;
  give_back(s, f, SV_DROP_CLOCK_STEP);
  return SV_DROPPED;
}

// Room for one more: the oldest exposure goes, with all of its frames that are here.
static void make_room(sv_sync *s, int c) {
  if (s->streams[c].n_queued < s->cfg.queue_len) return;
  sv_ns t_ns = entry(s, c, 0)->mid_host_ns;
  event(s, SV_SYNC_EVENT_OVERFLOW, c, s->now_ns, (int64_t)entry(s, c, 0)->frame.sequence);
  for (int k = 0; k < s->cfg.n_cameras; k++) {
    if (!s->streams[k].n_queued) continue;
    sv_ns dt_ns = entry(s, k, 0)->mid_host_ns - t_ns;
    if (k == c || (dt_ns <= s->cfg.skew_limit_ns && dt_ns >= -s->cfg.skew_limit_ns))
      drop_head(s, k, SV_DROP_OVERFLOW);
  }
}

static sv_status enqueue(sv_sync *s, int c, const sv_frame *f, sv_ns steady_ns) {
  sv_sync_stream *st = &s->streams[c];
  // Frames that wait get the better estimate too; in one epoch their order cannot change.
  for (int i = 0; i < st->n_queued; i++)
    entry(s, c, i)->mid_host_ns = mid_host_ns(st, &entry(s, c, i)->frame, entry(s, c, i)->steady_ns);
  sv_ns mid_ns = mid_host_ns(st, f, steady_ns);
  st->last_mid_host_ns = mid_ns;
  st->has_host = true;
  if (f->is_unsettled || (st->is_closed && mid_ns <= st->closed_ns)) {
    give_back(s, f, f->is_unsettled ? SV_DROP_UNSETTLED : SV_DROP_LATE);
    return SV_DROPPED;
  }
  make_room(s, c);
  *entry(s, c, st->n_queued) = (sv_sync_entry){*f, steady_ns, mid_ns};
  st->n_queued++;
  st->ledger.pending++;
  return SV_OK;
}

// By the numbers, counted from the last frame that the timestamp filter has seen; 0 when they do
// not tell.
static uint32_t frames_since_last(const sv_sync_stream *st, const sv_frame *f) {
  int32_t delta = (int32_t)(f->sequence - st->last_sequence);
  uint32_t n = f->sequence - st->filter_sequence;
  return st->has_last && delta > 0 && delta <= MAX_GAP_FRAMES && n <= 2 * MAX_GAP_FRAMES ? n : 0;
}

// Do the stamps go on as before, by the frames' spacing? Then by how much the clock can have been
// set meanwhile; INT64_MAX: they do not, or nothing is known.
static sv_ns most_set_ns(sv_sync_stream *st, const sv_frame *f, uint32_t n_frames) {
  if (!st->has_last) return INT64_MAX;
  double dt_ns = (double)(f->camera_ns - st->last_camera_ns), n = n_frames ? (double)n_frames : 1;
  double was_ns = st->interval_ns, off_ns = fabs(dt_ns - n * was_ns);
  if (!(dt_ns > 0)) return INT64_MAX;
  if (!(was_ns > 0)) { // the second frame: any rate will do
    st->interval_ns = dt_ns / n;
    return dt_ns < n * SV_NS_PER_S ? 0 : INT64_MAX;
  }
  bool goes_on = dt_ns > 0.5 * n * was_ns && dt_ns < (n + 0.5) * was_ns;
  st->n_odd = goes_on ? 0 : st->n_odd + 1;
  if (goes_on) st->interval_ns += (dt_ns / n - was_ns) / 16;
  else if (st->n_odd >= MAX_ODD) st->interval_ns = dt_ns / n;
  return goes_on ? (sv_ns)floor(off_ns + 0.5) : INT64_MAX;
}

// A host that was held up gets frames late, by more than a step's limit. Their stamps go on as
// before, which those of a clock that was set do not: such a frame is good, but tells nothing about
// the clock. Those that come faster than they were taken are what has piled up meanwhile, however
// many they are.
static bool is_just_late(const sv_sync *s, sv_sync_stream *st, const sv_frame *f, bool goes_on) {
  sv_ns host_ns = st->clock.is_started ? sv_clock_model_host_ns(&st->clock, f->camera_ns) : f->arrival_ns;
  if (!goes_on || f->arrival_ns - host_ns <= s->cfg.step_limit_ns) {
    st->n_late = 0;
    return false;
  }
  if (f->arrival_ns - st->last_arrival_ns > (f->camera_ns - st->last_camera_ns) / 2) st->n_late++;
  return st->n_late <= (st->clock.n_pairs > 1 ? MAX_LATE : MAX_LATE_FIRST);
}

sv_status sv_sync_push(sv_sync *s, const sv_frame *f) {
  int c = f->i_camera;
  if (c < 0 || c >= s->cfg.n_cameras) return SV_E_ARG;
  if (n_free_returns(s) < s->cfg.queue_len + s->cfg.n_cameras + 1) return SV_E_FULL;
  sv_sync_stream *st = &s->streams[c];
  st->ledger.captured++;
  if (f->is_error || !stamps_are_possible(f)) return drop_bad(s, c, f);
  if (f->arrival_ns > s->now_ns) s->now_ns = f->arrival_ns;
  uint32_t n_frames = frames_since_last(st, f);
  sv_ns set_ns = most_set_ns(st, f, n_frames);
  bool goes_on = set_ns < INT64_MAX, is_late = is_just_late(s, st, f, goes_on);
  sv_ns jump_ns = st->has_last && !is_late ? clock_jump_ns(s, st, f, n_frames, goes_on) : 0;
  sv_status status = check_order(s, c, f, jump_ns);
  if (status != SV_OK) return status;
  bool was_back = st->has_last && f->camera_ns <= st->last_camera_ns;
  st->has_last = true;
  st->last_camera_ns = f->camera_ns;
  st->last_arrival_ns = f->arrival_ns;
  st->filter_sequence = f->sequence;
  sv_ns step_ns = jump_ns;
  if (jump_ns && sv_timestamp_filter_step(&st->filter, f->camera_ns, n_frames))
    return drop_step(s, c, f, step_ns);
  sv_ns steady_ns = jump_ns ? f->camera_ns : sv_timestamp_filter_add(&st->filter, f->camera_ns, n_frames);
  if (is_late) return enqueue(s, c, f, steady_ns);
  if (was_back) sv_clock_model_restart(&st->clock, steady_ns, f->arrival_ns);
  else if (!sv_clock_model_add(&st->clock, steady_ns, f->arrival_ns, set_ns, &step_ns))
    return enqueue(s, c, f, steady_ns);
  return drop_step(s, c, f, step_ns);
}

// --- pop: which frames belong together -----------------------------------------------------------
typedef struct {
  int i_first; // the camera whose head is the oldest; -1: nothing waits
  // Heads within the skew limit of it; cameras that may still bring one
  int n_present, n_open;
  int i_open;                         // one of those
  sv_ns first_ns, second_ns, last_ns; // of the heads present
} group_t;

static group_t group(const sv_sync *s) {
  group_t g = {.i_first = -1, .i_open = -1};
  for (int c = 0; c < s->cfg.n_cameras; c++) {
    if (!s->streams[c].n_queued) continue;
    sv_ns t_ns = entry(s, c, 0)->mid_host_ns;
    if (g.i_first < 0 || t_ns < g.first_ns) {
      g.i_first = c;
      g.first_ns = t_ns;
    }
  }
  if (g.i_first < 0) return g;
  sv_ns end_ns = g.first_ns + s->cfg.skew_limit_ns;
  g.last_ns = g.first_ns;
  g.second_ns = INT64_MAX;
  for (int c = 0; c < s->cfg.n_cameras; c++) {
    const sv_sync_stream *st = &s->streams[c];
    if (st->n_queued) {
      sv_ns t_ns = entry(s, c, 0)->mid_host_ns;
      if (t_ns > end_ns) continue;
      g.n_present++;
      if (t_ns > g.last_ns) g.last_ns = t_ns;
      if (c != g.i_first && t_ns < g.second_ns) g.second_ns = t_ns;
    } else if (!(st->has_host && st->last_mid_host_ns > end_ns) &&
               !(st->is_closed && st->closed_ns >= end_ns)) {
      g.n_open++;
      g.i_open = c;
    }
  }
  return g;
}

// The oldest head is left out when its camera's next frame lies nearer to all the others.
static bool next_is_nearer(const sv_sync *s, const group_t *g) {
  if (s->cfg.n_cameras == 1 || s->streams[g->i_first].n_queued < 2) return false;
  sv_ns next_ns = entry(s, g->i_first, 1)->mid_host_ns;
  sv_ns low_ns = next_ns < g->second_ns ? next_ns : g->second_ns;
  sv_ns high_ns = next_ns > g->last_ns ? next_ns : g->last_ns;
  return g->second_ns != INT64_MAX && high_ns - low_ns < g->last_ns - g->first_ns;
}

// Later frames of the cameras that are not part of it come too late.
static void close_without(sv_sync *s, int c, sv_ns t_ns) {
  sv_sync_stream *st = &s->streams[c];
  if (!st->is_closed || t_ns > st->closed_ns) st->closed_ns = t_ns;
  st->is_closed = true;
}

static void deliver(sv_sync *s, const group_t *g, sv_exposure *e, sv_frame *frames) {
  memset(e, 0, sizeof *e);
  e->id = s->n_exposures++;
  e->skew_ns = g->last_ns - g->first_ns;
  e->rig_from_world = sv_pose_identity();
  sv_ns sum_ns = 0;
  for (int c = 0; c < s->cfg.n_cameras; c++) {
    sv_sync_stream *st = &s->streams[c];
    if (!st->n_queued || entry(s, c, 0)->mid_host_ns > g->first_ns + s->cfg.skew_limit_ns) {
      frames[c] = (sv_frame){.i_camera = -1};
      close_without(s, c, g->last_ns);
      continue;
    }
    sum_ns += entry(s, c, 0)->mid_host_ns - g->first_ns;
    frames[c] = take_head(s, c);
    st->ledger.delivered++;
    e->present[c / 64] |= (uint64_t)1 << (c % 64);
  }
  e->time_ns = g->first_ns + sum_ns / g->n_present;
  sv_skew_add(&s->skew, e->skew_ns);
}

// How far after the oldest head a frame belongs to its exposure and to no later one: half way to
// that camera's next frame. A skew limit may be many frames long, and what is given up must not
// take later exposures with it: a camera that comes back would find all of its frames late for
// ever, where queues are full before the limit is over.
static sv_ns reach_ns(const sv_sync *s, const group_t *g) {
  const sv_sync_stream *st = &s->streams[g->i_first];
  double next_ns =
      st->n_queued > 1 ? (double)(entry(s, g->i_first, 1)->mid_host_ns - g->first_ns) : st->interval_ns;
  return next_ns > 0 && next_ns < 2 * (double)s->cfg.skew_limit_ns ? (sv_ns)(next_ns / 2)
                                                                   : s->cfg.skew_limit_ns;
}

static void close_open(sv_sync *s, const group_t *g, sv_ns waited_ns) {
  event(s, SV_SYNC_EVENT_PARTNER_TIMEOUT, g->i_open, s->now_ns, waited_ns);
  sv_ns end_ns = g->first_ns + reach_ns(s, g);
  for (int c = 0; c < s->cfg.n_cameras; c++) {
    const sv_sync_stream *st = &s->streams[c];
    if (!st->n_queued && !(st->has_host && st->last_mid_host_ns > end_ns)) close_without(s, c, end_ns);
  }
}

sv_status sv_sync_pop_exposure(sv_sync *s, sv_exposure *e, sv_frame *frames) {
  for (;;) {
    group_t g = group(s);
    if (g.i_first < 0) return SV_AGAIN;
    if (n_free_returns(s) < 1) return SV_E_FULL;
    // Too few frames can come together whatever still arrives: the oldest is dropped without
    // waiting.
    if (g.n_present + g.n_open < s->cfg.min_cameras || next_is_nearer(s, &g)) {
      drop_head(s, g.i_first, SV_DROP_NO_PARTNER);
      continue;
    }
    if (g.n_open) {
      sv_ns waited_ns = s->now_ns - entry(s, g.i_first, 0)->frame.arrival_ns;
      // A full queue cannot wait: its next frame would push this one out.
      if (waited_ns <= s->cfg.max_wait_ns && s->streams[g.i_first].n_queued < s->cfg.queue_len)
        return SV_AGAIN;
      close_open(s, &g, waited_ns);
      if (g.n_present < s->cfg.min_cameras) {
        drop_head(s, g.i_first, SV_DROP_NO_PARTNER);
        continue;
      }
    }
    deliver(s, &g, e, frames);
    return SV_OK;
  }
}

// --- the rest ------------------------------------------------------------------------------------
sv_sync_camera sv_sync_camera_of(const sv_camera_caps *caps) {
  return (sv_sync_camera){.clock = caps->clock, .stamp = caps->stamp, .stamp_noise_ns = caps->stamp_noise_ns};
}

void sv_sync_refuse(sv_sync *s, const sv_exposure *e, sv_drop_reason reason) {
  for (int c = 0; c < s->cfg.n_cameras; c++) {
    if (!(e->present[c / 64] >> (c % 64) & 1)) continue;
    s->streams[c].ledger.delivered--;
    s->streams[c].ledger.dropped[reason]++;
  }
  sv_skew_remove(&s->skew, e->skew_ns);
}

void sv_sync_lengthened(sv_sync *s, int c, sv_ns delta_ns) {
  sv_timestamp_filter_lengthen(&s->streams[c].filter, delta_ns);
}

sv_status sv_sync_pop_return(sv_sync *s, sv_frame *frame) {
  if (!s->n_returns) return SV_AGAIN;
  *frame = s->returns[s->i_return];
  s->i_return = (s->i_return + 1) % s->cap_returns;
  s->n_returns--;
  return SV_OK;
}

sv_status sv_sync_flush(sv_sync *s) {
  for (int c = 0; c < s->cfg.n_cameras; c++)
    while (s->streams[c].n_queued) {
      if (n_free_returns(s) < 1) return SV_E_FULL;
      drop_head(s, c, SV_DROP_STOPPED);
    }
  return SV_OK;
}

sv_status sv_sync_pop_event(sv_sync *s, sv_sync_event *out) {
  if (!s->n_events) return SV_AGAIN;
  *out = s->events[s->i_event];
  s->i_event = (s->i_event + 1) % SV_SYNC_CAP_EVENTS;
  s->n_events--;
  return SV_OK;
}
