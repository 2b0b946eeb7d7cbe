// SPDX-License-Identifier: Apache-2.0
// Everything the runtime asks of a machine. The core owns this interface; platforms implement it.
// No call may allocate after the platform's start. Two ports may live in one process.
#ifndef SV_PORT_PORT_H
#define SV_PORT_PORT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "src/base/status.h"
#include "src/base/time.h"
#include "src/base/vec.h"

#ifdef __cplusplus
extern "C" {
#endif

// --- clock ---------------------------------------------------------------------------------------
typedef struct {
  void *self;
  sv_ns (*now_ns)(void *self);                       // host time, never steps back
  void (*sleep_until_ns)(void *self, sv_ns host_ns); // may return early; a virtual clock advances
} sv_clock;

// --- threads -------------------------------------------------------------------------------------
// A fixed pool made before the arena is sealed. `run` calls fn(arg, i_task, i_thread) once for each
// i_task in [0, n_tasks), in any order on any thread, and returns when all are done. i_thread is in
// [0, n_threads), unique among the calls that run at the same time (it picks a scratch arena; results
// must not depend on it).
typedef void (*sv_task_fn)(void *arg, int i_task, int i_thread);
typedef struct {
  void *self;
  int n_threads;
  void (*run)(void *self, sv_task_fn fn, void *arg, int n_tasks);
} sv_pool;

static inline void sv_pool_run(const sv_pool *p, sv_task_fn fn, void *arg, int n_tasks) {
  p->run(p->self, fn, arg, n_tasks);
}

// A pool without threads: runs the tasks in order on the caller.
sv_pool sv_pool_serial(void);

// --- cameras -------------------------------------------------------------------------------------
typedef enum {
  SV_PIX_NONE = 0,
  SV_PIX_GREY8, // 1 byte a pixel
  SV_PIX_RGB8,  // R,G,B
  SV_PIX_RGBA8, // R,G,B,A straight alpha
  SV_PIX_RGB16, // 3 x uint16 little endian, full range 0..65535
  SV_PIX_JPEG,  // one JPEG image, data_bytes long
  SV_PIX_PNG    // one PNG image, data_bytes long
} sv_pixel_format;

// Whose clock a timestamp is on, and what instant of the frame it names.
typedef enum { SV_CLOCK_CAMERA = 0, SV_CLOCK_MONOTONIC, SV_CLOCK_BOOTTIME, SV_CLOCK_REALTIME } sv_clock_id;
typedef enum { SV_STAMP_START = 0, SV_STAMP_MIDDLE, SV_STAMP_END } sv_stamp_source;

typedef struct {
  char name[48];
  int width_px, height_px;
  sv_pixel_format format;
  double fps;
  sv_clock_id clock;
  sv_stamp_source stamp;
  size_t frame_bytes; // the largest data_bytes of one frame
} sv_camera_caps;

// One frame, on loan until it is handed back with requeue. `data` belongs to the source.
typedef struct {
  int i_camera;
  uint32_t sequence; // counts the sensor's frames: a gap means the driver lost some
  sv_ns camera_ns;   // timestamp by the camera's own clock (caps.clock, caps.stamp)
  sv_ns arrival_ns;  // host time at which the frame came in
  sv_ns exposure_ns; // shutter time, 0 when unknown
  int width_px, height_px, stride_bytes;
  sv_pixel_format format;
  const uint8_t *data;
  size_t data_bytes;
  bool is_error; // the driver delivered it, but says that it is damaged
  int i_buffer;  // the source's own
} sv_frame;

// A set of cameras that run together. open/enumeration belong to the platform; the runtime gets this.
typedef struct {
  void *self;
  int n_cameras;
  sv_status (*caps)(void *self, int i_camera, sv_camera_caps *out);
  sv_status (*start)(void *self);
  // The next frame of any camera, oldest arrival first. AGAIN when none came before until_host_ns,
  // END when no more will ever come. A failure of one camera is E_DEVICE with frame->i_camera set;
  // the others go on.
  sv_status (*dequeue)(void *self, sv_frame *frame, sv_ns until_host_ns);
  sv_status (*requeue)(void *self, const sv_frame *frame);
  sv_status (*stop)(void *self);
  // Where the rig was at a host time, when the source knows (simulator, a capture with poses). NULL or
  // E_NOT_FOUND: unknown, the runtime then takes the rig as standing still (rig_from_world = identity).
  sv_status (*rig_pose)(void *self, sv_ns host_ns, sv_pose *rig_from_world);
} sv_source;

// --- store ---------------------------------------------------------------------------------------
// Files of one run in one folder, by name without separators. A save is atomic: either the whole new
// file is there or the old one.
typedef struct {
  void *self;
  sv_status (*begin)(void *self, const char *name, sv_err *err); // one file at a time
  sv_status (*write)(void *self, const void *data, size_t bytes, sv_err *err);
  sv_status (*commit)(void *self, sv_err *err);
  void (*abandon)(void *self);
  // Reads a whole file into buf; *bytes is its size. E_NOT_FOUND, E_NOMEM (larger than cap), E_IO.
  sv_status (*read)(void *self, const char *name, void *buf, size_t cap, size_t *bytes, sv_err *err);
} sv_store;

// --- log and stop request ------------------------------------------------------------------------
typedef enum { SV_LOG_ERROR, SV_LOG_WARN, SV_LOG_INFO, SV_LOG_LIVE } sv_log_level; // LIVE overwrites itself
typedef struct {
  void *self;
  void (*log)(void *self, sv_log_level level, const char *line);
  bool (*is_stop_requested)(void *self); // Ctrl-C
} sv_console;

// --- publish -------------------------------------------------------------------------------------
// What the person in front of the rig asks for, from the page of a live preview.
typedef enum {
  SV_COMMAND_NONE = 0,
  SV_COMMAND_START, // also: go on after a pause
  SV_COMMAND_PAUSE,
  SV_COMMAND_SAVE,
  SV_COMMAND_NEW
} sv_command;

typedef struct {
  double temperature_c; // of the processor; NaN: not known
  int is_throttled;     // 1: it is slowed down for heat or power now; -1: not known
} sv_health;

// Where a live preview picks its pictures up. Never blocks. rgb: [height][width][3] display values.
struct sv_feed;
typedef struct {
  void *self;
  void (*image)(void *self, const char *name, int width_px, int height_px, const uint8_t *rgb);
  struct sv_feed *feed;              // src/port/feed.h; NULL: no live preview
  sv_command (*command)(void *self); // the next one, NONE when there is none; may be NULL
  sv_health (*health)(void *self);   // may be NULL
} sv_publish;

typedef struct {
  sv_clock clock;   // the cameras' host time; virtual in the simulator and in a replay at full speed
  sv_clock machine; // real time, for budgets and timings
  sv_pool pool;
  sv_source source;
  sv_store store;
  sv_console console;
  sv_publish publish; // image may be NULL
} sv_port;

#ifdef __cplusplus
}
#endif
#endif
