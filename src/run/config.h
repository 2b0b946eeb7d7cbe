// SPDX-License-Identifier: Apache-2.0
// C only: the capture queue's rings are atomic.
// The configuration of a run, and the sizes that follow from it.
// Owns nothing: rig, capabilities and names belong to the caller and outlive the run.
// Never looks at a source, an image or the trainer's state.
#ifndef SV_RUN_CONFIG_H
#define SV_RUN_CONFIG_H

#include "src/capture/guidance.h"
#include "src/capture/imu.h"
#include "src/capture/spacing.h"
#include "src/dynamic/dynamic.h"
#include "src/prior/methods.h"
#include "src/rig/bounds.h"
#include "src/sync/capture_queue.h"
#include "src/train/train.h"

// Default of the training time of each exposure of a live run.
#define SV_EXPOSURE_S 0.1

// Automatic: per camera where the colors of some are not known, per exposure where light is not
// locked; not while exposures are replaced.
typedef enum {
  SV_APPEARANCE_AUTO,
  SV_APPEARANCE_OFF,
  SV_APPEARANCE_CAMERAS,
  SV_APPEARANCE_EXPOSURES // and cameras
} sv_appearance_mode;
// "auto", "off", "cameras", "exposures"; -1: unknown
int sv_appearance_mode_by_name(const char *name);

typedef struct {
  // The rig whose sub-views are trained on.
  const sv_rig *rig;
  // Number of cameras of the source.
  int n_cameras;
  // [n_cameras] What each camera delivers.
  const sv_camera_caps *caps;
  // The source string: it appears in the report, and a checkpoint is only resumed for the same one.
  const char *source_name;
  // Name of the board for the page; NULL for none.
  const char *board_name;
  // The port has a feed, so memory for the page is needed.
  bool has_preview;
  // A screen shows cameras and model, too (sv_port.display). Default: false.
  bool has_screen;
  // With a feed: the run waits for Start on the page, and New begins another one.
  bool is_session;
  // In a session: captures without waiting for Start, as an interrupted run goes on. Default false.
  bool starts_at_once;
  // Exposures to capture and train on, at least 1.
  int n_exposures;
  // Largest time skew between the cameras of an exposure, in nanoseconds.
  sv_ns skew_limit_ns;
  // Which exposures are kept, of those that the cameras deliver.
  sv_spacing_cfg spacing;
  // What guidance while capturing asks for; the rig and, with has_bounds, the ball are filled in.
  sv_guidance_cfg guidance;
  // Share of the pixels that are kept from training, and scored at the end (src/capture).
  float hold_out;
  // With hold_out: training that wins less than so many dB a second on these pixels ends; 0: it
  // goes on to its limits.
  double least_db_per_s;
  // These pixels are in the depth maps of the start, and are trained on, too, when that is decided,
  // or in the last fifth of the run.
  bool is_held_released;
  // Synchronization method: who makes the cameras expose at the same time.
  sv_sync_method sync_method;
  // Capture goes on while training: new exposures replace the oldest.
  bool is_continuous;
  // The scene moves.
  bool is_dynamic;
  // With is_continuous and is_dynamic: training time of each exposure, in seconds.
  double exposure_s;
  // Likewise: seconds of the past that are kept as a sequence, and saved; 0: none.
  double history_s;
  // With is_continuous: seconds between preview images, when there is time for them; 0: none.
  double preview_every_s;
  // Capture fails when no exposure came for so long, in nanoseconds of the host's clock.
  sv_ns capture_timeout_ns;
  // Bit i: train on sub-view i. All zero: on all of them.
  uint64_t sub_view_mask[SV_CAP_SUB_VIEWS / 64];
  // Settings of the trainer; sizes and numbers of views are filled in by sv_app_train_cfg.
  sv_train_cfg train;
  // Settings of motion with is_dynamic: sv_dynamic_defaults(), or changed; what the exposures
  // decide is filled in.
  sv_dynamic_cfg dynamic;
  // Training ends after so many steps; 0: at the time limit.
  uint32_t steps;
  // Training ends after so many seconds; 0: no limit.
  double time_limit_s;
  // Sparse-view prior.
  sv_prior_method prior;
  // 1 + an sv_optimizer; 0: the one that suits the exposures.
  int optimizer;
  // Whether training learns what cameras and exposures do to color (src/train/appearance.h).
  sv_appearance_mode appearance;
  // Pictures are kept in 16 bits, and training compares in linear light (src/train/appearance.h).
  // Default false.
  bool is_deep;
  // Rolling shutters are taken for global ones. Default false.
  bool is_shutter_ignored;
  // Training refines the rig's poses; those of the first exposure are held.
  bool is_refining;
  // The source has no poses of the rig: find them from the images.
  bool is_tracking;
  // With is_tracking: tells which way is up; NULL: what the cameras see does. Outlives the run.
  const sv_imu *imu;
  // With is_tracking: exposures that are clearly less sharp than those before them are kept.
  bool is_blur_kept;
  // The scene lies in `bounds`, and training starts there; else bounds come from the views.
  bool has_bounds;
  sv_bounds bounds;
  // Resume from checkpoint.bin when it is there.
  bool is_resume;
  // Seconds between two checkpoints while training; 0: only at the end.
  double save_every_s;
  // Seconds between two preview images while training; 0: only with checkpoints.
  double picture_every_s;
} sv_app_cfg;

bool sv_app_is_trained_on(const sv_app_cfg *cfg, int i_sub_view);
int sv_app_n_trained_sub_views(const sv_app_cfg *cfg);
// The trainer's settings of such a run, with the objective that suits it.
sv_train_cfg sv_app_train_cfg(const sv_app_cfg *cfg, int n_threads);
// And of the prior, for so many training views.
sv_prior_cfg sv_app_prior_cfg(const sv_app_cfg *cfg, int n_views);

#endif
