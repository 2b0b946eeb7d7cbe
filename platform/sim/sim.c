// SPDX-License-Identifier: Apache-2.0
// The simulator's source: frames of the cameras, their arrival times and their buffers.
#include "platform/sim/sim.h"

#include <math.h>
#include <string.h>

#include "src/base/mathx.h"
#include "src/base/rng.h"

// delay of a reordered frame or a second copy after the other one
#define LATE_NS (200 * SV_NS_PER_US)

#define LINE_NS (10 * SV_NS_PER_US) // step in which a camera's frame length can be set

static sv_ns from_us(double us) { return (sv_ns)floor(us * 1e3 + 0.5); }

// --- memory --------------------------------------------------------------------------------------

bool sv_sim_is_deep(const sv_sim_config *cfg) {
  return cfg->is_deep || sv_device_info_of(cfg->rig)->forward == SV_FORWARD_MULTIPLEXED;
}

static sv_status carve(sv_sim *s, const sv_sim_config *cfg, sv_arena *a) {
  const bool is_deep = sv_sim_is_deep(cfg);
  size_t n_values = 3 * (size_t)cfg->width_px * (size_t)cfg->height_px;
  s->cfg = *cfg;
  s->n_cameras = sv_device_n_cameras(cfg->rig);
  s->frame_bytes = n_values * (is_deep ? 2 : 1);
  s->cap_ready = s->n_cameras * cfg->n_buffers + SV_SIM_CAP_FAULTS;
  sv_arena_part_begin(a, "simulator");
  sv_status status = sv_rig_init(&s->rig, sv_sim_n_sub_views(cfg), a);
  s->fisheye = cfg->lens == SV_SIM_LENS_KB4 ? SV_TAKE(a, sv_fisheye, sv_sim_n_sub_views(cfg)) : NULL;
  s->scene = SV_TAKE(a, sv_sim_scene, 1);
  s->shot = SV_TAKE(a, sv_sim_shot, 1);
  s->ready = SV_TAKE(a, sv_sim_event, s->cap_ready);
  for (int i = 0; i < s->n_cameras; i++)
    s->cameras[i].buffers = SV_TAKE(a, uint8_t, s->frame_bytes * (size_t)cfg->n_buffers);
  if (status >= 0) status = sv_noise_init(&s->noise, a);
  if (status >= 0) status = sv_sim_optics_init(&s->optics, &cfg->optics, s->noise.srgb16, a);
  s->sum = is_deep || s->optics.is_on ? SV_TAKE(a, float, n_values) : NULL;
  return status < 0 ? status : a->status;
}

size_t sv_sim_bytes(const sv_sim_config *cfg) {
  sv_sim s = {0};
  sv_arena dry = sv_arena_dry();
  (void)carve(&s, cfg, &dry); // a dry arena cannot fail
  return dry.used_bytes;
}

sv_status sv_sim_init(sv_sim *s, const sv_sim_config *cfg, sv_arena *arena, sv_err *err) {
  sv_status status = sv_sim_check(cfg, err);
  if (status < 0) return status;
  sv_device_params device = sv_sim_device(cfg);
  *s = (sv_sim){0};
  status = carve(s, cfg, arena);
  if (status < 0)
    return sv_fail(err, status, "sim: %zu bytes do not fit: the arena has %zu of %zu bytes in use",
                   sv_sim_bytes(cfg), arena->used_bytes, arena->cap_bytes);
  for (int i = 0; i < SV_SIM_CAP_CAMERAS; i++) s->exposure[i] = 1;
  s->now_ns = SV_SIM_EPOCH_NS;
  s->period_ns = (sv_ns)floor(1e9 / cfg->fps + 0.5);
  status = sv_device_build(&s->rig, &device, err);
  if (status >= 0) status = sv_sim_set_lenses(s, err);
  if (status < 0) return status;
  for (int i = 0; i < s->rig.n_sub_views; i++) {
    s->rig.sub_views[i].noise = (sv_sensor_noise){cfg->noise_read, cfg->noise_shot};
    s->rig.sub_views[i].shutter = (sv_shutter){1e-3 * cfg->optics.readout_ms, cfg->optics.shutter};
  }
  s->largest_overlap = sv_device_largest_overlap(&s->rig, 0);
  sv_sim_scene_build(s->scene, cfg->scene);
  return SV_OK;
}

