// SPDX-License-Identifier: Apache-2.0
#include <errno.h>
#include <string.h>

#include "platform/linux/linux.h"
#include "platform/v4l2/camera.h"

// one wait of the poll loop; retries and stalls are looked at in between
#define MAX_WAIT_NS (100 * SV_NS_PER_MS)

static sv_ns now(const sv_v4l2 *v) { return v->clock.now_ns(v->clock.self); }

// --- start-up and end ----------------------------------------------------------------------------
sv_status sv_v4l2_init(sv_v4l2 *v, const sv_camera_options *cfg, const sv_v4l2_sys *sys,
                       const sv_clock *clock, sv_arena *arena, sv_err *err) {
  memset(v, 0, sizeof *v);
  v->cfg = *cfg;
  v->sys = *sys;
  v->clock = *clock;
  if (sv_camera_has_sync(cfg))
    return sv_fail(err, SV_E_UNSUPPORTED, "v4l2: sync=server|client is a setting of libcamera only");
  sv_arena_part_begin(arena, "v4l2");
  v->cameras = SV_TAKE(arena, sv_v4l2_camera, cfg->n_cameras);
  if (!v->cameras) return sv_fail(err, SV_E_NOMEM, "v4l2: no room for %d cameras", cfg->n_cameras);
  for (int i = 0; i < cfg->n_cameras; i++) {
    sv_v4l2_camera *c = &v->cameras[i];
    memset(c, 0, sizeof *c);
    c->sys = &v->sys;
    c->cfg = &v->cfg;
    c->events = &v->events;
    c->is_triggered = &v->is_triggered;
    c->i_camera = i;
    c->fd = -1;
    for (int k = 0; k < SV_V4L2_CAP_SLOTS; k++) c->slot[k].dma_fd = -1;
    memcpy(c->path, cfg->name[i], sizeof c->path);
    const char *slash = strrchr(c->path, '/');
    sv_copy(c->caps.name, sizeof c->caps.name, slash ? slash + 1 : c->path);
    v->n_cameras = i + 1;
    sv_status s = sv_v4l2_open_device(c, err);
    if (s >= 0 && i > 0 && cfg->is_shared) s = sv_v4l2_check_shared(c, &v->cameras[0], err);
    if (s < 0) {
      sv_v4l2_close(v);
      return s;
    }
  }
  return SV_OK;
}

static sv_status source_stop(void *self);

void sv_v4l2_close(sv_v4l2 *v) {
  (void)source_stop(v);
  for (int i = 0; i < v->n_cameras; i++) {
    sv_v4l2_restore_controls(&v->cameras[i]);
    sv_v4l2_close_device(&v->cameras[i]);
  }
  v->n_cameras = 0;
}

const sv_v4l2_stats *sv_v4l2_camera_stats(const sv_v4l2 *v, int i) {
  return i >= 0 && i < v->n_cameras ? &v->cameras[i].stats : NULL;
}

int sv_v4l2_dmabuf(const sv_v4l2 *v, const sv_frame *f) {
  if (f->i_camera < 0 || f->i_camera >= v->n_cameras || f->i_buffer < 0 || f->i_buffer >= SV_V4L2_CAP_SLOTS)
    return -1;
  const sv_v4l2_slot *s = &v->cameras[f->i_camera].slot[f->i_buffer];
  return s->state == SV_V4L2_ON_LOAN ? s->dma_fd : -1;
}

// --- the poll loop -------------------------------------------------------------------------------
// Waits once, until host_ns at the latest, and takes what is there. -EINTR: a signal came.
static int wait_once(sv_v4l2 *v, sv_ns until_ns) {
  struct pollfd fds[SV_CAMERA_CAP_CAMERAS];
  sv_v4l2_camera *of[SV_CAMERA_CAP_CAMERAS];
  int n = 0;
  for (int i = 0; i < v->n_cameras; i++) {
    sv_v4l2_camera *c = &v->cameras[i];
    if (c->fd < 0 && c->retry_ns < until_ns) until_ns = c->retry_ns;
    // A camera without a buffer of the driver's would report an error that is none.
    if (c->fd < 0 || !c->is_streaming || c->has_waiting || !sv_v4l2_n_queued(c)) continue;
    fds[n] = (struct pollfd){.fd = c->fd, .events = POLLIN | POLLPRI};
    of[n++] = c;
  }
  sv_ns wait_ns = until_ns - now(v);
  if (wait_ns > MAX_WAIT_NS) wait_ns = MAX_WAIT_NS;
  if (wait_ns < 0) wait_ns = 0;
  int r = v->sys.poll(v->sys.self, fds, n, (int)((wait_ns + SV_NS_PER_MS - 1) / SV_NS_PER_MS));
  if (r < 0) return r;
  sv_ns t_ns = now(v);
  for (int i = 0; i < n; i++) {
    if (!fds[i].revents) continue;
    int got = sv_v4l2_take(of[i], t_ns);
    if (got >= 0 && (fds[i].revents & POLLPRI)) sv_v4l2_take_events(of[i], t_ns);
    if (got == 0 && of[i]->fd >= 0 && (fds[i].revents & (POLLERR | POLLHUP | POLLNVAL))) got = -EIO;
    if (got < 0) sv_v4l2_fault(of[i], got, t_ns);
  }
  return 0;
}

