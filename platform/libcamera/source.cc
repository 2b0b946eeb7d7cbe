// SPDX-License-Identifier: Apache-2.0
// libcamera at work: requests out and in, stalls, and the source's calls.
#include <cerrno>
#include <chrono>
#include <cstdlib>
#include <cstring>

#include "platform/libcamera/shim.hpp"

using namespace libcamera;

#define MAX_CROP_OFF_PX 8                   // hardware rounds crops to a few pixels of the sensor
#define RETRY_NS        (20 * SV_NS_PER_MS) // while libcamera does not know it
#define LATER_RETRY_NS  (200 * SV_NS_PER_MS)
#define MAX_GAP_NS      (200 * SV_NS_PER_MS) // between two looks

// --- one camera ----------------------------------------------------------------------------------
// Runs on libcamera's thread: only records the completion.
void Cam::requestDone(Request *request) {
  sv_ns t_ns = now(owner);
  std::lock_guard<std::mutex> lock(owner->mutex);
  Slot &s = slots[request->cookie()];
  bool is_cancelled = request->status() == Request::RequestCancelled;
  s.state = is_cancelled ? RequestState::Idle : RequestState::Done;
  s.arrival_ns = t_ns;
  owner->arrived.notify_one();
}

void Cam::disconnected() {
  std::lock_guard<std::mutex> lock(owner->mutex);
  is_gone = true;
  owner->arrived.notify_one();
}

// controls::rpi::SyncMode: 0 off, 1 server, 2 client.
static void set_sync(const sv_libcamera *s, const Cam *c, ControlList *list) {
  // otherwise open has checked for this control
  if (sync_of(c) == SV_RPI_SYNC_OFF) return;
  list->set(s->sync_mode_id, ControlValue(static_cast<int32_t>(sync_of(c) == SV_RPI_SYNC_SERVER ? 1 : 2)));
}

// An exposure time, within the control's range.
static int32_t possible_us(const Cam *c, double us) {
  const auto info = c->camera->controls().find(&controls::ExposureTime);
  const double want = us + 0.5;
  if (us <= 0 || info == c->camera->controls().end()) return static_cast<int32_t>(us);
  const int32_t least = info->second.min().get<int32_t>(), most = info->second.max().get<int32_t>();
  if (want < least) return least;
  return most > 0 && want > most ? most : static_cast<int32_t>(want); // 0: it names no limit
}

// The exposure time that is given or was found: with lock=shared that of the first camera, over the
// relative response of this one. 0: not known yet.
static int32_t locked_us(const Cam *c) {
  const sv_camera_options &o = c->owner->cfg;
  const Cam *from = o.is_shared ? c->owner->cams.front().get() : c;
  if (c->locked_us > 0) return c->locked_us;
  const double us = o.exposure_ns > 0 ? static_cast<double>(o.exposure_ns) * 1e-3 : from->exposure_us;
  return possible_us(c, o.is_shared ? us * sv_camera_exposure_share(&o, c->i_camera) : us);
}

// Fixes the given values, or those found by the automatic controls, and switches these off.
// lock=shared: those of the first camera.
static void set_fixed(const sv_libcamera *s, const Cam *c, ControlList *list) {
  const Cam *from = s->cfg.is_shared ? s->cams.front().get() : c;
  const int32_t us = locked_us(c);
  float gain = s->cfg.gain >= 0 ? static_cast<float>(s->cfg.gain) : from->gain;
  if (us > 0 && has(c, controls::ExposureTime)) {
    list->set(controls::ExposureTime, us);
    if (has(c, controls::AeEnable)) list->set(controls::AeEnable, false);
  }
  if (gain > 0 && has(c, controls::AnalogueGain)) list->set(controls::AnalogueGain, gain);
  if (from->has_white && has(c, controls::AwbEnable)) {
    list->set(controls::AwbEnable, false);
    list->set(controls::ColourGains, Span<const float, 2>(from->white));
  }
}