const sv_rig *sv_sim_rig(const sv_sim *s) { return &s->rig; }
float sv_sim_light(const sv_sim *s) { return (float)(s->cfg.optics.light * s->exposure[0]); }
const sv_sim_counts *sv_sim_camera_counts(const sv_sim *s, int i) { return &s->cameras[i].counts; }

void sv_sim_scene_bounds(const sv_sim *s, double centre_m[3], double *radius_m) {
  centre_m[0] = centre_m[1] = centre_m[2] = 0;
  *radius_m = s->scene->radius_m;
}

// --- what a camera sends -------------------------------------------------------------------------

// The fault of a kind for this camera at this slot: a fault of N frames matches all of them.
static const sv_sim_fault *fault_at(const sv_sim *s, sv_sim_fault_kind kind, int i_camera, int64_t slot) {
  bool lasts = kind == SV_SIM_FAULT_ERROR || kind == SV_SIM_FAULT_DUP || kind == SV_SIM_FAULT_REORDER;
  for (int i = 0; i < s->cfg.n_faults; i++) {
    const sv_sim_fault *f = &s->cfg.faults[i];
    if (f->kind != kind || f->i_camera != i_camera) continue;
    if (lasts ? slot >= f->slot && slot < f->slot + f->n : slot == f->slot) return f;
  }
  return NULL;
}

// +1, -1, +1/2: rate errors of the cameras' oscillators, for clocks and, independently, for frame
// rates.
static const double RATE_SHARE[SV_SIM_CAP_CAMERAS] = {1, -1, 0.5};

static sv_ns true_time(const sv_sim *s, int i_camera, int64_t slot) {
  const sv_sim_camera *c = &s->cameras[i_camera];
  double share = s->n_cameras > 1 ? (double)i_camera / (s->n_cameras - 1) : 0;
  sv_ns t_ns = sv_sim_slot_ns(s, slot);
  if (s->is_triggered) return t_ns;
  t_ns += from_us((double)(t_ns - SV_SIM_EPOCH_NS) * 1e-9 * s->cfg.rate_ppm * RATE_SHARE[i_camera]);
  return t_ns + from_us(s->cfg.skew_us * share) + c->shift_ns + (slot - c->next_slot) * c->longer_ns;
}

static uint32_t dice(const sv_sim *s, int i_camera, int64_t slot, uint32_t what) {
  return sv_hash3(s->cfg.seed + 0x9e3779b9u * what, (uint32_t)i_camera, (uint32_t)slot);
}

static sv_ns arrival_time(const sv_sim *s, int i_camera, int64_t slot) {
  double late = (double)dice(s, i_camera, slot, 1) * 0x1p-32 * s->cfg.delay_jitter_us;
  return true_time(s, i_camera, slot) + from_us(0.5 * s->cfg.shutter_us + s->cfg.delay_us + late);
}

static sv_ns camera_time(const sv_sim *s, int i_camera, int64_t slot) {
  sv_ns since = true_time(s, i_camera, slot) - SV_SIM_EPOCH_NS;
  sv_rng rng = sv_rng_make(s->cfg.seed, dice(s, i_camera, slot, 2));
  sv_ns t = SV_SIM_EPOCH_NS + since + from_us(s->cfg.offset_ms * 1e3 * (i_camera + 1));
  t += from_us((double)since * 1e-9 * s->cfg.drift_ppm * RATE_SHARE[i_camera]);
  if (s->cfg.jitter_us > 0) t += from_us((double)sv_rng_normal(&rng) * s->cfg.jitter_us);
  for (int i = 0; i < s->cfg.n_faults; i++) {
    const sv_sim_fault *f = &s->cfg.faults[i];
    if (f->kind == SV_SIM_FAULT_CLOCKSTEP && f->i_camera == i_camera && slot >= f->slot)
      t += f->n * SV_NS_PER_MS;
  }
  return t;
}

static void send(sv_sim_camera *c, sv_sim_event e) { c->pending[c->n_pending++] = e; }

static void skip_to(sv_sim_camera *c, int64_t slot) {
  c->shift_ns += (slot - c->next_slot) * c->longer_ns;
  c->next_slot = slot;
}

