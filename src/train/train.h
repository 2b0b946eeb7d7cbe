// SPDX-License-Identifier: Apache-2.0
// Training a fixed number of Gaussians on images. One step takes one view, or one region of a
// sensor on which lens images overlap (src/rig/forward.h), compares it with a rendering and moves
// the Gaussians that it touched; dead Gaussians are relocated to where the error is (3DGS-MCMC,
// Kheradmand et al. 2024, weighted by error).
// Owns the Gaussians, the optimizer's state, the renderer and the losses, all carved at init. Never
// owns images, and never knows of motion or sparse-view priors, which attach by hooks.h. Parts:
// step.h, optimize.h, curvature.h, relocate.h, supersample.h, measurement.h, novel.h, poses.h,
// checkpoint.h.
#ifndef SV_TRAIN_TRAIN_H
#define SV_TRAIN_TRAIN_H

#include "src/loss/photometric.h"
#include "src/loss/tv.h"
#include "src/rig/forward.h"
#include "src/splat/render.h"
#include "src/train/hooks.h"
#include "src/train/poses.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum { SV_BG_BLACK, SV_BG_WHITE, SV_BG_RANDOM } sv_background;

// Adam's learning rates.
typedef struct {
  // Of means, at the start and the end of the run (log-linear between), times the scene radius.
  // Defaults 1.6e-4, 1.6e-6.
  float mean_start, mean_end;
  // Of quaternions, log-scales, opacity logits, SH degree 0 and higher degrees. Defaults 1e-3,
  // 1e-2, 0.05, 2.5e-3, 1.25e-4.
  float quat, scale, logit, sh0, sh_rest;
} sv_learning_rates;

// What moves the Gaussians. Motion and poses are always Adam's.
typedef enum { SV_OPTIMIZER_ADAM, SV_OPTIMIZER_GAUSS_NEWTON } sv_optimizer;
const char *sv_optimizer_name(sv_optimizer o); // "adam", "gauss-newton"
int sv_optimizer_by_name(const char *name);    // -1 when unknown

// Diagonal Gauss-Newton (curvature.c): p -= rate m / (h + damping mean(h)), with m the running mean
// of the gradient and h that of the Hutchinson estimates of the diagonal.
typedef struct {
  // Steps from one estimate of the diagonal to the next during the first first_steps steps.
  // Defaults 5 and 300.
  int first_every, first_steps;
  int every;        // Steps between estimates from then on. Default 17.
  int half_from;    // Step from which an estimate looks at half of the tiles. Default 1000.
  float keep;       // Share of its running mean that an estimate keeps, 0 to 1. Default 0.9.
  float rate_start; // Step length at the start of the run, a share of the Newton step. Default 0.1.
  // And at its end (log-linear between), times the square of the short-run boost, at most
  // rate_start. Default 0.02.
  float rate_end;
  bool is_hasty;   // Whether both rates are boosted in short runs, for few images, whose gradients
                   // agree. Default false.
  float damping;   // Weight of the mean diagonal over a block of 16 Gaussians. Default 1.
  float cap;       // No step is longer than so many of Adam's. Default 5.
  float cap_scale; // The same, of log-scales. Default 2.5.
} sv_newton_cfg;

typedef struct {
  int n_gaussians;      // Gaussians, 1 to 4,000,000; their number never changes. Default 20000.
  int sh_degree;        // Highest degree of spherical harmonics, 0 to 3. Default 1.
  int cap_views;        // Views that can be added. Default 64.
  int cap_measurements; // Multiplexed measurements (shared sensors) that can be added. Default 0.
  int cap_regions;      // Regions of all of them together (sv_train_n_regions). Default 0.
  // Side of a region in pixels, 16 or more; a smaller sensor is one region. Default 128.
  int region_px;
  int cap_width_px,
      // Largest width and height of any view, region and novel view. Defaults 640, 480.
      cap_height_px;
  // Largest padded number of pixels of a view; 0: width x height. Default 0.
  size_t cap_pixels;
  // Intersections (splat-tile pairs) of a rendering; 0: the renderer's default. Default 0.
  uint32_t cap_recs;
  int n_threads; // Threads of the pool, at most. Default 1.
  uint64_t seed; // Seed of all random draws. Default 1.
  // What images with alpha are laid over; others are trained over black. Default black.
  sv_background background;
  // Whether opacities are compensated (Mip-Splatting's 2D filter). Default false.
  bool is_antialiased;
  // Variance in px^2 of the renderer's low-pass. Default SV_DILATION_PX2.
  float dilation_px2;
  // Whether pixels of full-size images are means of 2 x 2 samples. Default false.
  bool is_supersampled;
  float supersample_from;       // Progress from which they are. Default 0.
  float weight_ssim;            // Lambda of (1 - lambda) L1 + lambda (1 - SSIM), 0 to 1. Default
                                // 0.2.
  float weight_tv;              // Weight of the squared total variation of rendered views. Default
                                // 0.
  float weight_tv_unseen;       // The same, of novel views. Default 0.
  float noise_read, noise_shot; // Noise added to predicted measurements (sv_forward_noise).
                                // Defaults 0: none.
  int n_unseen;                 // Novel views that are regularized in such a step. Default 0: none.
  int unseen_every;             // Steps from one with novel views to the next. Default 1.
  int unseen_px;                // Their longer side is reduced to at most so many pixels. Default
                                // 100.
  // Largest angle in rad by which a novel view is turned about the scene from a captured one.
  // Default 0.35.
  float unseen_rad;
  float reg_opacity,
      reg_scale;       // Regularization weights of mean opacity and mean scale (3DGS-MCMC).
                       // Defaults 0.01.
  float dropout;       // Share of the Gaussians that a step drops, 0 to 1. Default 0.
  float dropout_until; // Progress until which it does. Default 1.
  sv_learning_rates lr;
  sv_optimizer optimizer; // Default Gauss-Newton.
  sv_newton_cfg newton;
  int start_scale; // Coarse to fine: images are reduced by 1, 2, 4 or 8 at first. Default 4.
  float fine_at;   // Progress at which full size is reached. Default 0.3.
  float sh_step;   // Progress from one SH degree to the next; above 1 only degree 0 is trained.
                   // Default 0.2.
  // Steps from one relocation to the next; 0: none. Default 100.
  int relocate_every;
  // Progress between which there are relocations. Defaults 0.05 and 0.8.
  float relocate_from, relocate_until;
  float noise; // Factor on the SGLD position noise of low-opacity Gaussians. Default 1.
  // Minimum screen-space scale: smallest standard deviation of a Gaussian, in pixels of the view
  // that sees it sharpest. Default 0: none.
  float floor_px;
  int steps_hint; // Expected steps of the run, which set the short-run learning-rate boost. Default
                  // 3000; 0: no boost.
  // Whether motion will be attached (src/dynamic): no boost, no measurements, novel views, pose
  // refinement or priors. Default false.
  bool has_motion;
  // Whether hooks add images to a step (sv_train_hooks.add_images), which takes memory. Default
  // false.
  bool has_images;
  sv_train_poses_cfg poses; // Pose refinement. Default: none.
} sv_train_cfg;

