// SPDX-License-Identifier: Apache-2.0
// C only: the capture side's counters are atomic.
// The runtime: capture synchronized exposures, train Gaussians on all their sub-views, publish, save. One
// configuration, one kernel table, one port, one memory block.
#ifndef SV_RUN_APP_H
#define SV_RUN_APP_H

#include <stdatomic.h>

#include "src/capture/exposures.h"
#include "src/capture/governor.h"
#include "src/capture/odometry.h"
#include "src/preview/preview.h"
#include "src/base/str.h"
#include "src/run/driver.h"
#include "src/rig/bounds.h"
#include "src/splat/model_file.h"
#include "src/sync/capture_queue.h"
#include "src/train/train.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_APP_REPORT_BYTES   (64 * 1024)
#define SV_APP_CAP_PREVIEW_PX 8192 // width of the three pictures of a multiplexed rig

typedef enum {
  SV_APP_IDLE,
  SV_APP_CAPTURING,
  SV_APP_TRAINING,
  SV_APP_SAVING,
  SV_APP_DONE,
  SV_APP_FAILED
} sv_app_state;
const char *sv_app_state_name(sv_app_state s);

typedef struct {
  const sv_rig *rig;
  int n_cameras;
  const sv_camera_caps *caps; // [n_cameras]
  const char *source_name;    // for the report, and what a checkpoint is known by
  const char *board_name;     // for the live view; may be NULL
  bool has_preview;           // the port has a feed: room for what it shows
  bool is_session;            // with a feed: wait for Start, New begins again
  int n_exposures;
  sv_ns skew_limit_ns;
  sv_sync_method sync_method; // who makes the cameras expose together
  bool is_continuous;         // capture goes on while training: new exposures take the place of the oldest
  bool is_dynamic;            // the scene moves
  double exposure_s;          // live and moving: training time of each exposure
  double preview_every_s;     // of a live run, when there is time; 0: none
  sv_ns capture_timeout_ns;   // host time without any exposure after which capture gives up
  uint64_t sub_view_mask[SV_CAP_SUB_VIEWS / 64]; // train on these only; all zero: on all
  sv_train_cfg train;                            // caps and views are filled in by init
  uint32_t steps;                                // 0: until the time limit
  double time_limit_s;                           // of training; 0: none
  sv_prior_method prior;                         // of sparse views
  int optimizer;                                 // 1 + an sv_optimizer; 0: the one that suits the exposures
  bool is_refining; // training refines the rig's poses, those of the first exposure held
  bool is_tracking; // the source does not tell the rig's poses: find them from the pictures
  bool has_bounds;  // the scene lies in `bounds`: start there; else start from the pictures
  sv_bounds bounds;
  bool is_resume;         // go on from checkpoint.bin when it is there
  double save_every_s;    // checkpoint and preview during training; 0: only at the end
  double picture_every_s; // preview picture alone; 0: only with checkpoints
} sv_app_cfg;

struct sv_app {
  sv_app_cfg cfg;
  const sv_kernels *k;
  sv_port port;
  const sv_arena *arena; // for the memory map in the report
  sv_app_state state;
  sv_capture_queue queue;
  sv_governor governor; // of a live run
  bool is_capturing;    // cameras run
  bool has_worker;      // and are served by the port's worker
  _Atomic bool is_capture_ending;
  sv_ns machine_ns; // up to which the cameras' virtual clock has followed the machine's
  sv_exposures exposures;
  sv_odometry odometry; // with is_tracking
  sv_trainer trainer;
  sv_point *points;    // [n_gaussians] starting points, when bounds are unknown
  sv_arena scratch;    // start-up work inside the block
  char *report;        // [SV_APP_REPORT_BYTES]
  uint8_t *checkpoint; // [checkpoint_bytes] read buffer for resume
  size_t checkpoint_bytes;
  uint8_t *picture;             // sv_app_preview_size, RGB
  sv_ns first_ns, last_ns;      // of a moving scene: times of the exposures that its own time runs between
  sv_ns exposure_ns;            // machine time at which the newest one came in
  uint64_t n_entered, n_scored; // live: exposures taken in; scored at the end of their time
  double psnr_sum, psnr_late;   // of these; the running mean of the last fifty or so
  sv_ply_writer ply;
  sv_driver driver;                   // the training loop
  double last_save_s, last_picture_s; // of the machine's clock: the newest while training
  uint64_t n_device_errors;
  uint64_t n_bad_exposures; // delivered whole, but a compressed picture in it was damaged: not kept
  sv_preview preview;
};

// Sizes that follow from the cfg: caps of the trainer.
sv_train_cfg sv_app_train_cfg(const sv_app_cfg *cfg, int n_threads);
// The memory of a run: the parts and their sum are in `dry` (sv_arena_dry()) afterwards. `app` is workspace.
sv_status sv_app_plan(sv_app *app, const sv_app_cfg *cfg, int n_threads, sv_arena *dry,
                      sv_err *err) SV_MUST_USE;
// Carves everything and seals the arena. cfg->rig, caps, k, port's objects and arena must outlive the app.
sv_status sv_app_init(sv_app *app, const sv_app_cfg *cfg, const sv_kernels *k, const sv_port *port,
                      sv_arena *arena, sv_err *err) SV_MUST_USE;

