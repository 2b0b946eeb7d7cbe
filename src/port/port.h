// SPDX-License-Identifier: Apache-2.0
// The port: everything that the runtime asks of a machine. The core owns these interfaces;
// platforms implement them. Owns the types only. Two ports may live in one process.
// No call may allocate after the platform's start.
#ifndef SV_PORT_PORT_H
#define SV_PORT_PORT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "src/base/area.h"
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
// [0, n_threads), unique among the calls that run at the same time (it picks a scratch arena;
// results must not depend on it).
typedef void (*sv_task_fn)(void *arg, int i_task, int i_thread);
typedef struct {
  void *self;
  int n_threads;
  void (*run)(void *self, sv_task_fn fn, void *arg, int n_tasks);
} sv_pool;

static inline void sv_pool_run(const sv_pool *p, sv_task_fn fn, void *arg, int n_tasks) {
  p->run(p->self, fn, arg, n_tasks);
}

// First task of thread k's share. A thread works through its share in rising order, then takes
// tasks from the ends of the others' shares. Neighbouring tasks, and the same tasks of the next
// job, thus find their data in one core's cache.
static inline int sv_pool_share(int n_tasks, int k, int n_threads) {
  return (int)(((int64_t)n_tasks * k + n_threads - 1) / n_threads);
}

// One more thread beside the pool, for the cameras. start may be NULL: there is none.
typedef struct {
  void *self;
  sv_status (*start)(void *self, void (*fn)(void *arg), void *arg); // one fn at a time
  void (*join)(void *self);                                         // returns when fn has returned
} sv_worker;

// A pool without threads: runs the tasks in order on the caller.
sv_pool sv_pool_serial(void);

// --- cameras -------------------------------------------------------------------------------------
typedef enum {
#define X(NAME, name, layout, bits, container_bits, phase) SV_PIX_##NAME,
#include "src/port/pixel.inc"
#undef X
  SV_N_PIXEL_FORMATS
} sv_pixel_format;

typedef enum {
  SV_LAYOUT_NONE = 0,
  SV_LAYOUT_CODED, // compressed
  SV_LAYOUT_GREY,
  SV_LAYOUT_RGB,
  SV_LAYOUT_BGR,
  SV_LAYOUT_RGBX,
  SV_LAYOUT_BGRX,
  SV_LAYOUT_YUYV,
  SV_LAYOUT_UYVY,
  SV_LAYOUT_NV12,
  SV_LAYOUT_BAYER
} sv_pixel_layout;

typedef struct {
  const char *name; // "rggb10p"
  sv_pixel_layout layout;
  int bits, container_bits, phase; // see pixel.inc
} sv_pixel_info;

// The entry of NONE for a number that is not in the list.
const sv_pixel_info *sv_pixel(sv_pixel_format f);
// Bytes of n pixels that begin at an even pixel (packed formats: at a multiple of four). NV12: of
// one plane. 0 for compressed formats.
size_t sv_pixel_row_bytes(sv_pixel_format f, int n_px);
// Bytes of a whole frame without padding, including the chroma plane; 0 for compressed formats.
size_t sv_pixel_frame_bytes(sv_pixel_format f, int width_px, int height_px);

// How Y'CbCr becomes R'G'B': matrix and range.
typedef enum { SV_YUV_601 = 0, SV_YUV_601_FULL, SV_YUV_709, SV_YUV_709_FULL } sv_yuv_kind;

// Meaning of sensor samples (Bayer, and grey of more than 8 bits): value = gain (sample - black).
// If is_linear, the value is linear light and gets encoded by the sRGB curve. All zero: samples are
// display values.
typedef struct {
  int black;            // in samples
  float gain_r, gain_b; // beside green; 0 counts as 1
  bool is_linear;
} sv_raw_tone;

// The clock of a timestamp, and the instant of the frame that it marks.
typedef enum { SV_CLOCK_CAMERA = 0, SV_CLOCK_MONOTONIC, SV_CLOCK_BOOTTIME, SV_CLOCK_REALTIME } sv_clock_id;
typedef enum { SV_STAMP_START = 0, SV_STAMP_MIDDLE, SV_STAMP_END } sv_stamp_source;

