// SPDX-License-Identifier: Apache-2.0
// Training a fixed number of Gaussians on images. One step takes one view, or one region of a
// sensor on which lens images overlap (src/rig/forward.h), compares it with a rendering and moves
// the Gaussians that it touched; dead Gaussians are relocated to where the error is (3DGS-MCMC,
// Kheradmand et al. 2024, weighted by error).
// Owns the Gaussians, the optimizer's state, the renderer and the losses, all carved at init. Never
// owns images, and never knows of motion or sparse-view priors, which attach by hooks.h. Parts:
// step.h, optimize.h, curvature.h, relocate.h, supersample.h, measurement.h, novel.h, poses.h,
// checkpoint.h. Settings: train_cfg.h.
#ifndef SV_TRAIN_TRAIN_H
#define SV_TRAIN_TRAIN_H

#include "src/image/deep.h"
#include "src/loss/photometric.h"
#include "src/loss/smooth.h"
#include "src/loss/tv.h"
#include "src/rig/forward.h"
#include "src/splat/render.h"
#include "src/train/appearance.h"
#include "src/train/hooks.h"
#include "src/train/rolling.h"
#include "src/train/train_cfg.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  sv_view view;
  sv_image_u8 image;  // not copied: must live as long as the trainer, and so must its mask
  float share;        // of the pixels, that its mask lets count; above 0
  sv_image_deep deep; // with px: what it is trained on, in the place of the image (appearance.h)
} sv_train_view;

typedef struct {
  sv_multiplexed model; // the lenses, too, must live as long as the trainer
  const uint16_t *px;   // [height][width][3] display values of 65535
  // [height][width] sum of w (1 - alpha) over the lenses / M_max, of 65535: what they see through.
  // NULL: not known
  const uint16_t *clear;
  int n_x, n_y; // regions
} sv_train_measurement;

typedef struct {
  int i_view; // of the views, then of the regions; -1: the call was no step (src/dynamic/distil.h)
  int scale;
  double loss, l1, ssim; // of this step's view or region
  uint32_t n_touched;
} sv_step_stats;

typedef struct {
  sv_planes mean; // the last rendering, of the size of its target
  sv_planes grad; // of its samples
  float *err;     // the same
} sv_supersample;

typedef struct {
  double *cum;              // [cap] cumulative weights
  int32_t *copies, *source; // [cap]
} sv_relocation;

// What is behind the model (background.h).
typedef struct {
  uint32_t rgb;  // 0xRRGGBB
  bool is_guess; // nobody knows what it looks like
} sv_train_background;

#define SV_TRAIN_SUM_MORE 4 // rows of sv_trainer.sum beside those of the parameters

struct sv_trainer {
  sv_train_cfg cfg;
  sv_compute compute;
  const sv_train_hooks *hooks; // NULL: none
  void *hooked;                // their self
  sv_gaussians g;
  // bfloat16, laid out as g.param: running means of the gradient, and of its squares (Adam) or the
  // curvature
  uint16_t *m, *v;
  // [cap / 16][3][16] bfloat16: curvature that couples the coordinates of a mean
  // (kernels/newton/newton.h); NULL with Adam
  uint16_t *cross;
  float *err; // [cap] running mean of each Gaussian's blended error
  // [n_threads][SV_TRAIN_BLOCK_FLOATS] gradients of one block: Gaussians, error, motion
  float *block;
  // [cap / 16][n_rows + SV_TRAIN_SUM_MORE][16] of a step with several images, then the error, then
  // products of a mean's coordinates (curvature). Or NULL
  float *sum;
  uint32_t *sum_touched; // [cap / 16][2] lanes with a gradient, lanes with an error
  float *floor;          // [cap] minimum log-scales, NULL without min_scale_px
  sv_relocation relocation;
  uint32_t *touched_of; // [cap / 16 / blocks a task + 1]
  sv_renderer render;
  sv_photometric photometric;
  sv_tv tv;
  sv_smooth smooth;   // with cfg.weight_smooth
  sv_forward forward; // of regions
  sv_supersample supersample;
  sv_train_poses poses;
  sv_appearance appearance;
  sv_rolling rolling;
  // Image planes. The rule of who may write which when:
  // - target is of the step's image: written when it is loaded, read until its loss is known. From
  //   then on it is free for reuse (curvature.c puts the probe's signs there).
  // - grad and err_plane are of that image, too: from its loss to the end of its backward pass.
  // - part_grad and part_err are of one rendering of several (a lens's part of a region, a novel
  //   view, an image that a hook adds): from its loss to the end of its backward pass.
  // - Between steps, and in the hooks choose_view, after_step and search, all of them are free.
  //   Nothing in them outlives a step.
  sv_planes target;
  sv_planes grad;   // dL/d(rendering)
  float *err_plane; // mean |residual| over the channels
  sv_planes part_grad;
  float *part_err;
  float *part_trans; // of a lens's part, over a random background
  float *unpack_scratch;
  sv_train_view *views;               // [cap_views]
  sv_train_measurement *measurements; // [cap_measurements]
  int *order;                         // [cap_views + cap_regions] this epoch's order
  int n_views, n_measurements, n_regions, i_order;
  double share; // sum over the views
  // Largest time of a view; and that of the view closest to 0.5, which depth maps and the bodies'
  // rest are of.
  float newest_time, reference_time;
  float jitter[2];         // this epoch's shift of the regions, of a region
  float centre[3], radius; // of the scene
  sv_train_background background;
  uint32_t step;
  uint32_t n_relocated; // ever
  double trained_s;     // kept for a caller who trains by time: that of the runs before a resumed
                        // one, too
  // Kept for a caller, too: what is trained on, as a number that a checkpoint must share with the
  // run that resumes it.
  uint64_t origin;
  // Likewise, of deep pictures: what light is counted from, of someone else. A checkpoint puts that
  // of its run there. NULL: none.
  double *light;
  int n_light;
  sv_rng rng;
};

