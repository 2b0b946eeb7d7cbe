// SPDX-License-Identifier: Apache-2.0
// How motion (src/dynamic) and priors of sparse views (src/prior) attach to a trainer: functions
// that a step calls, in this order, and functions for state that goes along with the Gaussians. A
// still scene without priors has none. The trainer owns the step's order and never knows who is
// attached; whoever is attached outlives the training.
#ifndef SV_TRAIN_HOOKS_H
#define SV_TRAIN_HOOKS_H

#include <stdbool.h>
#include <stdint.h>

#include "src/format/sections.h"
#include "src/splat/render.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct sv_trainer sv_trainer;

// What a step takes.
typedef struct {
  int i_view;        // of the views, then of the regions; -1: this call is no step
  float progress;    // of the schedules: in, that of the run
  int min_scale;     // the image is reduced at least so much
  bool can_relocate; // default true
} sv_train_choice;

// The image that a step renders and compares with its target.
typedef struct {
  int i_view;
  int scale;
  float progress;
  bool is_supersampled;
  sv_view view; // as it is rendered, reduced
  sv_render_options options;
  float weight;                   // of the image, at most 1
  bool has_depth_loss;            // before_render asked for depth: add_loss is called
  bool is_surface;                // has losses of depth (surface.h)
  bool has_novel;                 // a novel view beside it follows (novel.h)
  bool has_target;                // t->target is filled already: not the view's own image
  const float *g_depth, *g_trans; // further gradients of the rendering, set by add_loss; NULL: none
} sv_train_image;

// Motion's part of the head of a checkpoint; zero in a still scene's.
typedef struct {
  int32_t kind, n_moving;
  float next_search, matched_until, lo[3], inv[3];
  uint32_t field_step, fit_steps_left;
} sv_checkpoint_motion;

// Each may be NULL; self is what sv_train_attach was given.
typedef struct {
  // A step's stages. First the choice, else the next view or region in random order.
  void (*choose_view)(void *self, sv_train_choice *c);
  // May change view, options, weight and target of the image.
  sv_status (*before_render)(void *self, sv_train_image *im);
  // A further loss of the rendering; called when before_render asked for depth.
  double (*add_loss)(void *self, sv_train_image *im);
  // Further images of this step, whose gradients are added up (sv_train_collect).
  bool (*has_images)(void *self, float progress);
  sv_status (*add_images)(void *self, float progress, const sv_render_options *o, double *loss);
  // After the parameters were updated, before relocation.
  sv_status (*after_step)(void *self, float progress);
  // At the end.
  sv_status (*search)(void *self, float progress);

  // State that goes along with the Gaussians.
  void (*start)(void *self);                  // the Gaussians were placed
  void (*set_time)(void *self, float time);   // the Gaussians as they are at that time
  void (*copy)(void *self, int to, int from); // a relocated Gaussian, of its source
  uint64_t (*digest)(const void *self, uint64_t h);
  void (*count)(const void *self, int *n_moving, uint32_t *n_renewed); // for statistics

  // An update of the parameters: before its blocks, whose Adam has these arguments; of one block
  // whose Gaussians were rendered moved: gradients of the moved ones, which become those of the
  // stored ones, and the step of the motion.
  void (*begin_update)(void *self, float progress, const sv_adam_args *adam);
  void (*update_block)(void *self, int block, int i_thread, uint32_t touched, float *grad, float *scratch);
  // The same gradients without a step, for estimates of the curvature.
  void (*pull_back)(void *self, int block, uint32_t touched, float *grad);

  // Checkpoints.
  size_t (*checkpoint_bytes)(const void *self);
  void (*save_head)(const void *self, sv_checkpoint_motion *head);
  sv_status (*save)(const void *self, sv_sections_writer *w, sv_err *err);
  bool (*is_loadable)(const void *self, const sv_checkpoint_motion *head);
  sv_status (*load)(void *self, const sv_sections *r, const sv_checkpoint_motion *head, sv_err *err);
} sv_train_hooks;

#define SV_TRAIN_HAS(t, hook) ((t)->hooks && (t)->hooks->hook)

#ifdef __cplusplus
}
#endif
#endif
