// SPDX-License-Identifier: Apache-2.0
// One camera of the V4L2 source (inside of platform/v4l2).
#ifndef SV_PLATFORM_V4L2_CAMERA_H
#define SV_PLATFORM_V4L2_CAMERA_H

#include "platform/v4l2/v4l2.h"

#ifdef __cplusplus
extern "C" {
#endif

// frames from before a fault may still be on loan
#define SV_V4L2_CAP_SLOTS    (2 * SV_CAMERA_CAP_BUFFERS)
#define SV_V4L2_CAP_CONTROLS 16

typedef enum {
  SV_V4L2_EMPTY = 0, // no memory
  SV_V4L2_IDLE,      // mapped, in user space
  SV_V4L2_QUEUED,    // with the driver
  SV_V4L2_WAITING,   // filled, not yet delivered
  SV_V4L2_ON_LOAN,
  SV_V4L2_ORPHAN // on loan from a device that is closed
} sv_v4l2_slot_state;

#define SV_V4L2_CAP_PLANES 2
typedef struct {
  uint8_t *map[SV_V4L2_CAP_PLANES];
  size_t bytes[SV_V4L2_CAP_PLANES];
  sv_v4l2_slot_state state;
  uint32_t index; // the driver's number
  int dma_fd;     // -1: not exported
} sv_v4l2_slot;

typedef struct {
  uint32_t id;
  int32_t before, locked; // values found at open, and while the cameras run
  bool is_changed;
} sv_v4l2_control;

struct sv_v4l2_camera {
  const sv_v4l2_sys *sys;
  const sv_camera_options *cfg;
  sv_camera_events *events;
  int i_camera, fd; // -1: closed
  char path[SV_CAMERA_CAP_NAME];
  char card[32], bus[32]; // identify the camera after a fault
  bool is_mplane;
  uint32_t buf_type, fourcc;
  sv_camera_caps caps;
  int n_planes;
  int stride_bytes, chroma_stride_bytes;  // the second for two planes
  size_t image_bytes;                     // the driver's size of a buffer
  bool is_streaming, is_lost, has_failed; // has_failed: not yet reported by dequeue
  sv_ns lost_ns, retry_ns, last_frame_ns;
  int n_retries, n_stalls;
  bool is_wrong; // came back with another format; reported once
  bool is_starved;
  sv_v4l2_slot slot[SV_V4L2_CAP_SLOTS];
  bool has_waiting;
  sv_frame waiting;
  bool has_last;
  uint32_t last_driver_sequence, n_uncounted;
  sv_ns last_camera_ns;
  int n_controls;
  sv_v4l2_control control[SV_V4L2_CAP_CONTROLS];
  sv_ns exposure_ns; // locked shutter time, 0: unknown
  // of brackets: the shutter time that they are factors of, 0 until it is locked; when the last
  // change was asked for, 0: never, and from when frames have it; the same before that change
  sv_ns base_ns, asked_ns, settled_ns, before_ns, before_settled_ns;
  bool is_bracket_told; // that it did not do as it was told
  bool is_locked;
  const bool *is_triggered; // of the source: the trigger's mode is set before it streams
  sv_v4l2_stats stats;
};

// device.c: open, negotiate the format, map the buffers. On failure everything is closed.
sv_status sv_v4l2_open_device(sv_v4l2_camera *c, sv_err *err) SV_MUST_USE;
// Closes; buffers on loan become orphans, whose content stays.
void sv_v4l2_close_device(sv_v4l2_camera *c);
void sv_v4l2_free_slot(sv_v4l2_camera *c, sv_v4l2_slot *s);
int sv_v4l2_call(const sv_v4l2_camera *c, unsigned long request, void *arg);

// signal.c: inputs that have a signal of their own (HDMI): its timings set the size.
sv_status sv_v4l2_follow_signal(sv_v4l2_camera *c, sv_err *err) SV_MUST_USE;
void sv_v4l2_want_events(sv_v4l2_camera *c);
// Handles driver events; a camera whose signal has changed is closed and opened again.
void sv_v4l2_take_events(sv_v4l2_camera *c, sv_ns now_ns);

// stream.c
int sv_v4l2_stream_on(sv_v4l2_camera *c); // queues what is idle; 0 or a negative error number
void sv_v4l2_stream_off(sv_v4l2_camera *c);
int sv_v4l2_queue(sv_v4l2_camera *c, sv_v4l2_slot *s);
// Moves one filled buffer to c->waiting. 1: done; 0: none is ready; else a negative error number.
int sv_v4l2_take(sv_v4l2_camera *c, sv_ns now_ns);
int sv_v4l2_n_queued(const sv_v4l2_camera *c);
void sv_v4l2_fault(sv_v4l2_camera *c, int error, sv_ns now_ns); // closes it; it will be retried
void sv_v4l2_service(sv_v4l2_camera *c, sv_ns now_ns);          // retries and checks for stalls

// controls.c
bool sv_v4l2_has_auto(const sv_v4l2_camera *c); // an automatic control is active
// Switches the automatic controls off and sets what the options fix. First: records the previous
// values.
void sv_v4l2_lock_controls(sv_v4l2_camera *c, sv_ns now_ns);
// After both were locked: the gain and white balance of `from`, and its exposure time over the
// relative response. Exposures in lines are taken as they are: frames do not tell their time.
void sv_v4l2_share_controls(sv_v4l2_camera *c, const sv_v4l2_camera *from, sv_ns now_ns);
void sv_v4l2_restore_controls(sv_v4l2_camera *c);
// The control that makes the camera wait for the trigger's pulses, where the trigger has one; it is
// restored with the others. 0, or a negative error number: -ENOENT there is no such control.
int sv_v4l2_set_trigger_mode(sv_v4l2_camera *c);
sv_status sv_v4l2_set_exposure(sv_v4l2_camera *c, int64_t ns, int64_t *actual_ns);
// The exposure time that is nearest to ns, within the control's range.
sv_ns sv_v4l2_possible_exposure(const sv_v4l2_camera *c, sv_ns ns);
int64_t sv_v4l2_exposure_id(void); // of that control, for events
// Time for all lines of a frame, by V4L2_CID_HBLANK and V4L2_CID_PIXEL_RATE; 0: not told.
sv_ns sv_v4l2_readout_ns(const sv_v4l2_camera *c);
// Length of the frames from now on, by the sensor's blanking lines or, where there are none, by the
// frame interval.
sv_status sv_v4l2_set_frame_duration(sv_v4l2_camera *c, int64_t ns, int64_t *actual_ns);
// whether the options can be applied
sv_status sv_v4l2_check_controls(const sv_v4l2_camera *c, sv_err *err);
// Whether a camera can take the values of another one.
sv_status sv_v4l2_check_shared(const sv_v4l2_camera *c, const sv_v4l2_camera *from, sv_err *err);

// brackets.c: after the cameras were locked; when frames are asked for; each frame's exposure time.
void sv_v4l2_begin_brackets(sv_v4l2 *v);
void sv_v4l2_turn_brackets(sv_v4l2 *v, sv_ns now_ns);
void sv_v4l2_tell_exposure(const sv_v4l2_camera *c, sv_frame *f);

// A format's description for one node, of one API or the other.
typedef struct {
  uint32_t fourcc, width_px, height_px, stride_bytes, image_bytes;
  uint32_t encoding, quantization, n_planes;
  uint32_t stride1_bytes; // of the second plane
} sv_v4l2_fmt;
int sv_v4l2_get_fmt(const sv_v4l2_camera *c, sv_v4l2_fmt *f);
int sv_v4l2_try_fmt(const sv_v4l2_camera *c, sv_v4l2_fmt *f, bool is_set);
// Highest frame rate at a format and size; 0: unknown.
double sv_v4l2_max_fps(const sv_v4l2_camera *c, uint32_t fourcc, int width_px, int height_px);

#ifdef __cplusplus
}
#endif
#endif