typedef struct {
  char name[48];
  int width_px, height_px;
  sv_pixel_format format;
  double fps;
  sv_clock_id clock;
  sv_stamp_source stamp;
  sv_ns stamp_noise_ns; // standard deviation of the timestamps, ns; 0: exact, as far as known
  size_t frame_bytes;   // the largest data_bytes of one frame
  sv_yuv_kind yuv;      // of YUYV, UYVY, NV12
  sv_raw_tone tone;     // of Bayer, and of grey with more than 8 bits
  int coded_width_px,
      // of the compressed image that holds this camera; 0: the camera is the whole image
      coded_height_px;
  bool is_light_locked; // exposure time, gain and white balance do not change while frames come
  // and all cameras of which this holds have the same ones, but for exposure times that frames tell
  bool is_light_shared;
  bool is_exposure_told; // nothing but the shutter time changes, and frames tell it
  int n_brackets;        // shutter times that frames have in turn; 0: one
  bool is_color_known;   // the same light gives the same value at every pixel and in all cameras of
                         // which this holds
  sv_sensor_area area;   // what the frames show of the sensor; sensor size 0: not known
  // From the first line of a frame to the last, at the rate at which the sensor reads; 0: not
  // known. Sensors with global shutters have one, too: they read after the exposure.
  sv_ns readout_ns;
} sv_camera_caps;

// One frame, on loan until requeue returns it. `data` belongs to the source.
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
  const uint8_t *chroma; // NV12: [height / 2] rows of Cb,Cr; NULL: directly after the rows of Y
  int chroma_stride_bytes;
  int coded_x0_px, coded_y0_px; // its position in the compressed image (caps.coded_*)
  bool is_error;                // the driver delivered it and flagged it as damaged
  bool is_unsettled;            // its shutter time was changing and is not known
  int i_buffer;                 // private to the source
} sv_frame;

typedef enum {
#define X(NAME, name, sentence) SV_CAMERA_##NAME,
#include "src/port/camera_event.inc"
#undef X
  SV_N_CAMERA_EVENTS
} sv_camera_event_kind;
const char *sv_camera_event_name(sv_camera_event_kind k); // "short_frame"
const char *sv_camera_event_sentence(sv_camera_event_kind k);

typedef struct {
  sv_camera_event_kind kind;
  int i_camera;
  sv_ns host_ns;
  int64_t detail;   // see camera_event.inc
  const char *text; // a sentence from the source, valid while the source is open; or NULL
} sv_camera_event;

// Settings of a camera that can be changed while it runs.
typedef enum {
  SV_CONTROL_EXPOSURE_NS = 0,
  SV_CONTROL_GAIN_MILLI,       // 1000: none
  SV_CONTROL_FRAME_DURATION_NS // of the frames to come; cameras count in lines, so *actual may
                               // differ
} sv_control;

// A set of cameras that run together. Opening and enumeration belong to the platform.
typedef struct {
  void *self;
  int n_cameras;
  sv_status (*caps)(void *self, int i_camera, sv_camera_caps *out);
  sv_status (*start)(void *self);
  // The next frame of any camera, oldest arrival first. AGAIN when none arrived before
  // until_host_ns, END when the source is exhausted. The failure of one camera is E_DEVICE with
  // frame->i_camera set; the other cameras continue.
  sv_status (*dequeue)(void *self, sv_frame *frame, sv_ns until_host_ns);
  sv_status (*requeue)(void *self, const sv_frame *frame);
  sv_status (*stop)(void *self);
  // Pose of the rig at a host time, if the source knows it (simulator, a capture with poses). NULL
  // or E_NOT_FOUND: unknown; the runtime then assumes a stationary rig (rig_from_world = identity).
  sv_status (*rig_pose)(void *self, sv_ns host_ns, sv_pose *rig_from_world);
  // The next camera event. NULL, or AGAIN: none. A full list overwrites its oldest entry.
  sv_status (*event)(void *self, sv_camera_event *event);
  // Sets a control; *actual (may be NULL) is the value that the camera chose. NULL, or
  // E_UNSUPPORTED: no such setting. E_RANGE: not this value.
  sv_status (*set_control)(void *self, int i_camera, sv_control control, int64_t value, int64_t *actual);
  // Before start: cameras expose on an external trigger line (true) or freely (false). NULL: there
  // is no such line.
  sv_status (*trigger)(void *self, bool is_external);
} sv_source;

// Where a decoded image goes.
typedef struct {
  int width_px, height_px;
  size_t stride_bytes;
  uint8_t *rgb; // [height_px][stride_bytes] RGB8
} sv_decoded;

// Decodes one compressed image (JPEG or PNG). NULL: there is no decoder. E_RANGE when the image has
// another size, E_FORMAT or E_CORRUPT when it is damaged.
typedef struct {
  void *self;
  sv_status (*decode)(void *self, const uint8_t *data, size_t bytes, const sv_decoded *out, sv_err *err);
} sv_decoder;

