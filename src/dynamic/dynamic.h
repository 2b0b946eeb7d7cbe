// SPDX-License-Identifier: Apache-2.0
// Motion of a scene in training: which times are trained on when, what moves, how its motion is
// found and learnt. Owns the motion model (src/deform), its optimizer's state and the statistics of
// the search; the Gaussians are the trainer's. Attached to a trainer by its hooks
// (src/train/hooks.h); a still scene has none, and nothing here runs.
#ifndef SV_DYNAMIC_DYNAMIC_H
#define SV_DYNAMIC_DYNAMIC_H

#include "src/deform/deform.h"
#include "src/dynamic/local_motion.h"
#include "src/train/train.h"

#ifdef __cplusplus
extern "C" {
#endif

// "Progress" is that of the run, 0 to 1; learning rates are Adam's; "coefficients" are those of
// per-Gaussian motion.
typedef struct {
  // The motion model: none (the scene is still), per-Gaussian motion, or one field that all
  // Gaussians share. Default none.
  sv_deform_kind kind;
  // Functions of time of per-Gaussian motion. Default Chebyshev polynomials.
  sv_motion_functions_kind functions;
  sv_field_cfg field; // Sizes and rates of the field. Default: the preset "medium".

  // Progress at which Gaussians begin to move; one still model is trained before it. Default 0.1.
  float from;
  // With a field: progress at which per-Gaussian motion, trained until then, is distilled into the
  // field (distil.h); with 0 the field begins at rest, as in the paper. Default 0.8.
  float distil_at;
  // Steps of the regression that fits the field to per-Gaussian motion, as a share of the expected
  // steps. Default 0.22.
  float fit;
  // Share of the field's steps whose target is a rendering of the distilled model at a time between
  // two images. Default 0.25.
  float distilled;

  float find_every; // Progress from one search for what moves to the next. Default 0.04.
  float find_until; // Progress of the last search. Default 0.6.
  // A Gaussian moves from now on when its temporal residual (standard deviation over time of its
  // mean absolute residual, display values, in any camera) is larger. Default 0.01.
  float residual_min;
  // Static thresholds: a Gaussian comes to rest when it moves by less than so many pixels ...
  float static_px;     // Default 0.25.
  float static_fade;   // ... its opacity changes by less than this (0 to 1; default 0.1) ...
  float static_colour; // ... and its colour by less than this (display values; default 0.01).

  // Number of functions of time for position, rotation and colour. Defaults 6, 3 and 1;
  // sv_dynamic_set_times sets all three, of colour half as many as of position.
  int n_pos, n_rot, n_colour;
  float lr_pos;     // Learning rate of position coefficients, times that of the means. Default 3.
  float lr_rot;     // Learning rate of rotation coefficients. Default 6e-4.
  float lr_colour;  // Learning rate of color coefficients. Default 6e-4.
  float lr_window;  // Learning rate of the centre and the sharpness of a Gaussian's window in time.
                    // Default 0.01.
  float reg_pos;    // Weight of the mean length of position coefficients, per scene radius. Default
                    // 0.01.
  float reg_rot;    // Weight of the mean length of rotation coefficients. Default 1e-3.
  float reg_colour; // Weight of the mean length of color coefficients. Default 1e-3.
  // Group lasso: each step shortens the position coefficients (those of function j count j + 1
  // times) by so much of the learning rate, so that motion stays straight, slow or absent unless
  // gradients ask for it steadily. Default 0.1.
  float shrink_pos;

  // Temporal curriculum. Until `from` only the images within grow_start (time, 0 to 1) of the
  // middle one are trained on; then the others are added outwards, and from grow_until on there are
  // all. Fast motion is so matched from one image to the next, where a model of all times at once
  // would smear it. grow_until 0: all times from the start. Defaults 0.02 and 0.5.
  float grow_start, grow_until;
  float coarse_for; // Progress for which the images of a new time are taken at reduced size.
                    // Default 0.1.
  int front_every;  // Until grow_until every so many steps take a frontier frame, the latest added.
                    // Default 2; 0: none.
  // Rigid bodies that are looked for, at most; with a temporal curriculum, in which what moves is
  // matched in the images of a new time before they are trained on (match.c). Default
  // SV_CAP_BODIES - 1.
  int n_bodies;
  float lr_body; // Learning rate of the bodies' poses, times that of the means. Default 7.
  // Smallest share of the turns that images of unusually long or short lenses get
  // (sv_dynamic_turn_share). Default 0.2.
  float share_min;
  float window_start; // Half width in time of the window of a relocated Gaussian; 0: its source's.
                      // Default 0.4.
  // Continuous capture: one of so many steps takes any view in turn, the others one of the newest
  // time; 0: all in turn. Default 0.
  int older_every;
  // Continuous capture: images are reduced at least so much, 1, 2 or 4. Default 1.
  int min_scale;
  // Exposures after which a Gaussian that no view sees may be placed anew, 1 to 254. Default 8.
  int keep_hidden;
} sv_dynamic_cfg;

// Normal equations of one Gaussian's displacement in pixels, over the cameras: 3 x 3 symmetric by
// rows.
typedef struct {
  float a[6], b[3], r2;
  int n; // cameras
} sv_match_sum;

// Body assignment of one Gaussian (body_assignment.c): its position (world) at a knot, the bodies
// near it (0: no more), and the difference of its colour from the images', summed over n of them,
// with its own motion (a body's part: at rest) and as a part of each of them.
#define SV_DYNAMIC_NEAR_BODIES 3
typedef struct {
  float x[3], err[1 + SV_DYNAMIC_NEAR_BODIES], n[1 + SV_DYNAMIC_NEAR_BODIES];
  uint8_t body[SV_DYNAMIC_NEAR_BODIES], knot;
} sv_body_assignment;

// Of the present optimizer's step.
typedef struct {
  sv_motion_values f;
  sv_motion_args args;
  sv_adam_args adam;
  float lr[SV_CAP_MROWS];
} sv_dynamic_update;

typedef struct {
  sv_dynamic_cfg cfg;
  sv_trainer *t;
  sv_deform deform;
  sv_gaussians distilled; // per-Gaussian motion's, as they were when it was distilled (distil.h)
  float time;             // of the last rendering
  float usual_sr;         // median solid angle of the images, in the small-angle form
  float usual_fx_px;      // focal length of that image
  float next_search;      // progress
  float matched_until;    // progress up to which new times were matched
  uint32_t field_step;    // of the field's stage
  uint32_t fit_steps_left;
  uint32_t n_renewed; // ever
  // [cap] exposures for which no view has seen a Gaussian, at most 255 (renew.c)
  uint8_t *hidden_for;
  uint8_t *is_moving; // [cap] 0: static, 1: moves, 2: began to move since the last sort
  // [cap] each, of the search: frames that saw a Gaussian, mean and squared deviations of its
  // residual over them, largest deviation over the cameras; pixels of the current frame, and the
  // sum of their residuals.
  float *n_seen, *residual_mean, *residual_dev, *temporal_residual, *share, *residual;
  sv_match_sum *match;   // [cap], NULL unless new times are matched
  sv_local_motion *near; // as match
  // [tasks of the optimizer] gradients of the poses; NULL without bodies
  float (*body_sum)[SV_CAP_BODIES][6];
  sv_body_assignment *assignment; // [cap], NULL without bodies
  sv_dynamic_update update;
} sv_dynamic;

sv_dynamic_cfg sv_dynamic_defaults(void);
// Functions of time, the field's points along time and the pace of the curriculum for so many
// times.
void sv_dynamic_set_times(sv_dynamic_cfg *cfg, int expected_steps, int n_times);
// Whether a run begins with per-Gaussian motion; whether it looks for rigid bodies.
bool sv_dynamic_has_clip(const sv_dynamic_cfg *cfg);
bool sv_dynamic_has_bodies(const sv_dynamic_cfg *cfg);

// Memory beside that of the trainer with these settings; 0 for still scenes.
size_t sv_dynamic_bytes(const sv_dynamic_cfg *cfg, const sv_train_cfg *train);
// Attaches motion to a trainer whose cfg.has_motion is set, before views are added. E_ARG names a
// bad setting in err. With kind NONE only clears *dyn. The trainer must outlive it.
sv_status sv_dynamic_init(sv_dynamic *dyn, const sv_dynamic_cfg *cfg, sv_trainer *t, sv_arena *arena,
                          sv_err *err) SV_MUST_USE;

// Looks at every training time with the model as it is: a Gaussian whose residual changes with time
// by more than cfg.residual_min moves from now on. Also decides which body each Gaussian is
// assigned to.
sv_status sv_dynamic_search(sv_dynamic *dyn, float progress) SV_MUST_USE;
// FNV-1a over the bits of a motion model's parameters, going on from hash h.
uint64_t sv_dynamic_digest(const sv_deform *deform, uint64_t h);

#ifdef __cplusplus
}
#endif
#endif