// Skips the slots of an unplugged or stalled camera. False when the camera works.
static bool rest(sv_sim *s, int i_camera, sv_sim_camera *c) {
  const sv_sim_fault *gone = fault_at(s, SV_SIM_FAULT_UNPLUG, i_camera, c->next_slot);
  const sv_sim_fault *still = fault_at(s, SV_SIM_FAULT_STALL, i_camera, c->next_slot);
  if (gone) {
    send(c, (sv_sim_event){.kind = SV_SIM_EVENT_UNPLUGGED,
                           .i_camera = i_camera,
                           .i_buffer = -1,
                           .slot = c->next_slot,
                           .arrival_ns = sv_sim_slot_ns(s, c->next_slot)});
    c->next_sequence = 0;
    skip_to(c, c->next_slot + gone->n);
    c->is_ended = gone->n == 0;
    return true;
  }
  if (!still || still->n == 0) return false;
  skip_to(c, c->next_slot + still->n);
  return true;
}

static void step_camera(sv_sim *s, int i_camera) {
  sv_sim_camera *c = &s->cameras[i_camera];
  int64_t k = c->next_slot;
  if (s->cfg.n_frames && k >= s->cfg.n_frames) {
    c->is_ended = true;
    return;
  }
  if (rest(s, i_camera, c)) return;
  const sv_sim_fault *reset = fault_at(s, SV_SIM_FAULT_SEQRESET, i_camera, k);
  if (reset) c->next_sequence = (uint32_t)reset->n;
  sv_sim_event e = {.kind = SV_SIM_EVENT_FRAME,
                    .i_camera = i_camera,
                    .i_buffer = -1,
                    .slot = k,
                    .sequence = c->next_sequence++,
                    .true_ns = true_time(s, i_camera, k),
                    .camera_ns = camera_time(s, i_camera, k),
                    .arrival_ns = arrival_time(s, i_camera, k)};
  e.is_damaged = fault_at(s, SV_SIM_FAULT_ERROR, i_camera, k) != NULL;
  if (fault_at(s, SV_SIM_FAULT_REORDER, i_camera, k))
    e.arrival_ns = arrival_time(s, i_camera, k + 1) + LATE_NS;
  skip_to(c, k + 1);
  if ((double)dice(s, i_camera, k, 3) * 0x1p-32 < s->cfg.drop) e.kind = SV_SIM_EVENT_LOST;
  send(c, e);
  if (e.kind != SV_SIM_EVENT_FRAME || !fault_at(s, SV_SIM_FAULT_DUP, i_camera, k)) return;
  e.kind = SV_SIM_EVENT_COPY;
  e.arrival_ns += LATE_NS;
  send(c, e);
}

// The earliest pending event, or NULL. Three pending per camera are enough to see past a
// reordered frame, which comes just after the next slot's.
static sv_sim_event *earliest(sv_sim *s, int *i_pending) {
  sv_sim_event *best = NULL;
  for (int i = 0; i < s->n_cameras; i++) {
    sv_sim_camera *c = &s->cameras[i];
    while (!c->is_ended && c->n_pending < 4) step_camera(s, i);
    for (int k = 0; k < c->n_pending; k++)
      if (!best || c->pending[k].arrival_ns < best->arrival_ns) {
        best = &c->pending[k];
        *i_pending = k;
      }
  }
  return best;
}

// --- what the host gets --------------------------------------------------------------------------

static void arrive(sv_sim *s, sv_sim_event e) {
  sv_sim_camera *c = &s->cameras[e.i_camera];
  if (e.kind == SV_SIM_EVENT_FRAME || e.kind == SV_SIM_EVENT_LOST) c->counts.n_exposed++;
  if (e.kind == SV_SIM_EVENT_LOST) {
    c->counts.n_lost++;
    return;
  }
  if (e.kind != SV_SIM_EVENT_UNPLUGGED) {
    e.i_buffer = 0;
    while (e.i_buffer < s->cfg.n_buffers && c->is_taken >> e.i_buffer & 1) e.i_buffer++;
    if (e.i_buffer == s->cfg.n_buffers) {
      if (e.kind == SV_SIM_EVENT_FRAME) c->counts.n_starved++;
      return;
    }
    c->is_taken |= 1u << e.i_buffer;
  }
  s->ready[s->n_ready++] = e; // cap_ready: every buffer, and every fault once
}

