// SPDX-License-Identifier: Apache-2.0
// Cameras behind Linux's V4L2 as one source. Frames are the driver's own buffers, mapped once (no
// copy, no heap); they stay readable until requeue, also when their camera is unplugged meanwhile.
// A camera that fails (POLLERR, ENODEV, EIO, silence) is closed and opened again by itself, every
// 50 ms or frame, while the others run on; what happened is told by the source's events. Exposure,
// gain and white balance are locked at start (lock=shared: all cameras at the values of the first)
// and restored at close. Of brackets the exposure time changes; frames in between are delivered as
// unsettled.
#ifndef SV_PLATFORM_V4L2_V4L2_H
#define SV_PLATFORM_V4L2_V4L2_H

#include "platform/camera/options.h"
#include "platform/v4l2/sys.h"
#include "src/base/arena.h"
#include "src/base/str.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  uint64_t n_frames, n_errors; // delivered; of these with is_error
  uint64_t n_lost, n_restarts; // times that the device was lost, that its stream was started again
} sv_v4l2_stats;

typedef struct sv_v4l2_camera sv_v4l2_camera;
typedef struct {
  sv_camera_options cfg;
  sv_v4l2_sys sys;
  sv_clock clock;
  sv_v4l2_camera *cameras; // [n_cameras]
  int n_cameras;
  bool is_running, is_settled; // settled: the controls are locked
  bool is_triggered;           // the cameras expose on the pulses of cfg.trigger
  sv_ns looked_ns;             // when somebody last asked for frames
  int i_bracket;               // the exposure time that the cameras have now
  sv_ns turn_ns;               // when they get the next one
  sv_camera_events events;
} sv_v4l2;

// Opens all cameras, agrees on formats and maps buffers. `self` must not move afterwards. clock:
// CLOCK_MONOTONIC. E_NOT_FOUND, E_UNSUPPORTED, E_RANGE, E_DEVICE with a sentence; everything is
// closed then.
sv_status sv_v4l2_init(sv_v4l2 *self, const sv_camera_options *cfg, const sv_v4l2_sys *sys,
                       const sv_clock *clock, sv_arena *arena, sv_err *err) SV_MUST_USE;
void sv_v4l2_close(sv_v4l2 *self);
sv_source sv_v4l2_source(sv_v4l2 *self);
// NULL: no such camera
const sv_v4l2_stats *sv_v4l2_camera_stats(const sv_v4l2 *self, int i_camera);
// DMABUF descriptor of a frame on loan (option dmabuf=on), -1 when there is none. It stays the
// source's. Bracket accesses by the CPU with DMA_BUF_IOCTL_SYNC.
int sv_v4l2_dmabuf(const sv_v4l2 *self, const sv_frame *frame);

// A line a camera: its source string, name, formats, sizes and frame rates. Returns how many there
// are.
int sv_v4l2_list(sv_str *out, const sv_v4l2_sys *sys);

#ifdef __cplusplus
}
#endif
#endif