// Capture, train, save. E_INTERRUPTED after a stop request: what was trained is saved. E_NOT_FOUND when the
// source ended without an exposure.
sv_status sv_app_run(sv_app *app, sv_err *err) SV_MUST_USE;

// --- pieces (capture.c) ---------------------------------------------------------------------------
void sv_app_log(sv_app *app, sv_log_level level, const char *fmt, ...) SV_PRINTF(3, 4);
bool sv_app_is_stop_requested(const sv_app *app);
bool sv_app_is_trained_on(const sv_app_cfg *cfg, int i_sub_view);
int sv_app_n_trained_sub_views(const sv_app_cfg *cfg);
// Fills the pool. In a live run the cameras go on; otherwise, and when the source has ended, they are stopped.
sv_status sv_app_capture(sv_app *app, sv_err *err) SV_MUST_USE;
// A live run's capture side: on the port's worker thread when there is one, else (virtual clocks) in turns between
// training steps. Between begin and end the queue belongs to it. All do nothing when the cameras are stopped.
sv_status sv_app_continuous_begin(sv_app *app, sv_err *err) SV_MUST_USE;
// One piece of work that is not training, if one is due; *is_train: none was, train.
sv_status sv_app_continuous_turn(sv_app *app, bool *is_train, sv_err *err) SV_MUST_USE;
void sv_app_continuous_trained(sv_app *app, double from_s, double now_s); // a training step has taken so long
sv_status sv_app_continuous_end(sv_app *app, sv_err *err) SV_MUST_USE;

// Places the exposures of a source without poses, before training (app.c says what it does with them). Without
// odometry says that the rig is taken as standing still.
sv_status sv_app_track(sv_app *app, sv_err *err) SV_MUST_USE;

// With is_refining: training's poses into the pool, how far they moved into the log, all of them into poses.json, as
// subview-calibrate pose writes them.
sv_status sv_app_save_poses(sv_app *app, sv_err *err) SV_MUST_USE;

// --- moving scenes (moving.c) --------------------------------------------------------------------
void sv_app_plan_moving(const sv_app_cfg *cfg, sv_train_cfg *t);
// The model's time of a moment of the cameras' host time.
float sv_app_time_of(const sv_app *app, sv_ns time_ns);
void sv_app_begin_moving(sv_app *app); // the exposures are there, training begins
// Whether the newest exposure has had its time; always, where nothing moves.
bool sv_app_is_exposure_due(const sv_app *app);
sv_status sv_app_leave_exposure(sv_app *app) SV_MUST_USE;
sv_status sv_app_enter_exposure(sv_app *app, int slot, float progress) SV_MUST_USE;
sv_status sv_app_save_motion(sv_app *app, sv_err *err) SV_MUST_USE; // motion.bin (save.c)

// --- pieces (report.c, save.c, preview.c) ---------------------------------------------------------
sv_status sv_app_save_model(sv_app *app, sv_err *err) SV_MUST_USE;      // model.ply
sv_status sv_app_save_checkpoint(sv_app *app, sv_err *err) SV_MUST_USE; // checkpoint.bin
// All that a run leaves but run.json: model, motion, poses, checkpoint, preview.
sv_status sv_app_save_all(sv_app *app, sv_err *err) SV_MUST_USE;
uint64_t sv_app_origin(const char *source); // the trainer's origin, of a source string; NULL: of none
sv_status sv_app_resume(sv_app *app, sv_err *err) SV_MUST_USE; // AGAIN: there is no checkpoint
// run.json: settings, digest, ledger, timing, memory map. extra: more JSON members ("\"psnr\": 27.1") or NULL.
sv_status sv_app_save_report(sv_app *app, const char *extra, sv_err *err) SV_MUST_USE;
// Size of the preview picture of such a run.
void sv_app_preview_size(const sv_app_cfg *cfg, int *width_px, int *height_px);
// Hands a picture to the port's publisher as "preview": the first training picture beside its rendering. Of a
// multiplexed rig: what the first sensor measured, the same from the model, and what its middle lens alone would
// see, enlarged; each pixel for so many of the sensor that the three fit into SV_APP_CAP_PREVIEW_PX.
sv_status sv_app_publish_preview(sv_app *app) SV_MUST_USE;
// Training picture i (counted round) beside its rendering, reduced by whole steps to fit cap_w x cap_h, and its PSNR.
// Of a multiplexed rig: what sensor i measured beside the same from the model.
sv_status sv_app_picture(sv_app *app, uint32_t i, int cap_w, int cap_h, uint8_t *rgb, int *w, int *h,
                         double *psnr) SV_MUST_USE;
// N pictures round the scene's centre at the height of the first view, handed out as "orbit_000", ...
sv_status sv_app_publish_orbit(sv_app *app, int n) SV_MUST_USE;
// Up in the world: the mean of the pictures' up (-y when there are none).
void sv_app_up(const sv_app *app, float up[3]);
// The memory map as text: a line a part, the sum, the capacity.
void sv_app_memory_map(sv_str *out, const sv_arena *arena, bool is_json);

#ifdef __cplusplus
}
#endif
#endif