static void catch_up(sv_sim *s) {
  int i_pending = 0;
  if (!s->is_running) return;
  for (sv_sim_event *e; (e = earliest(s, &i_pending)) && e->arrival_ns <= s->now_ns;) {
    sv_sim_event came = *e;
    sv_sim_camera *c = &s->cameras[came.i_camera];
    c->n_pending--;
    memmove(c->pending + i_pending, c->pending + i_pending + 1,
            (size_t)(c->n_pending - i_pending) * sizeof *c->pending);
    arrive(s, came);
  }
}

static sv_pixel_format format_of(const sv_sim *s) {
  return sv_sim_is_deep(&s->cfg) ? SV_PIX_RGB16 : SV_PIX_RGB8;
}

static bool has_own_clock(const sv_sim_config *c) {
  for (int i = 0; i < c->n_faults; i++)
    if (c->faults[i].kind == SV_SIM_FAULT_CLOCKSTEP) return true;
  return c->drift_ppm != 0 || c->offset_ms != 0;
}

static sv_status src_caps(void *self, int i_camera, sv_camera_caps *out) {
  const sv_sim *s = self;
  if (i_camera < 0 || i_camera >= s->n_cameras) return SV_E_ARG;
  const sv_sub_view *first = &s->rig.sub_views[i_camera * (s->rig.n_sub_views / s->n_cameras)];
  *out = (sv_camera_caps){.width_px = s->cfg.width_px,
                          .height_px = s->cfg.height_px,
                          .format = format_of(s),
                          .fps = s->cfg.fps,
                          .stamp = SV_STAMP_MIDDLE,
                          .frame_bytes = s->frame_bytes,
                          .is_light_locked = s->cfg.optics.auto_exposure == 1 && s->cfg.optics.bracket == 1,
                          .n_brackets = s->cfg.optics.bracket != 1 ? 2 : 0,
                          .is_exposure_told = s->cfg.optics.auto_exposure == 1,
                          .is_light_shared = s->cfg.optics.lock != SV_SIM_LOCK_ON,
                          .is_color_known = sv_sim_optics_is_color_known(&s->cfg.optics),
                          .readout_ns = from_us(1e3 * s->cfg.optics.readout_ms),
                          .stamp_noise_ns = from_us(s->cfg.jitter_us),
                          .clock = has_own_clock(&s->cfg) ? SV_CLOCK_CAMERA : SV_CLOCK_MONOTONIC};
  (void)sv_copy(out->name, sizeof out->name, s->rig.forward == SV_FORWARD_DIRECT ? first->name : s->rig.name);
  return SV_OK;
}

static sv_status src_start(void *self) {
  sv_sim *s = self;
  if (s->is_running) return SV_OK;
  if (!s->is_metered) sv_sim_meter(s);
  int64_t slot = 0;
  if (s->now_ns > sv_sim_slot_ns(s, 0))
    slot = (s->now_ns - sv_sim_slot_ns(s, 0) + s->period_ns - 1) / s->period_ns;
  for (int i = 0; i < s->n_cameras; i++) {
    sv_sim_camera *c = &s->cameras[i];
    c->next_slot = slot;
    c->shift_ns = c->longer_ns = 0;
    c->next_sequence = 0;
    c->is_ended = false;
    c->n_pending = 0;
  }
  s->is_running = true;
  return SV_OK;
}

static sv_status src_stop(void *self) {
  sv_sim *s = self;
  for (int i = 0; i < s->n_ready; i++)
    if (s->ready[i].kind == SV_SIM_EVENT_FRAME) s->cameras[s->ready[i].i_camera].counts.n_flushed++;
  for (int i = 0; i < s->n_cameras; i++) {
    s->cameras[i].is_taken = s->cameras[i].on_loan = 0;
    s->cameras[i].n_pending = 0;
  }
  s->n_ready = 0;
  s->is_running = false;
  return SV_OK;
}