// The next exposure time of the brackets, for the frame of a request. libcamera takes controls for
// the frame of their request, and tells which exposure time a frame had where the sensor is known.
static void ask_bracket(Cam *c, Slot *s) {
  const sv_camera_options &o = c->owner->cfg;
  s->asked_us = 0;
  if (!o.n_brackets || c->locked_us <= 0) return;
  s->asked_us = possible_us(c, c->locked_us * o.bracket[c->i_bracket]);
  s->request->controls().set(controls::ExposureTime, s->asked_us);
  c->i_bracket = (c->i_bracket + 1) % o.n_brackets;
}

static int queue(Cam *c, Slot *s) {
  {
    std::lock_guard<std::mutex> lock(c->owner->mutex);
    s->state = RequestState::Queued;
  }
  if (c->must_lock) set_fixed(c->owner, c, &s->request->controls());
  c->must_lock = false;
  ask_bracket(c, s);
  if (c->frame_us) s->request->controls().set(controls::FrameDurationLimits, {c->frame_us, c->frame_us});
  c->frame_us = 0;
  int r = c->camera->queueRequest(s->request.get());
  if (r >= 0) return 0;
  std::lock_guard<std::mutex> lock(c->owner->mutex);
  s->state = RequestState::Idle;
  return r;
}

static int stream_on(sv_libcamera *s, Cam *c) {
  ControlList list(c->camera->controls());
  if (s->cfg.fps > 0) {
    auto us = static_cast<int64_t>(1e6 / s->cfg.fps + 0.5);
    list.set(controls::FrameDurationLimits, {us, us});
  }
  if (!s->cfg.is_unlocked && (s->cfg.exposure_ns > 0 || c->exposure_us > 0)) set_fixed(s, c, &list);
  set_sync(s, c, &list);
  if (c->has_crop) list.set(controls::ScalerCrop, c->crop);
  if (c->camera->start(&list) < 0) return -1;
  c->is_streaming = true;
  c->is_synced = sync_of(c) == SV_RPI_SYNC_OFF;
  c->last_frame_ns = now(s);
  for (Slot &slot : c->slots)
    if (slot.state == RequestState::Idle) {
      slot.request->reuse(Request::ReuseBuffers);
      if (queue(c, &slot) < 0) return -1;
    }
  return 0;
}

// libcamera completes what is queued as cancelled before it returns.
static void stream_off(Cam *c) {
  if (c->camera && c->is_streaming) c->camera->stop();
  c->is_streaming = false;
}

// Releases the camera; it will be looked up again.
static void lose(sv_libcamera *s, Cam *c) {
  sv_ns t_ns = now(s);
  if (!c->is_away) {
    c->has_failed = c->is_away = true;
    c->lost_ns = t_ns;
    c->is_wrong = false;
    sv_camera_events_add(&s->events, SV_CAMERA_LOST, c->i_camera, t_ns, ENODEV);
  }
  c->is_lost = true;
  c->retry_ns = t_ns + RETRY_NS;
  sv_libcamera_detach(c);
}

// libcamera makes a new object of a camera that was plugged in again; its id, which names the port,
// is the same.
static void reopen(sv_libcamera *s, Cam *c) {
  sv_err err;
  sv_camera_caps before = c->caps;
  c->retry_ns = now(s) + RETRY_NS;
  auto camera = s->manager->get(c->id);
  if (!camera) return;
  // a camera that is present but unusable makes libcamera log at each attempt
  c->retry_ns = now(s) + LATER_RETRY_NS;
  sv_status r = sv_libcamera_attach(s, c, std::move(camera), &err);
  c->caps = before; // the caps given to the runtime must not change
  if (r == SV_E_RANGE && !c->is_wrong) {
    c->is_wrong = true;
    sv_camera_events_add(&s->events, SV_CAMERA_WRONG_SIZE, c->i_camera, now(s),
                         static_cast<int64_t>(before.width_px) << 16 | before.height_px);
  }
  if (r < 0) return;
  if (stream_on(s, c) < 0) {
    sv_libcamera_detach(c);
    return;
  }
  c->is_lost = false;
  c->n_restarts++;
  sv_camera_events_add(&s->events, SV_CAMERA_RESTARTED, c->i_camera, now(s),
                       static_cast<int64_t>(c->n_restarts));
}

