// SPDX-License-Identifier: Apache-2.0
// The C++ shim over libcamera, 0.0.3 to current: what its two files share.
#pragma once

#include <libcamera/libcamera.h>
#include <libcamera/version.h>

#include <array>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "platform/libcamera/libcamera.h"

// --- releases ------------------------------------------------------------------------------------
#define SV_LIBCAMERA_SINCE(a, b, c)                                                                          \
  (LIBCAMERA_VERSION_MAJOR * 10000 + LIBCAMERA_VERSION_MINOR * 100 + LIBCAMERA_VERSION_PATCH >=              \
   (a)*10000 + (b)*100 + (c))

// Frames that the sensor delivers before its settings have taken effect.
inline bool is_startup_frame(const libcamera::FrameMetadata &m) {
#if SV_LIBCAMERA_SINCE(0, 5, 2)
  return m.status == libcamera::FrameMetadata::FrameStartup;
#else
  (void)m;
  return false;
#endif
}

using libcamera::Camera;
using libcamera::CameraConfiguration;
using libcamera::CameraManager;
using libcamera::FrameBuffer;
using libcamera::FrameBufferAllocator;
using libcamera::Request;
using libcamera::Stream;

// --- one camera ----------------------------------------------------------------------------------
// Orphan: on loan from a camera that is gone; only its images remain.
enum class RequestState { Empty, Idle, Queued, Done, OnLoan, Orphan };

struct Mapping {
  uint8_t *p = nullptr;
  size_t bytes = 0;
};

struct Slot {
  std::unique_ptr<Request> request;
  FrameBuffer *buffer = nullptr;
  std::array<Mapping, 3> maps; // one per descriptor
  std::array<uint8_t *, 3> plane = {};
  std::array<size_t, 3> cap_bytes = {}; // of each plane, up to the end of its mapping
  RequestState state = RequestState::Empty;
  int32_t asked_us = 0; // exposure time of a bracket, which its frame should have; 0: not asked for
  sv_ns arrival_ns = 0;
};

struct Cam {
  int i_camera = 0;
  sv_libcamera *owner = nullptr;
  std::shared_ptr<Camera> camera;
  std::unique_ptr<CameraConfiguration> config;
  std::optional<FrameBufferAllocator> allocator;
  // frames from before a fault may still be on loan
  std::array<Slot, 2 * SV_CAMERA_CAP_BUFFERS> slots;
  std::string id; // identifies the camera after a fault
  // negotiated, with the size in caps; -1: not yet
  int i_format = -1;
  Stream *stream = nullptr;
  sv_camera_caps caps = {};
  int stride_bytes = 0;
  bool is_streaming = false, is_lost = false, has_failed = false, is_gone = false, is_starved = false;
  bool is_away = false;  // lost, and has not delivered since
  bool is_wrong = false; // came back with another format; reported once
  sv_ns lost_ns = 0, retry_ns = 0;
  int64_t frame_us = 0;    // length of its frames, for the next request
  bool is_synced = true;   // rpi.sync has said so, or is off
  bool must_lock = false;  // the next request carries the locked values
  int32_t exposure_us = 0; // of the newest frame that told it
  int32_t locked_us = 0;   // with brackets: what they are factors of, once it is known
  int i_bracket = 0;       // of the next request
  float gain = 0;
  std::array<float, 2> white = {};
  bool has_white = false;
  libcamera::Rectangle crop; // with has_crop: of the sensor, set when it starts
  bool has_crop = false, is_crop_told = false;
  sv_ns last_frame_ns = 0;
  uint64_t n_restarts = 0;

  void requestDone(Request *request);
  void disconnected();
};

struct sv_libcamera {
  std::unique_ptr<CameraManager> manager;
  sv_camera_options cfg = {};
  sv_clock clock = {};
  std::vector<std::unique_ptr<Cam>> cams;
  bool is_running = false;
  bool is_triggered = false;                    // the cameras expose on the pulses of cfg.trigger
  sv_ns looked_ns = 0;                          // last dequeue
  unsigned sync_mode_id = 0, sync_ready_id = 0; // of rpi.sync; 0: this libcamera has none
  sv_camera_events events = {};
  std::mutex mutex; // of the slots' states and arrivals, and of is_gone
  std::condition_variable arrived;
};

// Opens a camera as configured, or as negotiated before. On failure it is released.
sv_status sv_libcamera_attach(sv_libcamera *s, Cam *c, std::shared_ptr<Camera> camera, sv_err *err);
// Releases the camera; frames on loan become orphans, whose images stay valid.
void sv_libcamera_detach(Cam *c);
void sv_libcamera_free_slot(Slot *slot);
size_t sv_libcamera_plane_bytes(const Cam *c, int rows); // up to the last pixel of the last row

inline sv_ns now(const sv_libcamera *s) { return s->clock.now_ns(s->clock.self); }
inline sv_rpi_sync sync_of(const Cam *c) {
  const sv_camera_options &o = c->owner->cfg;
  return o.n_sync ? o.sync[c->i_camera] : SV_RPI_SYNC_OFF;
}
inline bool has(const Cam *c, const libcamera::ControlId &id) {
  const libcamera::ControlInfoMap &m = c->camera->controls();
  return m.find(id.id()) != m.end();
}
