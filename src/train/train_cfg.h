// SPDX-License-Identifier: Apache-2.0
// Settings of training. Each field says its meaning, unit, range and default; sv_train_defaults
// gives the defaults. Owns nothing. Never says which settings suit a dataset: objective.h does.
#ifndef SV_TRAIN_TRAIN_CFG_H
#define SV_TRAIN_TRAIN_CFG_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "src/train/appearance.h"
#include "src/train/poses.h"

// What training takes when nothing is said, also in the words of the programs' --help.
#define SV_DEFAULT_GAUSSIANS 20000
#define SV_DEFAULT_SH_DEGREE 1
#define SV_DEFAULT_STEPS     3000 // of a dataset
#define SV_DEFAULT_RUN_STEPS 2000 // of `subview run`: somebody waits beside the cameras
#define SV_DEFAULT_SEED      1

#ifdef __cplusplus
extern "C" {
#endif

// What is behind the model. The last two look at pictures without alpha (background.h): BACKDROP at
// a flat backdrop's color, black where there is none; OF_PICTURES at their mean color then.
typedef enum { SV_BG_BLACK, SV_BG_WHITE, SV_BG_RANDOM, SV_BG_BACKDROP, SV_BG_OF_PICTURES } sv_background;

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
// Mixed: means by Gauss-Newton, all other parameters by Adam.
typedef enum { SV_OPTIMIZER_ADAM, SV_OPTIMIZER_GAUSS_NEWTON, SV_OPTIMIZER_MIXED } sv_optimizer;
const char *sv_optimizer_name(sv_optimizer o); // "adam", "gauss-newton", "mixed"
int sv_optimizer_by_name(const char *name);    // -1 when unknown

// Gauss-Newton (curvature.c): p -= rate m / (h + damping mean(h)), with m the running mean of the
// gradient and h that of the Hutchinson estimates of the curvature: of a mean a matrix of its three
// coordinates, of all others the diagonal.
typedef struct {
  // Steps from one estimate to the next during the first first_steps steps.
  // Defaults 5 and 300.
  int first_every, first_steps;
  int every;        // Steps between estimates from then on. Default 17.
  int half_from;    // Step from which an estimate looks at half of the tiles. Default 1000.
  float keep;       // Share of its running mean that an estimate keeps, 0 to 1. Default 0.9.
  float rate_start; // Step length at the start of the run, a share of the Newton step. Default 0.1.
  // And at its end (log-linear between), times the square of the short-run boost, at most
  // rate_start. Default 0.02.
  float rate_end;
  // Whether both rates are boosted in short runs, for few images, whose gradients agree. Default
  // false.
  bool is_boosted;
  float damping;      // Weight of the mean diagonal over a block of 16 Gaussians. Default 1.
  float damping_mean; // The same, of means. Default 0.03.
  // The same, of log-scales and opacities: how much of a picture a Gaussian takes. Default 1.
  float damping_size;
  // Longest step of a mean, a share of the geometric mean of the Gaussian's axes. Default 0.06.
  float cap_mean;
  float cap_scale; // Of log-scales, in steps of Adam. Default 2.5.
  float cap;       // The same, of all others. Default 5.
} sv_newton_cfg;

typedef struct sv_train_cfg {
  int n_gaussians;      // Gaussians, 1 to 4,000,000; their number never changes. Default 20000.
  int sh_degree;        // Highest degree of spherical harmonics, 0 to 3. Default 1.
  int cap_views;        // Views that can be added. Default 64.
  int cap_measurements; // Multiplexed measurements (shared sensors) that can be added. Default 0.
  int cap_regions;      // Regions of all of them together (sv_train_n_regions). Default 0.
  // Side of a region in pixels, 16 or more; a smaller sensor is one region. Default 128.
  int region_px;
  // Lens images of all measurements that can be told apart for the first model (demultiplex.h), and
  // the largest width, height and number of pixels of one. Default 0: none, the start is random.
  int cap_lenses, cap_lens_width_px, cap_lens_height_px;
  size_t cap_lens_px;
  // Whether the views are such lens images: depth maps of them are checked more strictly. Default
  // false.
  bool has_lens_views;
  // Largest width and height of any view, region and novel view. Defaults 640, 480.
  int cap_width_px, cap_height_px;
  // Largest padded number of pixels of a view; 0: width x height. Default 0.
  size_t cap_pixels;
  // Intersections (splat-tile pairs) of a rendering; 0: the renderer's default. Default 0.
  uint32_t cap_intersections;
  int n_threads; // Threads of the pool, at most. Default 1.
  uint64_t seed; // Seed of all random draws. Default 1.
  // What images are laid over: random colors where they have alpha, black where not. Default black.
  sv_background background;
  // Progress until which images with alpha, and measurements of which it is known what their lenses
  // see through, are laid over random colors whatever `background` is:
  // what one view sees through must not be opaque, in the color of the background. Default 0.
  float random_until;
  // Whether opacities are compensated (Mip-Splatting's 2D filter). Default false.
  bool is_antialiased;
  // Variance in px^2 of the renderer's low-pass. Default SV_DILATION_PX2.
  float dilation_px2;
  // Whether pixels of full-size images are means of 2 x 2 samples. Default false.
  bool is_supersampled;
  float supersample_from; // Progress from which they are. Default 0.
  // Lambda of (1 - lambda) L1 + lambda (1 - SSIM), 0 to 1. Default 0.2.
  float weight_ssim;
  // Weight of the squared total variation of rendered views. Default 0.
  float weight_tv;
  float weight_tv_novel; // The same, of novel views. Default 0.
  // Weights of the smoothness of novel views' depth, and of the reprojection of their colors to the
  // step's own picture (sv_reproject_colours). With one of them, novel views lie beside that
  // picture's, in its size, once it has full size. Defaults 0.
  float weight_smooth_novel, weight_reproject_novel;
  // Weight of the edge-aware smoothness of rendered depth (src/loss/smooth.h). Default 0.
  float weight_smooth;
  // With it, weight of the photometric reprojection of rendered depth to the other views of the
  // same exposure (src/loss/reproject.h). Default 0.
  float weight_reproject;
  // Views have deep pictures (sv_train_set_deep). Default false.
  bool is_deep;
  // Noise added to predicted measurements (sv_forward_noise). Defaults 0: none.
  float noise_read, noise_shot;
  int n_novel;     // Novel views that are regularized in such a step. Default 0: none.
  int novel_every; // Steps from one with novel views to the next. Default 1.
  int novel_px;    // Their longer side is reduced to at most so many pixels. Default 100.
  // Largest angle in rad by which a novel view is turned about the scene from a captured one;
  // beside the step's picture at most twice as far as the farthest other view. Default 0.35.
  float novel_rad;
  // Regularization weights of mean opacity and mean scale (3DGS-MCMC). Defaults 0.01.
  float reg_opacity, reg_scale;
  // Progress until which opacities are regularized: early, the weight finds what a model can do
  // without; later it would only dim what is left (docs/notes/quality.md). Default 0.2.
  float reg_opacity_until;
  float dropout;       // Share of the Gaussians that a step drops, 0 to 1. Default 0.
  float dropout_until; // Progress until which it does. Default 1.
  sv_learning_rates lr;
  // Progress from which all learning rates and Newton steps fall linearly, so that the model ends
  // as the mean of all views and not at the last ones; 1: they do not. Default 1.
  float settle_from;
  float settle_rate;      // Their factor at the end of the run, above 0 to 1. Default 0.1.
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
  // Share of the Gaussians that each relocation moves at least: dead ones first, then those that
  // matter least; long ones are cut in two where they go. 0 to 1. Default 0: dead ones alone.
  float relocate_share;
  // Progress until which it does; the rest of the run is fine-tuning. Default 0.4.
  float relocate_share_until;
  // Steps from one search for hidden Gaussians (hidden.h) to the next, a multiple of
  // relocate_every; 0: none. Default 0.
  int hidden_every;
  float noise; // Factor on the SGLD position noise of low-opacity Gaussians. Default 1.
  // Minimum screen-space scale: smallest standard deviation of a Gaussian, in pixels of the view
  // that sees it sharpest. Default 0: none.
  float min_scale_px;
  // Expected steps of the run, which set the short-run learning-rate boost; 0: no boost. Default
  // 3000.
  int expected_steps;
  // Whether motion will be attached (src/dynamic): no boost, no measurements, novel views, pose
  // refinement or priors. Default false.
  bool has_motion;
  // Whether hooks add images to a step (sv_train_hooks.add_images), which takes memory. Default
  // false.
  bool has_images;
  sv_train_poses_cfg poses; // Pose refinement. Default: none.
  // Whether views of rolling shutters are rendered row by row (src/train/rolling.h), which takes
  // memory. Default false.
  bool is_rolling;
  sv_appearance_cfg appearance; // Of cameras and exposures. Default: none.
} sv_train_cfg;

sv_train_cfg sv_train_defaults(void);

#ifdef __cplusplus
}
#endif
#endif
