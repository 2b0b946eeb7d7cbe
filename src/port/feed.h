// SPDX-License-Identifier: Apache-2.0
// C only: C++ has no _Atomic.
// The feed: the state of a running runtime in one block of memory that other processes read. Owns
// the layout of that block: a header and, for each channel, a ring of slots. One writer; any number
// of readers, which need no write access. Never blocks: a reader cannot hold up the writer.
//
// The writer fills the slot after the newest one, then moves the head. A reader copies the newest
// slot and checks whether it was overtaken (a sequence lock per slot: odd while being written).
// With two slots, a reader has a whole period of the channel for its copy; the history has one
// slot. Writer and reader must share the architecture and SV_FEED_VERSION.
#ifndef SV_PORT_FEED_H
#define SV_PORT_FEED_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "src/base/status.h"
#include "src/port/heartbeat.h"

#define SV_FEED_MAGIC   0x64656673u // "sfed"
#define SV_FEED_VERSION 7u

#define SV_FEED_CAP_CAMERAS   64  // listed
#define SV_FEED_CAP_TILES     16  // with a thumbnail
#define SV_FEED_TILE_W        192 // largest thumbnail
#define SV_FEED_TILE_H        144
#define SV_FEED_CAP_VIEW_W    640 // largest image of a camera in full view
#define SV_FEED_CAP_VIEW_H    480
#define SV_FEED_CAP_PICTURE_W 1280 // largest device-side rendering
#define SV_FEED_CAP_PICTURE_H 480
#define SV_FEED_CAP_POINTS    512
#define SV_FEED_CAP_EVENTS    64
#define SV_FEED_CAP_PARTS     48
#define SV_FEED_CAP_REASONS   16
#define SV_FEED_SKEW_BINS     64
#define SV_FEED_CAP_CELLS     96 // directions of the dome around the scene
#define SV_FEED_CAP_EYES      64 // cameras of a model's images, spread over all of them

typedef enum {
  SV_FEED_STATE,       // sv_feed_state
  SV_FEED_TILES,       // sv_feed_tiles
  SV_FEED_MODEL,       // sv_feed_model, then its rows of floats
  SV_FEED_PICTURE,     // sv_feed_picture, then its pixels
  SV_FEED_CURVE,       // sv_feed_curve
  SV_FEED_EVENTS,      // sv_feed_events
  SV_FEED_CALIBRATION, // sv_feed_calibration
  SV_FEED_VIEW,        // sv_feed_view, then its pixels
  SV_FEED_MODES,       // sv_feed_modes
  SV_FEED_HISTORY,     // a file of src/format/history.h, when somebody has asked for it
  SV_FEED_N_CHANNELS
} sv_feed_channel;

// --- what the channels hold ----------------------------------------------------------------------
typedef enum {
  SV_FEED_STATUS_WAITING, // cameras run, waiting for Start
  SV_FEED_STATUS_CAPTURING,
  SV_FEED_STATUS_TRAINING,
  SV_FEED_STATUS_PAUSED,
  SV_FEED_STATUS_SAVING,
  SV_FEED_STATUS_DONE,
  SV_FEED_STATUS_FAILED,
  SV_FEED_STATUS_CALIBRATING // another program has the cameras
} sv_feed_status;
// Cause of a failure.
typedef enum { SV_CAUSE_NOTHING, SV_CAUSE_CAMERA, SV_CAUSE_RIG, SV_CAUSE_OTHER } sv_feed_cause;

typedef struct {
  char name[48];
  int32_t width_px, height_px;
  double fps;                                              // measured, 0 before the second frame
  uint64_t captured, delivered, pending, dropped, n_tiles; // as in the ledger; number of thumbnails
  uint64_t dropped_by[SV_FEED_CAP_REASONS];                // sv_drop_reason
} sv_feed_camera;

typedef struct {
  char name[32];
  uint64_t bytes;
} sv_feed_part;

// Guidance while capturing (src/capture/guidance.h).
typedef struct {
  char hint[40];                             // what to do next, or ""
  int32_t n_kept, n_good;                    // exposures
  int32_t n_bands, n_sectors;                // the dome: cell = band x n_sectors + sector
  int32_t i_cell, i_target;                  // where the newest one was; next. -1: unknown
  double coverage;                           // 0 to 1; below 0: no poses are known
  int8_t covered_percent[SV_FEED_CAP_CELLS]; // -1: not asked for
} sv_feed_guidance;

