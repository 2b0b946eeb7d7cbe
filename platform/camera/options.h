// SPDX-License-Identifier: Apache-2.0
// The options after "v4l2:" and "libcamera:": a list of cameras, then options, separated by commas.
//   size=WxH          frames of this size (default: the camera's current size)
//   format=FOURCC     pixel format by V4L2's name (YUYV, NV12, GREY, RG10, pRAA, MJPG, ...;
//                     default: the best)
//   fps=F             frames per second
//   buffers=N         frames of a camera that can be in use at once, 3..32 (8)
//   exposure=US       fixed shutter time, microseconds
//   gain=N            fixed gain, in the driver's units (V4L2) or as a factor (libcamera)
//   wb=K              fixed color temperature, kelvin
//   lock=on|shared|off    lock exposure, gain and white balance while they run (on: each camera at
//                     its own values; shared: all at those of the first camera, the exposure time
//                     over the camera's response, where that is known)
//   brackets=F:F[...] factors of the exposure time that frames get in turn, 2 to 4
//   bracket-delay=N   frames until a new exposure time is in effect, of V4L2 cameras (4)
//   settle=MS         time for the automatic controls to settle before the lock (500)
//   stall=MS          restart a camera that delivers no frame for this long (1000)
//   clock=camera|monotonic|boottime|realtime    clock of the timestamps (default: as the driver
//                                               says)
//   stamp=start|middle|end                      instant of the timestamps (default: as the driver
//                                               says)
//   black=N red=F blue=F    of raw sensors: black level in samples, gains relative to green
//   light=linear|display    whether samples are linear light (Bayer) or display values (grey)
//   dmabuf=on|off     also export V4L2 buffers as DMABUF descriptors (off)
//   sync=off|server|client     libcamera's rpi.sync (off), a word for each camera with ':' between
//                              them. A single word is for all; of a single "server" the first
//                              camera is the server and the others are clients
#ifndef SV_PLATFORM_CAMERA_OPTIONS_H
#define SV_PLATFORM_CAMERA_OPTIONS_H

#include <stdbool.h>

#include "src/port/port.h"
#include "src/rig/trigger.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_CAMERA_CAP_CAMERAS 8
#define SV_CAMERA_CAP_BUFFERS 32
#define SV_CAMERA_CAP_NAME    128
#define SV_CAMERA_CAP_BRACKET 4

typedef enum { SV_RPI_SYNC_OFF = 0, SV_RPI_SYNC_SERVER, SV_RPI_SYNC_CLIENT } sv_rpi_sync;

// An external trigger, as a source uses it. `line` is filled in before the cameras start; its kind
// is NONE until then, and where there is no trigger. All NULL: none.
typedef struct {
  void *self;
  const sv_trigger *line;
  sv_status (*start)(void *self); // pulses, once all cameras stream
  void (*stop)(void *self);
} sv_camera_trigger;

typedef struct {
  int n_cameras;
  char name[SV_CAMERA_CAP_CAMERAS][SV_CAMERA_CAP_NAME]; // "/dev/video0"; "0" or libcamera's id
  int width_px, height_px;                              // 0: the camera's default
  char format[5];                                       // "": the best
  double fps;                                           // 0: the camera's default
  int n_buffers;
  sv_ns exposure_ns;           // 0: not given
  double gain;                 // negative: not given
  int white_k;                 // 0: not given
  bool is_unlocked, is_shared; // shared: all cameras get the values of the first
  sv_ns settle_ns, stall_ns;
  int n_brackets; // 0: the exposure time stays
  double bracket[SV_CAMERA_CAP_BRACKET];
  int n_bracket_delay; // frames
  bool has_clock, has_stamp, has_light;
  sv_clock_id clock;
  sv_stamp_source stamp;
  sv_raw_tone tone; // is_linear counts when has_light
  bool is_exported;
  int n_sync; // words of sync=; as many as cameras after parsing, or 0
  sv_rpi_sync sync[SV_CAMERA_CAP_CAMERAS];
  sv_camera_trigger trigger;
  // [n_cameras] green of grey light at the same exposure time and gain, relative to each other. It
  // is filled in before the cameras start. NULL: all alike.
  const float *response;
} sv_camera_options;

sv_camera_options sv_camera_defaults(void);
// `kind` ("v4l2") is for sentences. E_ARG with one.
sv_status sv_camera_parse(const char *kind, const char *spec, sv_camera_options *out,
                          sv_err *err) SV_MUST_USE;
// Whether all cameras have the same gain, white balance and, but for their responses, exposure time
// while they run: shared, or all given.
bool sv_camera_is_light_shared(const sv_camera_options *o);
// Exposure time of camera i over the first's with lock=shared, by their responses.
double sv_camera_exposure_share(const sv_camera_options *o, int i);
// Whether any camera takes part in rpi.sync.
bool sv_camera_has_sync(const sv_camera_options *o);
// The tone of a format under these options: Bayer samples are linear light by default.
sv_raw_tone sv_camera_tone(const sv_camera_options *o, sv_pixel_format f);

// --- events of cameras, a ring -------------------------------------------------------------------
#define SV_CAMERA_CAP_EVENTS 64
typedef struct {
  sv_camera_event event[SV_CAMERA_CAP_EVENTS];
  int i_first, n;
  uint64_t count[SV_N_CAMERA_EVENTS]; // since the start, including overwritten events
  uint64_t n_starved[SV_CAMERA_CAP_CAMERAS];
  sv_ns starved_ns[SV_CAMERA_CAP_CAMERAS]; // when it was reported last
} sv_camera_events;

void sv_camera_events_add(sv_camera_events *e, sv_camera_event_kind kind, int i_camera, sv_ns host_ns,
                          int64_t detail);
// Reports STARVED at most once a second: a busy reader would cause one per frame.
void sv_camera_events_starved(sv_camera_events *e, int i_camera, sv_ns host_ns);
// AGAIN: none
sv_status sv_camera_events_pop(sv_camera_events *e, sv_camera_event *out) SV_MUST_USE;

// Size of a baseline or progressive JPEG by its header, and whether its end marker is present.
// False: not a JPEG.
bool sv_camera_jpeg_look(const uint8_t *data, size_t bytes, int *width_px, int *height_px, bool *has_end);

#ifdef __cplusplus
}
#endif
#endif