static sv_status deliver(sv_sim *s, sv_frame *frame) {
  sv_sim_event e = s->ready[0];
  sv_sim_camera *c = &s->cameras[e.i_camera];
  memmove(s->ready, s->ready + 1, (size_t)--s->n_ready * sizeof *s->ready);
  *frame = (sv_frame){.i_camera = e.i_camera, .arrival_ns = e.arrival_ns, .i_buffer = e.i_buffer};
  if (e.kind == SV_SIM_EVENT_UNPLUGGED) return SV_E_DEVICE;
  uint8_t *data = c->buffers + s->frame_bytes * (size_t)e.i_buffer;
  sv_sim_expose(s, &e, data);
  c->on_loan |= 1u << e.i_buffer;
  if (e.kind == SV_SIM_EVENT_COPY) c->counts.n_duplicates++;
  else c->counts.n_delivered++;
  frame->sequence = e.sequence;
  frame->camera_ns = e.camera_ns;
  frame->exposure_ns =
      from_us(s->cfg.shutter_us * s->exposure[e.i_camera] * sv_sim_optics_exposure(&s->cfg.optics, e.slot));
  frame->width_px = s->cfg.width_px;
  frame->height_px = s->cfg.height_px;
  frame->format = format_of(s);
  frame->stride_bytes = (int)(s->frame_bytes / (size_t)s->cfg.height_px);
  frame->data = data;
  frame->data_bytes = s->frame_bytes;
  frame->is_error = e.is_damaged;
  return SV_OK;
}

static sv_status src_dequeue(void *self, sv_frame *frame, sv_ns until_host_ns) {
  sv_sim *s = self;
  int i_pending = 0;
  if (!s->is_running) return SV_END;
  for (;;) {
    catch_up(s);
    if (s->n_ready) return deliver(s, frame);
    const sv_sim_event *e = earliest(s, &i_pending);
    if (!e) return SV_END;
    if (e->arrival_ns > until_host_ns) {
      if (until_host_ns > s->now_ns) s->now_ns = until_host_ns;
      return SV_AGAIN;
    }
    s->now_ns = e->arrival_ns;
  }
}

static sv_status src_requeue(void *self, const sv_frame *frame) {
  sv_sim *s = self;
  if (frame->i_camera < 0 || frame->i_camera >= s->n_cameras || frame->i_buffer < 0 ||
      frame->i_buffer >= s->cfg.n_buffers)
    return SV_E_ARG;
  sv_sim_camera *c = &s->cameras[frame->i_camera];
  uint32_t bit = 1u << frame->i_buffer;
  if (!(c->on_loan & bit)) return SV_E_ARG;
  catch_up(s); // events that arrived while the buffer was on loan did not get it
  c->on_loan &= ~bit;
  c->is_taken &= ~bit;
  return SV_OK;
}

static sv_status src_rig_pose(void *self, sv_ns host_ns, sv_pose *rig_from_world) {
  const sv_sim *s = self;
  if (s->cfg.has_unknown_poses) return SV_E_NOT_FOUND;
  sv_sim_rig_pose(s, host_ns, rig_from_world);
  return SV_OK;
}

// As in a real camera: pending frames keep their length, and lengths come in lines of 10 us.
static sv_status src_set_control(void *self, int i_camera, sv_control control, int64_t value,
                                 int64_t *actual) {
  sv_sim *s = self;
  if (i_camera < 0 || i_camera >= s->n_cameras) return SV_E_ARG;
  if (control != SV_CONTROL_FRAME_DURATION_NS) return SV_E_UNSUPPORTED;
  if (value < s->period_ns / 2 || value > 2 * s->period_ns) return SV_E_RANGE;
  sv_ns *longer_ns = &s->cameras[i_camera].longer_ns;
  *longer_ns = (value - s->period_ns) / LINE_NS * LINE_NS;
  if (actual) *actual = s->period_ns + *longer_ns;
  return SV_OK;
}

static sv_status src_trigger(void *self, bool is_external) {
  sv_sim *s = self;
  if (s->is_running) return SV_E_ARG;
  s->is_triggered = is_external;
  return SV_OK;
}

sv_source sv_sim_source(sv_sim *s) {
  return (sv_source){.self = s,
                     .n_cameras = s->n_cameras,
                     .caps = src_caps,
                     .start = src_start,
                     .dequeue = src_dequeue,
                     .requeue = src_requeue,
                     .stop = src_stop,
                     .rig_pose = src_rig_pose,
                     .set_control = src_set_control,
                     .trigger = src_trigger};
}

static sv_ns clock_now(void *self) { return ((sv_sim *)self)->now_ns; }
static void clock_sleep(void *self, sv_ns host_ns) {
  sv_sim *s = self;
  if (host_ns > s->now_ns) s->now_ns = host_ns;
}

sv_clock sv_sim_clock(sv_sim *s) { return (sv_clock){s, clock_now, clock_sleep}; }
