// SPDX-License-Identifier: Apache-2.0
// C only: the feed is.
// What a run shows while it goes on, and what the person in front of it asks for. Everything is copied into the
// port's feed (src/port/feed.h) at fixed intervals of the machine's clock; nobody who reads there is ever waited
// for. Without a feed all calls do nothing and cost nothing. Nothing here changes a bit of the training.
#ifndef SV_PREVIEW_PREVIEW_H
#define SV_PREVIEW_PREVIEW_H

#include "src/base/arena.h"
#include "src/image/planes.h"
#include "src/port/feed.h"
#include "src/port/port.h"
#include "src/sync/camera_stats.h"
#include "src/sync/sync.h"
#include "src/train/train.h"

typedef struct sv_app sv_app;

// Written by whoever takes the cameras' frames, which may be another thread than the one that publishes the rest.
typedef struct {
  sv_camera_stat stat;
  double next_tile_s;
  _Atomic double fps;
  _Atomic uint64_t n_tiles;
} sv_preview_camera;

typedef struct {
  sv_ledger ledger[SV_FEED_CAP_CAMERAS];
  sv_skew_stats skew;
} sv_preview_counts;

typedef struct {
  sv_feed *feed;   // NULL: nothing is shown
  bool is_session; // wait for Start, stay after the end
  sv_preview_camera *cameras;
  sv_feed_tiles *tiles; // staging: a slot holds all tiles; the frames' side alone
  double next_tiles_s, next_counts_s;
  sv_preview_counts *counts; // [2]
  _Atomic int i_counts;      // the half to read
  sv_feed_curve *curve;      // history, for pages that come late
  sv_feed_events *events;    // likewise
  double start_s, next_state_s, next_model_s, next_picture_s;
  double point_s, psnr;
  uint32_t n_points, i_picture;
  uint64_t n_saves;
  bool is_coded; // all cameras compress: their thumbnails come from what was decoded anyway
  bool has_new_event, is_paused, is_new_requested;
  sv_feed_shows shows;
} sv_preview;

// Floats of each Gaussian's motion in the feed, beside SV_GAUSSIAN_N_FLOATS; 0: nothing moves.
size_t sv_preview_motion_floats(const sv_train_cfg *t);
// Floats of its rigid bodies, once for the whole model; 0: there are none.
size_t sv_preview_bodies_floats(const sv_train_cfg *t);
void sv_preview_carve(sv_preview *l, bool is_on, int n_cameras, sv_arena *arena);
void sv_preview_start(sv_app *app); // the run begins: the clock of the page starts

// Capture. A frame came in (compressed ones give no thumbnail here: sv_preview_decoded). These two may be called from
// another thread than all else, but only from one.
void sv_preview_frame(sv_app *app, const sv_frame *f);
// The same frame after it was decoded; the newest exposure, which was decoded when it was taken.
void sv_preview_exposure(sv_app *app);
void sv_preview_decode(sv_app *app, const sv_frame *f); // while nothing is captured yet
void sv_preview_decoded(sv_app *app, int i_camera, const sv_image_u8 *image);
// What the capture side last counted, whichever thread it is on.
const sv_ledger *sv_preview_ledger(const sv_app *app, int i_camera);
const sv_skew_stats *sv_preview_skew(const sv_app *app);
// Now and then in every loop: publishes what is due. E_INTERRUPTED when New was asked for.
sv_status sv_preview_tick(sv_app *app) SV_MUST_USE;
// In a session, before the capture: shows the cameras until Start. E_INTERRUPTED after a stop request.
sv_status sv_preview_wait_start(sv_app *app, sv_err *err) SV_MUST_USE;

// Between two training steps: the same as tick; saves when Save was asked for, and while Pause holds stays inside.
// *paused_s: how long, which is no training time.
sv_status sv_preview_between_steps(sv_app *app, double *paused_s, sv_err *err) SV_MUST_USE;
// The model and the state at once (training begins, or ended).
void sv_preview_show_model(sv_app *app);
void sv_preview_show(sv_app *app, sv_feed_shows shows, const char *sentence);
// In a session, after the end: until New (AGAIN) or a stop request (OK).
sv_status sv_preview_stay(sv_app *app) SV_MUST_USE;
// A line of the log, for the page.
void sv_preview_event(sv_app *app, sv_log_level level, const char *text);

// A run that could not be set up, so that there is no app: the same state with a sentence.
void sv_preview_show_failure(sv_feed *feed, sv_feed_lacks lacks, const char *board, const char *source,
                             bool is_session, const char *sentence);

// Downscales a frame's pixels into rgb[h][w][3] by whole steps, so that it fits into cap_w x cap_h: a quick look, not
// what is trained on (src/image/convert.h). False for compressed frames.
bool sv_preview_thumbnail(const sv_frame *f, int cap_w, int cap_h, uint8_t *rgb, int *w, int *h);

#endif