// A busy host does not count as a stall: its frames are waiting.
static void mind_absence(sv_libcamera *s) {
  sv_ns t_ns = now(s), gap_ns = t_ns - s->looked_ns;
  for (auto &c : s->cams)
    if (gap_ns > MAX_GAP_NS) c->last_frame_ns += gap_ns - MAX_GAP_NS;
  s->looked_ns = t_ns;
}

static void service(sv_libcamera *s, Cam *c) {
  sv_ns t_ns = now(s);
  bool is_gone, is_hungry = true, has_frame = false;
  {
    std::lock_guard<std::mutex> lock(s->mutex);
    is_gone = c->is_gone;
    for (const Slot &slot : c->slots) has_frame = has_frame || slot.state == RequestState::Done;
    for (const Slot &slot : c->slots)
      is_hungry = is_hungry && (slot.state == RequestState::OnLoan || slot.state == RequestState::Empty ||
                                slot.state == RequestState::Orphan);
  }
  if (is_gone && !c->is_lost) lose(s, c);
  if (c->is_lost) {
    if (t_ns >= c->retry_ns) reopen(s, c);
    return;
  }
  if (is_hungry) {
    if (!c->is_starved) sv_camera_events_starved(&s->events, c->i_camera, t_ns);
    c->is_starved = true;
    c->last_frame_ns = t_ns;
    return;
  }
  c->is_starved = false;
  if (has_frame || t_ns - c->last_frame_ns <= s->cfg.stall_ns) return;
  sv_camera_events_add(&s->events, SV_CAMERA_STALLED, c->i_camera, t_ns, t_ns - c->last_frame_ns);
  stream_off(c);
  c->n_restarts++;
  sv_camera_events_add(&s->events, SV_CAMERA_RESTARTED, c->i_camera, t_ns,
                       static_cast<int64_t>(c->n_restarts));
  if (stream_on(s, c) < 0) lose(s, c);
}

static void give_back(sv_libcamera *s, Cam *c, Slot *slot) {
  if (!c->is_streaming || c->is_lost) {
    std::lock_guard<std::mutex> lock(s->mutex);
    slot->state = RequestState::Idle;
    return;
  }
  slot->request->reuse(Request::ReuseBuffers);
  if (queue(c, slot) < 0) lose(s, c);
}

// The crop that was applied; the rig was fitted to the one that was asked for.
static void note_crop(Cam *c, const Rectangle &got) {
  const Rectangle &want = c->crop;
  const int off = std::abs(got.x - want.x) + std::abs(got.y - want.y) +
                  std::abs(static_cast<int>(got.width) - static_cast<int>(want.width)) +
                  std::abs(static_cast<int>(got.height) - static_cast<int>(want.height));
  if (!c->has_crop || off <= MAX_CROP_OFF_PX || c->is_crop_told) return;
  c->is_crop_told = true; // once
  sv_camera_events_add(&c->owner->events, SV_CAMERA_CONTROL, c->i_camera, now(c->owner),
                       controls::ScalerCrop.id());
}

// Records the values of the automatic controls and the state of rpi.sync.
static void note_metadata(Cam *c, const ControlList &m) {
  if (auto v = m.get(controls::ExposureTime)) c->exposure_us = *v;
  if (auto v = m.get(controls::AnalogueGain)) c->gain = *v;
  if (auto v = m.get(controls::ColourGains)) {
    c->white = {(*v)[0], (*v)[1]};
    c->has_white = true;
  }
  if (auto v = m.get(controls::ScalerCrop)) note_crop(c, *v);
  unsigned id = c->owner->sync_ready_id;
  if (id && m.contains(id) && m.get(id).type() == ControlTypeBool && m.get(id).get<bool>())
    c->is_synced = true;
}