// While nobody looked, no camera was silent: a host that was held up finds its frames waiting.
static void mind_absence(sv_v4l2 *v, sv_ns t_ns) {
  sv_ns gap_ns = t_ns - v->looked_ns;
  for (int i = 0; gap_ns > 2 * MAX_WAIT_NS && i < v->n_cameras; i++)
    v->cameras[i].last_frame_ns += gap_ns - 2 * MAX_WAIT_NS;
  v->looked_ns = t_ns;
}

static sv_v4l2_camera *oldest_waiting(sv_v4l2 *v) {
  sv_v4l2_camera *best = NULL;
  for (int i = 0; i < v->n_cameras; i++) {
    sv_v4l2_camera *c = &v->cameras[i];
    if (!c->has_waiting) continue;
    if (!best || c->waiting.arrival_ns < best->waiting.arrival_ns ||
        (c->waiting.arrival_ns == best->waiting.arrival_ns && c->waiting.camera_ns < best->waiting.camera_ns))
      best = c;
  }
  return best;
}

static sv_status source_dequeue(void *self, sv_frame *f, sv_ns until_ns) {
  sv_v4l2 *v = self;
  *f = (sv_frame){.i_camera = -1, .i_buffer = -1};
  if (!v->is_running) return SV_END;
  for (bool is_last = false;;) {
    sv_ns t_ns = now(v);
    mind_absence(v, t_ns);
    if (v->is_settled) sv_v4l2_turn_brackets(v, t_ns);
    for (int i = 0; i < v->n_cameras; i++) {
      sv_v4l2_camera *c = &v->cameras[i];
      sv_v4l2_service(c, t_ns);
      if (!c->has_failed) continue;
      c->has_failed = false;
      f->i_camera = i;
      return SV_E_DEVICE;
    }
    sv_v4l2_camera *c = oldest_waiting(v);
    if (c) {
      *f = c->waiting;
      c->has_waiting = false;
      sv_v4l2_slot *s = &c->slot[f->i_buffer];
      if (s->state == SV_V4L2_WAITING) s->state = SV_V4L2_ON_LOAN;
      c->stats.n_frames++;
      c->stats.n_errors += f->is_error;
      return SV_OK;
    }
    if (is_last) return SV_AGAIN;
    int r = wait_once(v, until_ns);
    if (r == -EINTR) return SV_AGAIN; // so that a stop request is seen
    if (r < 0) return SV_E_DEVICE;
    is_last = now(v) >= until_ns; // one more look at what came
  }
}

static sv_status source_requeue(void *self, const sv_frame *f) {
  sv_v4l2 *v = self;
  if (f->i_camera < 0 || f->i_camera >= v->n_cameras || f->i_buffer < 0 || f->i_buffer >= SV_V4L2_CAP_SLOTS)
    return SV_E_ARG;
  sv_v4l2_camera *c = &v->cameras[f->i_camera];
  sv_v4l2_slot *s = &c->slot[f->i_buffer];
  if (s->state == SV_V4L2_ORPHAN) sv_v4l2_free_slot(c, s);
  else if (s->state != SV_V4L2_ON_LOAN) return SV_E_ARG; // handed back twice, or never given
  else {
    s->state = SV_V4L2_IDLE;
    int r = c->is_streaming ? sv_v4l2_queue(c, s) : 0;
    if (r < 0) sv_v4l2_fault(c, r, now(v)); // the frame is taken back; dequeue tells of the camera
  }
  return SV_OK;
}

// --- start and stop ------------------------------------------------------------------------------
// The automatic controls settle on the scene, then they are switched off. Frames until then are let
// go.
static void settle(sv_v4l2 *v) {
  bool has_auto = false;
  for (int i = 0; i < v->n_cameras; i++)
    has_auto |= v->cameras[i].fd >= 0 && sv_v4l2_has_auto(&v->cameras[i]);
  sv_ns end_ns = now(v) + v->cfg.settle_ns;
  while (has_auto && now(v) < end_ns) {
    sv_frame f;
    sv_status s = source_dequeue(v, &f, end_ns);
    if (s == SV_OK) (void)source_requeue(v, &f);
    if (s == SV_AGAIN && now(v) < end_ns) break; // a signal
  }
  for (int i = 0; i < v->n_cameras; i++) {
    if (v->cameras[i].fd >= 0) sv_v4l2_lock_controls(&v->cameras[i], now(v));
    v->cameras[i].stats.n_frames = v->cameras[i].stats.n_errors = 0;
  }
  const sv_v4l2_camera *first = NULL; // that is there
  for (int i = 0; i < v->n_cameras && v->cfg.is_shared; i++) {
    sv_v4l2_camera *c = &v->cameras[i];
    if (c->fd < 0) continue;
    if (first) sv_v4l2_share_controls(c, first, now(v));
    else first = c;
  }
  sv_v4l2_begin_brackets(v);
  v->is_settled = true;
}