typedef struct {
  sv_view view;
  sv_image_u8 image; // not copied: must live as long as the trainer
} sv_train_view;

typedef struct {
  sv_multiplexed model; // the lenses, too, must live as long as the trainer
  const uint16_t *px;   // [height][width][3] display values of 65535
  int n_x, n_y;         // regions
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

struct sv_trainer {
  sv_train_cfg cfg;
  sv_compute compute;
  const sv_train_hooks *hooks; // NULL: none
  void *hooked;                // their self
  sv_gaussians g;
  // bfloat16, laid out as g.param: running means of the gradient, and of its squares (Adam) or the
  // curvature
  uint16_t *m, *v;
  float *err; // [cap] running mean of each Gaussian's blended error
  // [n_threads][SV_TRAIN_BLOCK_FLOATS] gradients of one block: Gaussians, error, motion
  float *block;
  // [cap / 16][n_rows + 1][16] of a step with several images, last row: error. Or NULL
  float *sum;
  uint32_t *sum_touched;    // [cap / 16][2] lanes with a gradient, lanes with an error
  float *floor;             // [cap] minimum log-scales, NULL without min_scale_px
  double *cum;              // [cap] cumulative relocation weights
  int32_t *copies, *source; // [cap] of a relocation
  uint32_t *touched_of;     // [cap / 16 / blocks a task + 1]
  sv_renderer render;
  sv_photometric photometric;
  sv_tv tv;
  sv_forward forward; // of regions
  sv_supersample supersample;
  sv_train_poses poses;
  sv_planes target; // of the image that a step compares with
  sv_planes grad;   // dL/d(rendering) of that image
  float *err_plane; // its mean |residual| over the channels
  // Of one rendering of several: a lens's part of a region, or a novel view.
  sv_planes part_grad;
  float *part_err;
  float *unpack_scratch;
  sv_train_view *views;               // [cap_views]
  sv_train_measurement *measurements; // [cap_measurements]
  int *order;                         // [cap_views + cap_regions] this epoch's order
  int n_views, n_measurements, n_regions, i_order;
  // Largest time of a view; and that of the view closest to 0.5, which depth maps and the bodies'
  // rest are of.
  float newest_time, reference_time;
  float jitter[2];         // this epoch's shift of the regions, of a region
  float centre[3], radius; // of the scene
  uint32_t step;
  uint32_t n_relocated; // ever
  double trained_s;     // kept for a caller who trains by time: that of the runs before a resumed
                        // one, too
  // Kept for a caller, too: what is trained on, as a number that a checkpoint must share with the
  // run that resumes it.
  uint64_t origin;
  sv_rng rng;
};

sv_train_cfg sv_train_defaults(void);
size_t sv_trainer_bytes(const sv_train_cfg *cfg);
// E_ARG and E_UNSUPPORTED name a bad setting in err. Kernels and pool must outlive the trainer.
sv_status sv_trainer_init(sv_trainer *t, const sv_train_cfg *cfg, sv_compute compute, sv_arena *arena,
                          sv_err *err) SV_MUST_USE;
// E_FULL when something is attached already.
sv_status sv_train_attach(sv_trainer *t, const sv_train_hooks *hooks, void *self) SV_MUST_USE;

// E_FULL beyond cap_views, E_RANGE when image and view differ in size or exceed the caps.
sv_status sv_train_add_view(sv_trainer *t, const sv_view *view, const sv_image_u8 *image,
                            sv_err *err) SV_MUST_USE;
// Instead of image i_view one of the same size from another pose.
void sv_train_replace_view(sv_trainer *t, int i_view, const sv_view *view, const sv_image_u8 *image);
// All times of views become so much later (or earlier: negative).
void sv_train_shift_times(sv_trainer *t, float by);
// A sensor on which lens images overlap, with its measurement px[height][width][3], display values
// of 65535.
sv_status sv_train_add_measurement(sv_trainer *t, const sv_multiplexed *model, const uint16_t *px,
                                   sv_err *err) SV_MUST_USE;
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