// The exposure time of a frame: as told, else as its request asked for.
static void tell_exposure(const Cam *c, const Slot &slot, sv_frame *f) {
  const auto told = slot.request->metadata().get(controls::ExposureTime);
  const bool is_bracketed = c->owner->cfg.n_brackets > 0;
  const int32_t us = told ? *told : is_bracketed ? slot.asked_us : c->exposure_us;
  f->exposure_ns = static_cast<sv_ns>(us) * 1000;
  f->is_unsettled = is_bracketed && us <= 0;
}

// False: do not deliver the frame (a start-up frame, or rpi.sync is not ready).
static bool fill_frame(sv_libcamera *s, Cam *c, int i_slot, sv_frame *f) {
  Slot &slot = c->slots[static_cast<size_t>(i_slot)];
  const FrameMetadata &fm = slot.buffer->metadata();
  const ControlList &m = slot.request->metadata();
  note_metadata(c, m);
  if (is_startup_frame(fm) || !c->is_synced) return false;
  std::memset(f, 0, sizeof *f);
  f->i_camera = c->i_camera;
  f->sequence = fm.sequence;
  auto stamp = m.get(controls::SensorTimestamp);
  f->camera_ns = stamp ? *stamp : static_cast<sv_ns>(fm.timestamp);
  f->arrival_ns = slot.arrival_ns;
  tell_exposure(c, slot, f);
  f->width_px = c->caps.width_px;
  f->height_px = c->caps.height_px;
  f->stride_bytes = c->stride_bytes;
  f->format = c->caps.format;
  f->data = slot.plane[0];
  size_t used = 0;
  for (const auto &p : fm.planes()) used += p.bytesused;
  f->data_bytes = used < slot.cap_bytes[0] ? used : slot.cap_bytes[0];
  if (f->format == SV_PIX_NV12 && slot.plane[1]) {
    f->chroma = slot.plane[1];
    f->chroma_stride_bytes = f->stride_bytes;
  }
  f->i_buffer = i_slot;
  f->is_error = fm.status != FrameMetadata::FrameSuccess;
  sv_camera_event_kind kind = SV_CAMERA_DAMAGED;
  size_t least = sv_libcamera_plane_bytes(c, f->height_px);
  if (f->format == SV_PIX_NV12) least += sv_libcamera_plane_bytes(c, (f->height_px + 1) / 2);
  int w = 0, h = 0;
  bool has_end = false, is_jpeg = f->format == SV_PIX_JPEG;
  if (!f->is_error && is_jpeg) {
    bool is_read = sv_camera_jpeg_look(f->data, f->data_bytes, &w, &h, &has_end);
    if (is_read && (w != f->width_px || h != f->height_px)) kind = SV_CAMERA_WRONG_SIZE;
    else kind = SV_CAMERA_SHORT_FRAME;
    f->is_error = !is_read || !has_end || kind == SV_CAMERA_WRONG_SIZE;
  } else if (!f->is_error && used < least) {
    f->is_error = true;
    kind = SV_CAMERA_SHORT_FRAME;
  }
  if (f->is_error) sv_camera_events_add(&s->events, kind, f->i_camera, f->arrival_ns, f->sequence);
  return true;
}

static bool take_oldest(sv_libcamera *s, Cam **cam, int *i_slot) {
  sv_ns oldest_ns = INT64_MAX;
  *cam = nullptr;
  std::lock_guard<std::mutex> lock(s->mutex);
  for (auto &c : s->cams)
    for (size_t i = 0; i < c->slots.size(); i++)
      if (c->slots[i].state == RequestState::Done && c->slots[i].arrival_ns < oldest_ns) {
        oldest_ns = c->slots[i].arrival_ns;
        *cam = c.get();
        *i_slot = static_cast<int>(i);
      }
  if (!*cam) return false;
  (*cam)->slots[static_cast<size_t>(*i_slot)].state = RequestState::OnLoan;
  return true;
}