typedef struct {
  int32_t status, cause; // sv_feed_status, sv_feed_cause
  char sentence[256];    // of a failure
  char board[32], source[128], rig[32];
  int32_t is_session; // Start and New are accepted; the program outlives the run
  int32_t budget;     // sv_preview_budget; -1: this run's cannot be chosen
  int32_t n_cameras, n_exposures, cap_exposures, n_views;
  uint32_t step, steps; // steps 0: until the time limit
  double train_s, time_limit_s, steps_per_s, loss;
  double psnr; // running mean over training images, one at a time; 0: not yet known
  uint32_t n_gaussians, sh_degree;
  uint64_t n_saves, n_device_errors, model_seq;
  double history_s; // of the past that is kept, 0: none
  uint64_t arena_cap_bytes, arena_used_bytes;
  double temperature_c; // NaN: not known
  int32_t is_throttled; // -1: not known
  double train_duty;    // share of its time that training may use; below 1 when it is hot
  uint64_t n_skew;
  double skew_p50_us, skew_p99_us, skew_max_us;
  // quarter octaves: bin b starts at 2^(b/4) x 1 us
  uint32_t skew_bins[SV_FEED_SKEW_BINS];
  int32_t n_reasons, n_parts;
  char reasons[SV_FEED_CAP_REASONS][24];
  sv_feed_part parts[SV_FEED_CAP_PARTS];
  sv_feed_guidance guidance;
  sv_feed_camera cameras[SV_FEED_CAP_CAMERAS];
} sv_feed_state;

typedef struct {
  int32_t n; // of the first n cameras
  struct {
    int32_t width_px, height_px; // 0: no frame yet
    uint64_t n;                  // changes with each new thumbnail
  } tile[SV_FEED_CAP_TILES];
  uint8_t rgb[SV_FEED_CAP_TILES][SV_FEED_TILE_H * SV_FEED_TILE_W * 3]; // rows packed
} sv_feed_tiles;

// A snapshot of the Gaussians: n rows of n_floats floats each, as sv_gaussian of src/format up to
// the model's degree (mean, quaternion w x y z, log-scales, opacity logit, SH coefficient-major).
// For a moving scene, n_moving rows of n_motion floats follow: the motion of the first n_moving
// Gaussians (rows of kernels/motion/motion.h; the functions of time are in src/deform/motion.h).
// With rigid bodies, floats of n_bodies follow, body 0 included: centres [n_bodies][3], times
// [n_knots], knots [n_bodies][n_knots][7] (w x y z, displacement), the body of each of the
// n_moving.
typedef struct {
  float eye[3], forward[3]; // of the world
  float tan_half;           // tangent of half the image's diagonal angle
} sv_feed_eye;
typedef enum { SV_FEED_STILL, SV_FEED_CHEBYSHEV, SV_FEED_POWERS } sv_feed_motion;
typedef struct {
  uint32_t n, sh_degree, n_floats, is_mip, step;
  uint32_t n_moving, n_motion, motion; // sv_feed_motion
  uint32_t n_pos, n_rot, n_colour;
  uint32_t n_bodies, n_knots;        // together 0: no bodies
  float t0;                          // of powers
  float dilation_px2;                // low-pass of the splats
  uint32_t background;               // behind the Gaussians, 0xRRGGBB
  float centre[3], radius;           // of the scene
  float eye[3], up[3], fov_y;        // a good first viewpoint (radians): the first training view
  float time_min, time_max, seconds; // of a moving scene: times of its exposures, and their
                                     // duration
  uint32_t is_metric;                // the unit of the world is the meter
  float scale_sigma;                 // of the unit, as in src/base/unit.h
  uint32_t n_eyes;
  sv_feed_eye eyes[SV_FEED_CAP_EYES]; // where the images of the training were taken
} sv_feed_model;
#define SV_FEED_CAP_BODIES 16
#define SV_FEED_CAP_KNOTS  256
#define SV_FEED_BODIES_FLOATS(n_bodies, n_knots, n_moving)                                                   \
  ((size_t)(n_bodies) * (3 + 7 * (size_t)(n_knots)) + (size_t)(n_knots) + (size_t)(n_moving))

typedef struct {
  int32_t width_px, height_px; // rgb follows, rows packed: captured image beside its rendering
  uint32_t step, reserved;
} sv_feed_picture;

// Modes of a session's cameras, of which the page can choose one for the runs to come.
#define SV_FEED_CAP_MODES     24
#define SV_FEED_CAP_MODE_TEXT 24
typedef struct {
  int32_t n, i_mode; // i_mode: the chosen one, -1: as the session was started
  // "640x480@30"
  char text[SV_FEED_CAP_MODES][SV_FEED_CAP_MODE_TEXT];
} sv_feed_modes;

// A camera that somebody looks at in full view; several take turns.
typedef struct {
  int32_t i_camera, width_px, height_px, reserved; // rgb follows, rows packed
} sv_feed_view;

typedef struct {
  float seconds, loss, psnr, steps_per_s;
  uint32_t step;
} sv_feed_point;
typedef struct {
  uint32_t n, stride; // one point per `stride` periods
  sv_feed_point point[SV_FEED_CAP_POINTS];
} sv_feed_curve;