// --- store ---------------------------------------------------------------------------------------
// Files of one run in one folder, by name without separators. A save is atomic: afterwards there is
// either the whole new file or the old one.
typedef struct {
  void *self;
  sv_status (*begin)(void *self, const char *name, sv_err *err); // one file at a time
  sv_status (*write)(void *self, const void *data, size_t bytes, sv_err *err);
  sv_status (*commit)(void *self, sv_err *err);
  // Commits a file of which two generations are kept. is_kept: the file that was there becomes
  // `older`; otherwise it is replaced, and `older` is removed. NULL: there is one generation.
  sv_status (*commit_over)(void *self, const char *older, bool is_kept, sv_err *err);
  void (*abandon)(void *self);
  // Reads a whole file into buf; *bytes is its size. E_NOT_FOUND, E_NOMEM (larger than cap), E_IO.
  sv_status (*read)(void *self, const char *name, void *buf, size_t cap, size_t *bytes, sv_err *err);
} sv_store;

// --- log and stop request ------------------------------------------------------------------------
// LIVE overwrites itself
typedef enum { SV_LOG_ERROR, SV_LOG_WARN, SV_LOG_INFO, SV_LOG_LIVE } sv_log_level;
typedef struct {
  void *self;
  void (*log)(void *self, sv_log_level level, const char *line);
  bool (*is_stop_requested)(void *self); // Ctrl-C
} sv_console;

// --- publish -------------------------------------------------------------------------------------
// Commands of the user, from the preview page.
typedef enum {
  SV_COMMAND_NONE = 0,
  SV_COMMAND_START, // also: continue after a pause
  SV_COMMAND_PAUSE,
  SV_COMMAND_SAVE,
  SV_COMMAND_NEW,
  SV_COMMAND_CALIBRATE, // the cameras are wanted for a calibration
  SV_COMMAND_MODE,      // another mode of the cameras was chosen
  SV_COMMAND_HISTORY,   // of a live run: the last seconds into the feed
  SV_COMMAND_NORMAL,    // before Start: the budget of this run (sv_preview_budget)
  SV_COMMAND_DRAFT,
  SV_COMMAND_FINE
} sv_command;

// Where a preview gets its images. Never blocks. rgb: [height][width][3] display values.
struct sv_feed;
typedef struct {
  void *self;
  void (*image)(void *self, const char *name, int width_px, int height_px, const uint8_t *rgb);
  struct sv_feed *feed;              // src/port/feed.h; NULL: no preview
  sv_command (*command)(void *self); // the next command or NONE; may be NULL
  // A bit for each camera that somebody looks at in full view. NULL: none.
  uint32_t (*looked_at)(void *self);
} sv_publish;

// --- display -------------------------------------------------------------------------------------
// A screen of the machine. Pixels have 32 bits: blue, green, red, and one unused byte.
typedef struct {
  uint8_t *px; // [height_px][stride_bytes], to be written whole; slow to read
  size_t stride_bytes;
  int width_px, height_px;
} sv_display_frame;

typedef struct {
  void *self;
  // The frame to draw. False: not now, as the screen has not shown the last one yet. Never waits.
  bool (*begin)(void *self, sv_display_frame *frame); // NULL: there is no screen
  // A line of text in that frame, white, SV_DISPLAY_LINE_PX scale pixels high, cut at its edges.
  // Never reads pixels.
  void (*text)(void *self, int x_px, int y_px, int scale, const char *line);
  void (*commit)(void *self); // shows the frame from the screen's next refresh on
  const char *link;           // to the page, shown as a QR code before Start; NULL: none
} sv_display;
#define SV_DISPLAY_LINE_PX 12
#define SV_DISPLAY_CHAR_PX 8 // the widest character, with its gap

// --- watch ---------------------------------------------------------------------------------------
typedef struct {
  double temperature_c; // of the processor; NaN: unknown
  int is_throttled;     // 1: the processor is slowed down for heat or power now; -1: unknown
} sv_heat;

typedef struct {
  void *self;
  sv_heat (*read)(void *self); // NULL: nothing is known. Never blocks
} sv_thermometer;

struct sv_heartbeats;

typedef struct {
  sv_clock clock;   // host time of the cameras; virtual in the simulator and in replays at full
                    // speed
  sv_clock machine; // real time, for time limits and measurements
  sv_pool pool;
  sv_worker worker; // only with cameras on real time
  sv_source source;
  sv_store store;
  sv_store rescue;        // for what `store` does not take at the end; begin NULL: there is none
  const char *rescue_dir; // where that is, for messages; valid once a file is saved there
  sv_console console;
  sv_publish publish; // image may be NULL
  sv_display display; // begin may be NULL
  sv_decoder decoder; // of cameras that deliver compressed pictures; decode may be NULL
  sv_thermometer thermometer;
  struct sv_heartbeats *heartbeats; // src/port/heartbeat.h; NULL: nobody watches
} sv_port;

#ifdef __cplusplus
}
#endif
#endif