// Waits for a completion, at most 50 ms: stalls are checked in between.
static void wait_for_any(sv_libcamera *s, sv_ns until_ns) {
  sv_ns ns = until_ns - now(s);
  ns = ns < 0 ? 0 : ns > 50 * SV_NS_PER_MS ? 50 * SV_NS_PER_MS : ns;
  std::unique_lock<std::mutex> lock(s->mutex);
  for (auto &c : s->cams) {
    if (c->is_gone && !c->is_lost) return;
    if (c->is_lost && c->retry_ns < until_ns && ns > 10 * SV_NS_PER_MS) ns = 10 * SV_NS_PER_MS;
    for (const Slot &slot : c->slots)
      if (slot.state == RequestState::Done) return;
  }
  s->arrived.wait_for(lock, std::chrono::nanoseconds(ns));
}

static sv_status source_dequeue(void *self, sv_frame *f, sv_ns until_ns) {
  auto *s = static_cast<sv_libcamera *>(self);
  std::memset(f, 0, sizeof *f);
  f->i_camera = f->i_buffer = -1;
  if (!s->is_running) return SV_END;
  for (bool is_last = false;;) {
    mind_absence(s);
    for (auto &c : s->cams) {
      service(s, c.get());
      if (!c->has_failed) continue;
      c->has_failed = false;
      f->i_camera = c->i_camera;
      return SV_E_DEVICE;
    }
    Cam *c;
    int i_slot = 0;
    while (take_oldest(s, &c, &i_slot)) {
      c->last_frame_ns = now(s);
      if (c->is_away) {
        c->is_away = false;
        sv_camera_events_add(&s->events, SV_CAMERA_RETURNED, c->i_camera, now(s), now(s) - c->lost_ns);
      }
      if (fill_frame(s, c, i_slot, f)) return SV_OK;
      give_back(s, c, &c->slots[static_cast<size_t>(i_slot)]);
    }
    if (is_last) return SV_AGAIN;
    wait_for_any(s, until_ns);
    is_last = now(s) >= until_ns;
  }
}

static sv_status source_requeue(void *self, const sv_frame *f) {
  auto *s = static_cast<sv_libcamera *>(self);
  if (f->i_camera < 0 || f->i_camera >= static_cast<int>(s->cams.size())) return SV_E_ARG;
  Cam *c = s->cams[static_cast<size_t>(f->i_camera)].get();
  if (f->i_buffer < 0 || f->i_buffer >= static_cast<int>(c->slots.size())) return SV_E_ARG;
  Slot *slot = &c->slots[static_cast<size_t>(f->i_buffer)];
  {
    std::lock_guard<std::mutex> lock(s->mutex);
    if (slot->state == RequestState::Orphan) {
      sv_libcamera_free_slot(slot);
      return SV_OK;
    }
    if (slot->state != RequestState::OnLoan) return SV_E_ARG; // returned twice, or never delivered
  }
  give_back(s, c, slot);
  return SV_OK;
}

static sv_status source_stop(void *self) {
  auto *s = static_cast<sv_libcamera *>(self);
  if (s->is_triggered && s->is_running) s->cfg.trigger.stop(s->cfg.trigger.self);
  for (auto &c : s->cams) {
    stream_off(c.get());
    std::lock_guard<std::mutex> lock(s->mutex);
    for (Slot &slot : c->slots) {
      if (slot.state == RequestState::Orphan) sv_libcamera_free_slot(&slot);
      else if (slot.state != RequestState::Empty) slot.state = RequestState::Idle;
    }
    c->has_failed = false;
  }
  s->is_running = false;
  return SV_OK;
}

// Lets the automatic controls settle on the scene, then fixes their values.
static void settle(sv_libcamera *s) {
  sv_ns end_ns = now(s) + s->cfg.settle_ns;
  bool has_auto = false;
  for (auto &c : s->cams)
    has_auto = has_auto || has(c.get(), controls::AeEnable) || has(c.get(), controls::AwbEnable);
  while (has_auto && now(s) < end_ns) {
    sv_frame f;
    if (source_dequeue(s, &f, end_ns) == SV_OK) (void)source_requeue(s, &f);
  }
  for (auto &c : s->cams) {
    c->must_lock = has_auto || s->cfg.n_brackets;
    if (s->cfg.n_brackets) c->locked_us = locked_us(c.get());
  }
}