typedef struct {
  double seconds; // since the start
  int32_t level;  // sv_log_level
  char text[160];
} sv_feed_event;
typedef struct {
  uint64_t n_total; // the newest min(n_total, cap) are kept: number i at i % cap
  sv_feed_event event[SV_FEED_CAP_EVENTS];
} sv_feed_events;

// A calibration with a chessboard, of a rig that is about to be used.
typedef enum {
  SV_CALIBRATION_NONE,
  SV_CALIBRATION_LOOKING, // for boards in new images
  SV_CALIBRATION_SOLVING,
  SV_CALIBRATION_DONE,  // checked and installed
  SV_CALIBRATION_FAILED // sentence says why; the rig is what it was
} sv_calibration_phase;
#define SV_CALIBRATION_CAP_CAMERAS 16
#define SV_CALIBRATION_GRID_X      8
#define SV_CALIBRATION_GRID_Y      6
typedef struct {
  char name[32];
  int32_t width_px, height_px;
  int32_t n_boards, is_seen;  // images with the board; whether the newest one is such
  uint64_t coverage;          // bit 8 y + x: a corner was in cell (x, y) of the image
  float outline[4][2];        // of the newest image: the board's outer corners, 0 to 1
  double rms_px, epipolar_px; // of the new rig; NaN: not known
  double before_px;           // RMS of the same boards in the earlier rig; NaN: there is none
} sv_calibration_camera;
typedef struct {
  int32_t phase, n_cols, n_rows, n_cameras, n_exposures;
  int32_t n_needed; // boards of each camera
  double spacing_m, seconds, baseline_m;
  uint64_t peak_bytes; // resident memory of the calibration so far
  char sentence[256];
  sv_calibration_camera camera[SV_CALIBRATION_CAP_CAMERAS];
} sv_feed_calibration;

// --- the block -----------------------------------------------------------------------------------
typedef struct {
  _Atomic uint64_t seq; // 2 k + 1 while snapshot k is written, 2 k + 2 when it is whole
  uint64_t bytes;
  uint64_t reserved[6];
} sv_feed_slot;

typedef struct {
  _Atomic uint64_t head; // number of the newest snapshot, 0: none yet
  uint64_t at, slot_bytes, n_slots;
} sv_feed_ring;

typedef struct {
  uint32_t magic, version;
  uint64_t bytes;
  int32_t writer_pid, command_fd; // lets a reader in another session send commands; -1: not
                                  // possible
  sv_feed_ring ring[SV_FEED_N_CHANNELS];
  sv_beat_of beats[SV_CAP_BEATS]; // of the writer's threads, also while it publishes nothing
} sv_feed_header;

// --- writer --------------------------------------------------------------------------------------
typedef struct sv_feed {
  sv_feed_header *header;
  uint64_t next[SV_FEED_N_CHANNELS];
} sv_feed;

// Bytes of a block for models of up to cap Gaussians of n_floats floats, and for a history.
size_t sv_feed_bytes(uint32_t cap_gaussians, uint32_t cap_floats, size_t history_bytes);
// Lays the block out. block: 64-byte aligned, sv_feed_bytes long, all zero. E_NOMEM when it is too
// small.
sv_status sv_feed_init(sv_feed *f, void *block, size_t bytes, uint32_t cap_gaussians, uint32_t cap_floats,
                       size_t history_bytes) SV_MUST_USE;
size_t sv_feed_cap(const sv_feed *f, sv_feed_channel c);
// Returns the slot to fill, sv_feed_cap bytes; commit takes the bytes filled. A second begin
// discards the first.
void *sv_feed_begin(sv_feed *f, sv_feed_channel c);
void sv_feed_commit(sv_feed *f, sv_feed_channel c, size_t bytes);
// Number of the newest snapshot of a channel.
uint64_t sv_feed_seq(const sv_feed *f, sv_feed_channel c);

// --- reader --------------------------------------------------------------------------------------
typedef struct {
  const sv_feed_header *header;
  sv_feed_ring ring[SV_FEED_N_CHANNELS]; // checked against the block's size; head is not used
} sv_feed_reader;

// E_FORMAT when the block is not a feed, E_UNSUPPORTED for another version. The block must outlive
// the reader.
sv_status sv_feed_attach(sv_feed_reader *r, const void *block, size_t bytes, sv_err *err) SV_MUST_USE;
// Copies the newest snapshot if its number is not *seq, into buf[cap]; *bytes is its size, *seq its
// number. AGAIN: nothing newer, or the writer overtook eight attempts (*seq is then 0 if buf is
// torn); E_NOMEM: larger than cap.
sv_status sv_feed_read(const sv_feed_reader *r, sv_feed_channel c, uint64_t *seq, void *buf, size_t cap,
                       size_t *bytes) SV_MUST_USE;
uint64_t sv_feed_newest(const sv_feed_reader *r, sv_feed_channel c);

#endif
