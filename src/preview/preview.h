// SPDX-License-Identifier: Apache-2.0
// C only: the feed is.
// The page's side of a run: copies its state, images and model into the port's feed
// (src/port/feed.h) at fixed intervals of the machine's clock, and takes the commands that come
// back. Owns the staging copies and the history (curve, events) for pages that connect late. Never
// waits for a reader, never changes a bit of the training, and does nothing without a feed.
#ifndef SV_PREVIEW_PREVIEW_H
#define SV_PREVIEW_PREVIEW_H

#include "src/base/arena.h"
#include "src/base/unit.h"
#include "src/capture/capture.h"
#include "src/format/history.h"
#include "src/image/planes.h"
#include "src/port/feed.h"
#include "src/port/port.h"
#include "src/preview/screen.h"
#include "src/sync/camera_stats.h"
#include "src/sync/sync.h"
#include "src/dynamic/dynamic.h"
#include "src/train/driver.h"

// How long a run trains, of the steps or the time that it was started with.
typedef enum { SV_BUDGET_NORMAL, SV_BUDGET_DRAFT, SV_BUDGET_FINE, SV_N_BUDGETS } sv_preview_budget;
float sv_preview_budget_factor(sv_preview_budget b);

// What a run answers. self is its own.
typedef struct {
  void *self;
  void (*log)(void *self, sv_log_level level, const char *line);
  void (*beat)(void *self); // the main thread made progress
  bool (*is_stopping)(void *self);
  sv_status (*save)(void *self, sv_err *err);  // E_IO: not now, the run goes on
  sv_heat (*heat)(void *self);                 // of the processor, now
  sv_unit (*unit)(void *self);                 // of the world
  float (*time_of)(void *self, sv_ns time_ns); // the model's time of a moment of the host's clock
  // The history of a live run as a file; E_NOT_FOUND: there is none yet.
  sv_status (*write_history)(void *self, sv_sink sink, sv_err *err);
} sv_preview_calls;

// The parts of a run that are shown; all must outlive it.
typedef struct {
  const sv_port *port;
  const sv_kernels *k;
  const sv_arena *arena; // for the memory map
  const sv_capture_queue *queue;
  sv_capture_side *capture;
  sv_exposures *exposures;
  sv_trainer *trainer;
  const sv_dynamic *dynamic;
  const sv_history *history;
  const sv_driver *driver;
  const sv_rig *rig;
  const sv_camera_caps *caps; // [n_cameras]
  int n_cameras, n_exposures;
  const char *source_name, *board_name; // may be NULL
  uint32_t steps;                       // limits; 0: none
  double time_limit_s;
  bool is_session, starts_at_once; // sv_app_cfg
  bool has_budget;                 // the budget of this run can be chosen before Start
  sv_preview_calls calls;
} sv_preview_cfg;

// Written by whoever takes the cameras' frames, which may be another thread than the one that
// publishes the rest.
typedef struct {
  sv_camera_stat stat;
  double next_tile_s, next_view_s;
  _Atomic double fps;
  _Atomic uint64_t n_tiles;
} sv_preview_camera;

typedef struct {
  sv_ledger ledger[SV_FEED_CAP_CAMERAS];
  sv_skew_stats skew;
} sv_preview_counts;

typedef struct {
  sv_preview_cfg cfg;
  sv_feed *feed;   // NULL: nothing is shown
  bool is_session; // wait for Start, stay after the end
  sv_preview_camera *cameras;
  sv_feed_tiles *tiles; // staging: a slot holds all tiles; the frames' side alone
  double next_tiles_s, next_counts_s;
  sv_preview_counts *counts; // [2]
  _Atomic int i_counts;      // the half to read
  sv_feed_curve *curve;      // history, for pages that come late
  sv_feed_events *events;    // likewise
  double next_history_s;     // before which it is not published again
  double start_s, next_state_s, next_model_s, next_picture_s;
  double point_s, psnr;
  uint32_t n_points, i_picture;
  uint64_t n_saves;
  _Atomic uint32_t looked_at; // a bit for each camera in full view
  bool is_coded;              // all cameras compress: thumbnails come from what was decoded anyway
  bool has_new_event, is_paused, is_new_requested, is_calibration_requested;
  sv_preview_budget budget;
  sv_feed_status status;
  sv_screen screen;   // of the machine, when it has one
  char sentence[256]; // of a failure
} sv_preview;

// Floats of each Gaussian's motion in the feed, beside SV_GAUSSIAN_N_FLOATS; 0: nothing moves.
size_t sv_preview_motion_floats(const sv_dynamic_cfg *d);
// Floats of its rigid bodies, once for the whole model; 0: there are none.
size_t sv_preview_bodies_floats(const sv_dynamic_cfg *d);
typedef struct {
  bool is_on, has_screen;
  int n_cameras;
} sv_preview_parts;
void sv_preview_carve(sv_preview *l, const sv_preview_parts *parts, sv_arena *arena);
void sv_preview_init(sv_preview *l, const sv_preview_cfg *cfg);
void sv_preview_start(sv_preview *l); // the run begins: the clock of the page starts

// A frame came in (compressed ones give no thumbnail here: sv_preview_decoded). May be called from
// another thread than everything else, but only from one.
void sv_preview_frame(sv_preview *l, const sv_frame *f);
// Thumbnails of compressed frames: of the newest exposure, which was decoded anyway; of a frame
// before capture, which is decoded for this; of an image that was decoded.
void sv_preview_exposure(sv_preview *l);
void sv_preview_decode(sv_preview *l, const sv_frame *f);
void sv_preview_decoded(sv_preview *l, int i_camera, const sv_image_u8 *image);
// The capture side's newest counts, whichever thread it is on.
const sv_ledger *sv_preview_ledger(const sv_preview *l, int i_camera);
const sv_skew_stats *sv_preview_skew(const sv_preview *l);
// Call it in every loop: publishes whatever is due. E_INTERRUPTED when New was requested.
sv_status sv_preview_tick(sv_preview *l) SV_MUST_USE;
// In a session, before the capture: shows the cameras until Start. E_INTERRUPTED after a stop
// request.
sv_status sv_preview_wait_start(sv_preview *l, sv_err *err) SV_MUST_USE;

// Between two training steps: as tick; saves when Save was requested, and does not return while
// paused. *paused_s: time that is no training time.
sv_status sv_preview_between_steps(sv_preview *l, double *paused_s, sv_err *err) SV_MUST_USE;
// The model and the state at once (training begins, or ended).
void sv_preview_show_model(sv_preview *l);
void sv_preview_show(sv_preview *l, sv_feed_status status, const char *sentence);
// In a session, after the end: until New (AGAIN) or a stop request (OK).
sv_status sv_preview_stay(sv_preview *l) SV_MUST_USE;
// A line of the log, for the page.
void sv_preview_event(sv_preview *l, sv_log_level level, const char *text);

// The history of a live run into the feed (past.c); at most once a second.
void sv_preview_show_history(sv_preview *l);

// For a run that could not be set up: the state with the reason.
void sv_preview_show_failure(sv_feed *feed, sv_feed_cause cause, const char *board, const char *source,
                             bool is_session, const char *sentence);

// Downscales a frame's pixels into rgb[h][w][3] by whole steps, so that it fits into cap_w x cap_h:
// a quick look, not the conversion for training (src/image/convert.h). False for compressed frames.
bool sv_preview_thumbnail(const sv_frame *f, int cap_w, int cap_h, uint8_t *rgb, int *w, int *h);

#endif