// The first of a Gaussian's three values of `cross`; the others are 16 values apart each.
static inline uint16_t *sv_train_cross_at(const sv_trainer *t, int i) {
  return t->cross + (size_t)(i >> 4) * 48 + (i & 15);
}

size_t sv_trainer_bytes(const sv_train_cfg *cfg);
// E_ARG and E_UNSUPPORTED name a bad setting in err. Kernels and pool must outlive the trainer.
sv_status sv_trainer_init(sv_trainer *t, const sv_train_cfg *cfg, sv_compute compute, sv_arena *arena,
                          sv_err *err) SV_MUST_USE;
// E_FULL when something is attached already.
sv_status sv_train_attach(sv_trainer *t, const sv_train_hooks *hooks, void *self) SV_MUST_USE;

// E_FULL beyond cap_views, E_RANGE when image and view differ in size or exceed the caps.
sv_status sv_train_add_view(sv_trainer *t, const sv_view *view, const sv_image_u8 *image,
                            sv_err *err) SV_MUST_USE;
// With is_deep, after the view was added: the same picture in 16 bits, which is not copied either.
void sv_train_set_deep(sv_trainer *t, int i_view, const sv_image_deep *deep);
// Instead of image i_view one of the same size from another pose.
void sv_train_replace_view(sv_trainer *t, int i_view, const sv_view *view, const sv_image_u8 *image);
// The mask of a view's image has other values than before.
void sv_train_mask_changed(sv_trainer *t, int i_view);
// All times of views become so much later (or earlier: negative).
void sv_train_shift_times(sv_trainer *t, float by);
// A sensor on which lens images overlap, with its measurement px[height][width][3], display values
// of 65535.
sv_status sv_train_add_measurement(sv_trainer *t, const sv_multiplexed *model, const uint16_t *px,
                                   sv_err *err) SV_MUST_USE;
// What the lenses of the last one see through (sv_train_measurement.clear), or NULL: known, it is
// trained on over random backgrounds.
void sv_train_set_clear(sv_trainer *t, const uint16_t *clear);
// Regions of a sensor, whose measurement is not larger than 16384 a side.
int sv_train_n_regions(int width_px, int height_px, int region_px);
// The first Gaussians; the scene's centre and radius are taken from init (random) or from the
// points.
sv_status sv_train_start(sv_trainer *t, const sv_init_cfg *init, const sv_point *point, int n_points,
                         sv_arena *scratch) SV_MUST_USE;
// Known scene bounds instead of what the start gave.
void sv_train_set_scene(sv_trainer *t, const float centre[3], float radius);

// One step (step.c). progress, 0 to 1: step/steps, or time/time limit. E_ARG without views and
// measurements.
sv_status sv_train_step(sv_trainer *t, float progress, sv_step_stats *out) SV_MUST_USE;

// Options with which a view is rendered at a progress (1 for evaluation).
sv_render_options sv_train_render_options(const sv_trainer *t, float progress, bool has_depth);
// Renders t->g as it is at a time 0..1 from now on. Does nothing for still scenes.
void sv_train_set_time(sv_trainer *t, float time);
// FNV-1a over the bits of all parameters, by index; and that of Gaussians alone.
uint64_t sv_train_digest(const sv_trainer *t);
uint64_t sv_gaussians_digest(const sv_gaussians *g);

#ifdef __cplusplus
}
#endif
#endif
