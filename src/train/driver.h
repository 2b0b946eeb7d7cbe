// SPDX-License-Identifier: Apache-2.0
// The training driver: objective, first model, loop, PSNR and settings report of a training run.
// Both `subview run` and `subview-lab train` use it. Owns the loop's clock, the mean loss and the
// step times; the trainer and its views are the caller's. Never captures, reads or writes files,
// and takes no memory of its own.
#ifndef SV_TRAIN_DRIVER_H
#define SV_TRAIN_DRIVER_H

#include "src/base/str.h"
#include "src/port/port.h"
#include "src/rig/bounds.h"
#include "src/splat/model_file.h"
#include "src/splat/support.h"
#include "src/train/time_stats.h"
#include "src/train/objective.h"
#include "src/train/plateau.h"
#include "src/train/train.h"

#ifdef __cplusplus
extern "C" {
#endif

// --- objective -----------------------------------------------------------------------------------

// Focal lengths of the views that are trained on. All zero: none yet.
typedef struct {
  float min_px, max_px;
} sv_focal_range;

void sv_focal_range_add(sv_focal_range *f, float focal_px);
// Views of the scene at so different scales need anti-aliasing (Mip-Splatting).
bool sv_focal_range_needs_antialiasing(const sv_focal_range *f);

// The objective that suits the sampling (src/train/objective.h). `optimizer` is 1 + an
// sv_optimizer, or 0 for the sampling's own. cfg->is_antialiased and n_gaussians are known before.
void sv_driver_set_objective(sv_train_cfg *cfg, const sv_sampling *sampling, int optimizer);

// --- first model ---------------------------------------------------------------------------------

// Bytes of scratch that the start needs, for up to n_points points.
size_t sv_driver_scratch_bytes(const sv_train_cfg *cfg, int n_points);

// Where the first Gaussians are. The caller fills in init and n_points, or has sv_driver_measure do
// it.
typedef struct {
  sv_bounds bounds;  // where the scene is about
  sv_init_cfg init;  // how Gaussians start; of kind SV_INIT_POINTS: at points
  sv_point *points;  // [cap_points] the caller's
  int cap_points;    // at least n_gaussians, for sv_driver_measure
  int n_points;      // that are there
  int n_maps;        // depth maps that sv_driver_measure made
  bool is_scene_set; // bounds are the scene's, also where init would find others
  sv_arena *scratch; // sv_driver_scratch_bytes
  // Called with self during long work of sv_driver_measure, which makes progress; may be NULL.
  void (*beat)(void *self);
  void *self;
} sv_driver_start;

// Points on the surface, from depth maps of the trainer's own views. Lens images of multiplexed
// sensors are told apart first by a model of a short training (demultiplex.h); it takes the place
// of the trainer's Gaussians. AGAIN: the views overlap too little.
sv_status sv_driver_measure(sv_trainer *t, sv_driver_start *start, sv_err *err) SV_MUST_USE;
// Places the first Gaussians.
sv_status sv_driver_place(sv_trainer *t, const sv_driver_start *start, sv_err *err) SV_MUST_USE;

// --- loop ----------------------------------------------------------------------------------------

// What before_step tells the loop.
typedef struct {
  bool is_other_work;  // something else was done; ask again before the next step
  bool has_taken_time; // time has passed that is training time, but not that of the step
  double away_s;       // seconds that passed and are no training time (paused, an external program)
} sv_driver_turn;

typedef struct {
  uint32_t n_steps; // the run ends when the trainer has done so many steps; 0: no such limit
  // The run ends after so many seconds of training; 0: no such limit. One of both is needed
  double limit_s;
  // Progress that all schedules see, 0 to 1; 0: that of the run. For runs without an end in view,
  // in which every moment is like the last.
  float steady_progress;
  // The run ends by itself when less than this is won a second on pixels that are kept from
  // training (src/train/plateau.h), as `measure` tells; 0: at its limits alone.
  double least_db_per_s;
  // Of sv_driver_scratch_bytes, kept from the start: the cameras' colors are then measured again on
  // the model as it has become, at a quarter and at half of the run. NULL: at the start alone.
  sv_arena *scratch;
  sv_clock clock;     // of the machine
  sv_console console; // progress lines and the stop request; members may be NULL
  void *self;
  // Called before each step; may be NULL.
  sv_status (*before_step)(void *self, float progress, sv_driver_turn *turn, sv_err *err);
  // Whether a run whose seconds are over may end now. NULL: at once.
  bool (*may_end)(void *self);
  // Called after each step, which ran from from_s to now_s of the clock. *now_s is moved on by what
  // it takes, which is training time. May be NULL.
  sv_status (*after_step)(void *self, double from_s, double *now_s, sv_err *err);
  // PSNR in dB on pixels that are kept from training; with least_db_per_s.
  sv_status (*measure)(void *self, double *psnr);
  // Adds to the progress line; may be NULL.
  void (*add_progress)(void *self, sv_str *line);
} sv_driver_cfg;

typedef struct {
  sv_driver_cfg cfg;
  // Seconds spent training in this run, without those of a run that it resumes
  double train_s;
  double loss;             // running mean over about the last 50 steps
  sv_time_stats step_time; // of this run's steps; n is their number
  sv_step_stats last;
  sv_plateau plateau; // with cfg.least_db_per_s
  float progress;     // before the last step
} sv_driver;

// Trains until a limit is reached. E_INTERRUPTED after a stop request; trained_s of the trainer is
// kept up to date.
sv_status sv_driver_run(sv_driver *d, const sv_driver_cfg *cfg, sv_trainer *t, sv_err *err) SV_MUST_USE;
double sv_driver_steps_per_s(const sv_driver *d);

// --- views ---------------------------------------------------------------------------------------

// Views that are trained on, lens images of multiplexed sensors included.
int sv_driver_n_views(const sv_trainer *t);
const sv_view *sv_driver_view(const sv_trainer *t, int i);

// Support of a still scene's Gaussians by these views (src/splat/support.h), in the scratch, of
// which it takes sv_support_bytes. Uses the trainer's planes, between steps.
sv_status sv_driver_support(sv_trainer *t, sv_arena *scratch, sv_support *out) SV_MUST_USE;
// As JSON: {"views": 6, "unseen": ..., "one_view": ..., "angle_deg": ..., "supported": ...}.
void sv_driver_add_support(sv_str *out, const sv_support_summary *s);

// --- evaluation ----------------------------------------------------------------------------------

// The finished model as the camera of a view sees it; *out is valid until the next rendering.
sv_status sv_driver_render(sv_trainer *t, const sv_view *view, const sv_planes **out) SV_MUST_USE;
// The same with a training view's rolling shutter.
sv_status sv_driver_render_view(sv_trainer *t, int i_view, const sv_planes **out) SV_MUST_USE;
// Mean squared error against an image [height][width][3] of a view, values 0 to 1.
sv_status sv_driver_mse(sv_trainer *t, const sv_view *view, const uint8_t *rgb, double *mse) SV_MUST_USE;
// The same with `light` times the rendering's light.
sv_status sv_driver_lit_mse(sv_trainer *t, const sv_view *view, float light, const uint8_t *rgb,
                            double *mse) SV_MUST_USE;
// The same against a training image, as its camera shows the model. mask [height][width]: over
// other pixels than those that are trained on; NULL: over these.
sv_status sv_driver_view_mse(sv_trainer *t, int i_view, const uint8_t *mask, double *mse) SV_MUST_USE;
// Mean PSNR in dB over the images that are trained on; of a multiplexed rig over the sensors'
// measurements.
sv_status sv_driver_training_psnr(sv_trainer *t, double *psnr) SV_MUST_USE;

// --- settings ------------------------------------------------------------------------------------

const char *sv_background_name(sv_background b); // "black"
// The settings that the trainer works with, as JSON members: "\"sh\": 1, ..., \"seed\": 1".
void sv_driver_add_settings(sv_str *out, const sv_trainer *t);
// What a file of the model says of how it is rendered; up and unit are the caller's to fill in.
sv_model_notes sv_driver_notes(const sv_trainer *t);

#ifdef __cplusplus
}
#endif
#endif