static sv_status source_start(void *self) {
  auto *s = static_cast<sv_libcamera *>(self);
  int n_started = 0;
  if (s->is_running) return SV_E_ARG;
  for (auto &c : s->cams) {
    c->n_restarts = 0;
    c->is_away = c->is_lost;
    if (!c->is_lost && stream_on(s, c.get()) >= 0) n_started++;
    else lose(s, c.get());
  }
  s->is_running = true;
  s->looked_ns = now(s);
  if (!n_started) {
    (void)source_stop(s);
    return SV_E_DEVICE;
  }
  if (s->is_triggered && s->cfg.trigger.start(s->cfg.trigger.self) < 0) {
    (void)source_stop(s);
    return SV_E_DEVICE;
  }
  if (!s->cfg.is_unlocked && (s->cfg.settle_ns > 0 || s->cfg.n_brackets)) settle(s);
  return SV_OK;
}

// libcamera shows no control of the sensor that would make it wait: that is a parameter of its
// driver, set where the line is opened.
static sv_status source_trigger(void *self, bool is_external) {
  auto *s = static_cast<sv_libcamera *>(self);
  if (s->is_running) return SV_E_ARG;
  s->is_triggered = false;
  if (!is_external) return SV_OK;
  const sv_trigger *line = s->cfg.trigger.line;
  if (line->kind == SV_LINE_NONE) return SV_E_UNSUPPORTED;
  if (line->mode[0] && !std::strchr(line->mode, '.')) {
    sv_camera_events_add(&s->events, SV_CAMERA_TRIGGER, 0, now(s), -ENOENT);
    return SV_E_UNSUPPORTED;
  }
  s->is_triggered = true;
  return SV_OK;
}

static sv_status source_caps(void *self, int i, sv_camera_caps *out) {
  auto *s = static_cast<sv_libcamera *>(self);
  if (i < 0 || i >= static_cast<int>(s->cams.size())) return SV_E_ARG;
  *out = s->cams[static_cast<size_t>(i)]->caps;
  out->is_light_locked = !s->cfg.is_unlocked && !s->cfg.n_brackets;
  out->n_brackets = s->cfg.n_brackets;
  out->is_light_shared = sv_camera_is_light_shared(&s->cfg);
  out->is_exposure_told = !s->cfg.is_unlocked;
  return SV_OK;
}

static sv_status source_event(void *self, sv_camera_event *e) {
  return sv_camera_events_pop(&static_cast<sv_libcamera *>(self)->events, e);
}

static sv_status source_control(void *self, int i, sv_control control, int64_t value, int64_t *actual) {
  auto *s = static_cast<sv_libcamera *>(self);
  if (i < 0 || i >= static_cast<int>(s->cams.size())) return SV_E_ARG;
  Cam *c = s->cams[static_cast<size_t>(i)].get();
  if (!c->camera) return SV_E_DEVICE;
  // Exposure and gain are fixed at the start: changing them breaks rpi.sync.
  if (control != SV_CONTROL_FRAME_DURATION_NS) return SV_E_UNSUPPORTED;
  const ControlInfoMap &m = c->camera->controls();
  auto limits = m.find(&controls::FrameDurationLimits);
  if (limits == m.end()) return SV_E_UNSUPPORTED;
  int64_t us = (value + 500) / 1000;
  if (us < 1 || us < limits->second.min().get<int64_t>() || us > limits->second.max().get<int64_t>())
    return SV_E_RANGE;
  c->frame_us = us;
  if (actual) *actual = us * 1000;
  return SV_OK;
}

extern "C" sv_source sv_libcamera_source(sv_libcamera *s) {
  sv_source source = {};
  source.self = s;
  source.n_cameras = static_cast<int>(s->cams.size());
  source.caps = source_caps;
  source.start = source_start;
  source.dequeue = source_dequeue;
  source.requeue = source_requeue;
  source.stop = source_stop;
  source.event = source_event;
  source.set_control = source_control;
  source.trigger = s->cfg.trigger.start ? source_trigger : nullptr;
  return source;
}
