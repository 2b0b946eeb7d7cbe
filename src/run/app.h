// SPDX-License-Identifier: Apache-2.0
// C only: the capture side's counters are atomic.
// The runtime: captures synchronized exposures, trains Gaussians on all their sub-views, publishes
// and saves them. Owns every part of a run (below, in the order of the data), all of it in one
// memory block that init seals. Never takes memory after init, and reaches the machine through its
// port alone.
#ifndef SV_RUN_APP_H
#define SV_RUN_APP_H

#include "src/capture/capture.h"
#include "src/capture/exposures.h"
#include "src/capture/odometry.h"
#include "src/port/heartbeat.h"
#include "src/preview/pictures.h"
#include "src/preview/preview.h"
#include "src/run/config.h"
#include "src/train/driver.h"
#include "src/run/files.h"
#include "src/run/moving.h"

typedef enum {
  SV_APP_IDLE,
  SV_APP_CAPTURING,
  SV_APP_TRAINING,
  SV_APP_SAVING,
  SV_APP_DONE,
  SV_APP_FAILED
} sv_app_state;
const char *sv_app_state_name(sv_app_state s);

struct sv_app {
  sv_app_cfg cfg;
  sv_app_state state;

  // The machine
  const sv_kernels *k;
  sv_port port;
  const sv_arena *arena; // for the memory map in the report

  // src/sync, src/capture
  sv_capture_queue queue;
  sv_capture_side capture;
  sv_exposures exposures;
  sv_odometry odometry; // with is_tracking

  // src/train, src/dynamic, src/prior, src/run
  sv_trainer trainer;
  sv_dynamic dynamic; // with is_dynamic
  sv_prior prior;     // with cfg.prior
  sv_driver driver;
  double released_psnr; // dB, on the held-out pixels when they were released; 0: they were not
  sv_app_moving moving;
  sv_point *points; // [n_gaussians] of the first model
  sv_arena scratch; // of the start, and of what a moving scene renews

  // What is watched
  sv_watched_pool pool; // behind port.pool
  sv_heat heat;         // as last read
  double hottest_c;     // NaN: not known

  // What leaves the run
  sv_app_files files;
  sv_preview preview; // the page
  uint8_t *picture;   // RGB, of sv_pictures_size
};

// The memory of a run: the parts and their sum are in `dry` (sv_arena_dry()) afterwards. `app` is
// workspace.
sv_status sv_app_plan(sv_app *app, const sv_app_cfg *cfg, int n_threads, sv_arena *dry,
                      sv_err *err) SV_MUST_USE;
// Carves everything and seals the arena. cfg->rig, caps, k, port's objects and arena must outlive
// the app.
sv_status sv_app_init(sv_app *app, const sv_app_cfg *cfg, const sv_kernels *k, const sv_port *port,
                      sv_arena *arena, sv_err *err) SV_MUST_USE;

// Captures, trains and saves. E_INTERRUPTED after a stop request: the model is saved. E_NOT_FOUND
// when the source ended without an exposure.
sv_status sv_app_run(sv_app *app, sv_err *err) SV_MUST_USE;

// A line for the console and the page.
void sv_app_log(sv_app *app, sv_log_level level, const char *fmt, ...) SV_PRINTF(3, 4);
bool sv_app_is_stop_requested(const sv_app *app);
// Images of the run, in its buffer; and the preview image, published.
sv_pictures sv_app_pictures(sv_app *app);
sv_status sv_app_publish_preview(sv_app *app) SV_MUST_USE;
// The main thread made progress.
void sv_app_beat(sv_app *app);
// The processor's temperature now; keeps the highest.
sv_heat sv_app_heat(sv_app *app);

// --- first_model.c: from exposures to a model that can be trained ---
// All exposures are in the pool: views, first Gaussians, or what a checkpoint holds.
sv_status sv_app_start_training(sv_app *app, sv_err *err) SV_MUST_USE;
// Held-out pixels (cfg.hold_out) are kept from training, or take part in it.
void sv_app_hold(sv_app *app, bool is_kept);

// --- views.c: from the pool to the trainer ---
// Exposure e of the pool becomes views of the trainer, or measurements.
sv_status sv_app_add_views(sv_app *app, int e, sv_err *err) SV_MUST_USE;
// View i_view of the trainer is sub-view i_sub of exposure e: its rolling shutter and deep picture.
void sv_app_describe_view(sv_app *app, int i_view, int e, int i_sub);
// Views of deep pictures, after a checkpoint has told what light is counted from.
void sv_app_take_light(sv_app *app);
// What is known of rolling shutters and deep pictures goes to the log.
void sv_app_log_views(sv_app *app);

#endif