static sv_status source_start(void *self) {
  sv_v4l2 *v = self;
  int n_started = 0;
  if (v->is_running) return SV_E_ARG;
  for (int i = 0; i < v->n_cameras; i++) {
    sv_v4l2_camera *c = &v->cameras[i];
    sv_ns t_ns = now(v);
    c->stats = (sv_v4l2_stats){0};
    c->is_lost = c->has_failed = c->has_waiting = c->is_starved = false;
    c->n_stalls = 0;
    c->last_frame_ns = t_ns;
    int r = c->fd < 0 ? -ENODEV : sv_v4l2_stream_on(c);
    if (r < 0) sv_v4l2_fault(c, r, t_ns); // the others go on, this one is tried again
    else n_started++;
  }
  v->is_running = true;
  v->is_settled = false;
  v->looked_ns = now(v);
  if (!n_started) {
    (void)source_stop(v);
    return SV_E_DEVICE;
  }
  if (v->is_triggered && v->cfg.trigger.start(v->cfg.trigger.self) < 0) {
    (void)source_stop(v);
    return SV_E_DEVICE;
  }
  if (!v->cfg.is_unlocked) settle(v);
  return SV_OK;
}

// The mode is tried at once, so that a camera without it is told before any of them streams.
static sv_status source_trigger(void *self, bool is_external) {
  sv_v4l2 *v = self;
  if (v->is_running) return SV_E_ARG;
  v->is_triggered = false;
  if (!is_external) return SV_OK;
  if (v->cfg.trigger.line->kind == SV_LINE_NONE) return SV_E_UNSUPPORTED;
  for (int i = 0; i < v->n_cameras; i++) {
    sv_v4l2_camera *c = &v->cameras[i];
    int r = c->fd < 0 ? 0 : sv_v4l2_set_trigger_mode(c);
    if (r >= 0) continue;
    sv_camera_events_add(&v->events, SV_CAMERA_TRIGGER, i, now(v), r);
    return SV_E_UNSUPPORTED;
  }
  v->is_triggered = true;
  return SV_OK;
}

// Takes all buffers back, also those on loan.
static sv_status source_stop(void *self) {
  sv_v4l2 *v = self;
  if (v->is_triggered && v->is_running) v->cfg.trigger.stop(v->cfg.trigger.self);
  for (int i = 0; i < v->n_cameras; i++) {
    sv_v4l2_camera *c = &v->cameras[i];
    if (c->is_streaming) sv_v4l2_stream_off(c);
    c->has_waiting = c->has_failed = false;
    for (int k = 0; k < SV_V4L2_CAP_SLOTS; k++) {
      sv_v4l2_slot *s = &c->slot[k];
      if (s->state == SV_V4L2_ORPHAN) sv_v4l2_free_slot(c, s);
      else if (s->state == SV_V4L2_ON_LOAN || s->state == SV_V4L2_WAITING) s->state = SV_V4L2_IDLE;
    }
  }
  v->is_running = false;
  return SV_OK;
}

static sv_status source_caps(void *self, int i, sv_camera_caps *out) {
  sv_v4l2 *v = self;
  if (i < 0 || i >= v->n_cameras) return SV_E_ARG;
  *out = v->cameras[i].caps;
  out->is_light_locked = !v->cfg.is_unlocked && !v->cfg.n_brackets;
  out->n_brackets = v->cfg.n_brackets;
  out->is_light_shared = sv_camera_is_light_shared(&v->cfg);
  out->is_exposure_told = !v->cfg.is_unlocked;
  out->readout_ns = sv_v4l2_readout_ns(&v->cameras[i]);
  return SV_OK;
}

static sv_status source_event(void *self, sv_camera_event *e) {
  return sv_camera_events_pop(&((sv_v4l2 *)self)->events, e);
}

static sv_status source_control(void *self, int i, sv_control control, int64_t value, int64_t *actual) {
  sv_v4l2 *v = self;
  if (i < 0 || i >= v->n_cameras) return SV_E_ARG;
  if (control == SV_CONTROL_FRAME_DURATION_NS)
    return sv_v4l2_set_frame_duration(&v->cameras[i], value, actual);
  // gains are in units of each driver
  if (control != SV_CONTROL_EXPOSURE_NS) return SV_E_UNSUPPORTED;
  return sv_v4l2_set_exposure(&v->cameras[i], value, actual);
}

sv_source sv_v4l2_source(sv_v4l2 *v) {
  return (sv_source){.self = v,
                     .n_cameras = v->n_cameras,
                     .caps = source_caps,
                     .start = source_start,
                     .dequeue = source_dequeue,
                     .requeue = source_requeue,
                     .stop = source_stop,
                     .event = source_event,
                     .set_control = source_control,
                     .trigger = v->cfg.trigger.start ? source_trigger : NULL};
}
