// SPDX-License-Identifier: Apache-2.0
#include "src/train/objective.h"

#include "src/base/mathx.h"
#include "src/splat/constants.h"

// Where few exposures leave open what a scene is like elsewhere, each step leaves some Gaussians
// out: those that are left have to be right without them. So many with SV_FEW_EXPOSURES and fewer,
// none with MANY_EXPOSURES and more.
#define DROPOUT        0.35f
#define DROPOUT_GRID   0.2f  // sub-views beside each other pin it down, too
#define DROPOUT_UNTIL  0.85f // the rest of a run is for what all of them are like together
#define MANY_EXPOSURES 18

// Opacity is regularized by its mean, so the weight of one Gaussian falls as the budget grows.
// Above this budget, few exposures then leave low-opacity fog. There each Gaussian keeps the weight
// that it has in a budget of this size.
#define REGULARIZED_GAUSSIANS 20000

// Steps between two searches for Gaussians that none of a few exposures sees.
#define HIDDEN_EVERY 500

// What no picture shows is seen from elsewhere, and few exposures leave much of it
// (docs/notes/few-exposures.md).
static sv_background background_of(const sv_sampling *s) {
  if (s->is_multiplexed) return SV_BG_BLACK;
  return s->is_moving || s->n_exposures >= MANY_EXPOSURES ? SV_BG_BACKDROP : SV_BG_OF_PICTURES;
}

// Few exposures leave the space around a scene open to Gaussians in the background's color, which
// no training view tells from nothing. With one exposure, what is behind its edges would be empty.
static float random_until(const sv_train_cfg *cfg, const sv_sampling *s) {
  const bool is_sparse = s->n_exposures > 1 && s->n_exposures < MANY_EXPOSURES;
  return is_sparse && !s->is_moving ? cfg->fine_at : 0.0f;
}

#define GRID_VIEWS 6 // more sub-views than a phone has: a lens grid, whose images are small

// Their many rays measure depth better than few rays of large pictures, and each estimate of the
// curvature is of a few of them (docs/notes/quality.md).
#define GRID_DAMPING_MEAN 0.2f

// 1 with few exposures, 0 with many.
static float fewness(const sv_sampling *s) {
  const float few = (float)(MANY_EXPOSURES - s->n_exposures) / (MANY_EXPOSURES - SV_FEW_EXPOSURES);
  return sv_clampf(few, 0.0f, 1.0f);
}

static float dropout_of(const sv_sampling *s, bool is_grid) {
  if (s->is_multiplexed || s->is_moving || (is_grid && s->is_far)) return 0.0f;
  return fewness(s) * (is_grid ? DROPOUT_GRID : DROPOUT);
}

// Factor of the opacity regularization weight over that of REGULARIZED_GAUSSIANS. 1 for lens grids:
// their many sub-views prevent low-opacity fog.
static float opacity_share(const sv_train_cfg *cfg, const sv_sampling *s, bool is_grid) {
  const float more = sv_maxf((float)cfg->n_gaussians / REGULARIZED_GAUSSIANS - 1.0f, 0.0f);
  return is_grid || s->is_moving ? 1.0f : 1.0f + fewness(s) * more;
}

// Of the mean opacity, for few exposures of a still scene.
static float opacity_weight(const sv_sampling *s, bool is_grid) {
  // Gaussians that are not needed show as floaters from elsewhere.
  if (s->n_sub_views == 1) return s->n_exposures == 1 ? 0.1f : 0.03f;
  // With parallax, transparent Gaussians in front of the surface can be told and deserve a higher
  // weight, the more the farther the start is from it; lens images are too coarse for it, there it
  // eats into the surface.
  return is_grid ? 0.015f : s->is_far ? 0.05f : 0.03f;
}

// Losses of rendered depth, for few exposures and for moving scenes, whose cameras often stand
// still. Cameras of a rig measure depth where there is texture, and smoothness carries it on. One
// camera measures little, and the many sub-views of a lens grid leave little open. A start in a
// sphere is the paper's, whose objective has none.
static void set_surface(sv_train_cfg *cfg, const sv_sampling *s, bool is_grid) {
  if (s->n_sub_views == 1 || is_grid || s->is_far) return;
  if (!s->is_moving && s->n_exposures > SV_FEW_EXPOSURES) return;
  cfg->weight_smooth = s->is_moving || s->n_exposures > 1 ? 0.1f : 0.4f;
  cfg->weight_reproject = s->is_moving ? 0.0f : 0.2f;
}

// What several exposures leave open is what the space between them looks like. Novel views beside
// theirs show it: there, colors follow the picture that sees the same surface, and depth is smooth.
// With one exposure they would look behind everything (docs/notes/few-exposures.md).
#define NOVEL_EVERY     16
#define NOVEL_RAD       1.0f
#define NOVEL_REPROJECT (0.5f * NOVEL_EVERY)
#define NOVEL_SMOOTH    (0.3f * NOVEL_EVERY)

static void set_novel(sv_train_cfg *cfg, const sv_sampling *s, bool is_grid) {
  if (is_grid || s->is_far || s->is_moving || s->n_exposures < 2 || s->n_exposures >= MANY_EXPOSURES) return;
  cfg->n_novel = 1;
  cfg->novel_every = NOVEL_EVERY;
  cfg->novel_rad = NOVEL_RAD;
  cfg->weight_reproject_novel = fewness(s) * NOVEL_REPROJECT;
  cfg->weight_smooth_novel = fewness(s) * NOVEL_SMOOTH;
}

// Of the Gaussians, in each relocation: many exposures, and many instants of a moving scene, tell
// which ones matter least.
#define RELOCATED_SHARE 0.02f

// Each step follows one view of many. Full rates until late win most, and a short fall at the end
// takes the mean over the views (docs/notes/quality.md).
#define SETTLE_FROM      0.8f
#define SETTLE_EXPOSURES 6 // and more

// Their Gaussians move by smaller shares of their size, so that less damping is needed, but not of
// scales and opacities: with less, photographs are worse (docs/notes/quality.md).
#define MANY_CAP_MEAN 0.03f
#define MANY_DAMPING  0.3f

// Of many exposures, large pictures at half their size still show most of what there is to learn,
// for a quarter of the work: half of a run, but in long ones, for which each step at full size
// counts, not more than so many steps. Relocation that goes on as much longer puts Gaussians where
// full size needs them (docs/notes/speed.md).
#define LARGE_PX      300000
#define LARGE_SHARE   0.5f
#define LARGE_REDUCED 1500.0f

static void set_large_pictures(sv_train_cfg *cfg) {
  const float share = LARGE_REDUCED / sv_maxf((float)cfg->expected_steps, 1.0f);
  const float later = sv_clampf(share, cfg->fine_at, LARGE_SHARE) - cfg->fine_at;
  cfg->fine_at += later;
  cfg->relocate_share_until += later;
}

static void set_many_exposures(sv_train_cfg *cfg, const sv_sampling *s) {
  if (s->n_exposures >= MANY_EXPOSURES) {
    cfg->relocate_share = RELOCATED_SHARE;
    if (s->largest_px >= LARGE_PX) set_large_pictures(cfg);
  }
  if (s->n_exposures < SETTLE_EXPOSURES) return;
  cfg->settle_from = SETTLE_FROM;
  cfg->newton.rate_end = cfg->newton.rate_start;
  cfg->newton.cap_mean = MANY_CAP_MEAN;
  cfg->newton.damping = MANY_DAMPING;
}

// Adam's rates of means: larger than in still scenes and falling less, while rates of motion, which
// are times these, are smaller (docs/notes/motion.md).
#define MOVING_MEAN_START 4.8e-4f
#define MOVING_MEAN_END   1.9e-5f
#define MOVING_NOISE      0.33f // it is times the rate of means
#define MOVING_OPACITY    0.4f  // the curriculum takes that long to know all times

static void set_moving(sv_train_cfg *cfg) {
  cfg->lr.mean_start = MOVING_MEAN_START;
  cfg->lr.mean_end = MOVING_MEAN_END;
  cfg->noise = MOVING_NOISE;
  cfg->reg_opacity_until = MOVING_OPACITY;
  cfg->relocate_share = RELOCATED_SHARE;
}

void sv_train_set_objective(sv_train_cfg *cfg, const sv_sampling *s) {
  if (s->is_moving) set_moving(cfg);
  if (!s->is_moving && !s->is_multiplexed) set_many_exposures(cfg, s);
  bool is_grid = s->n_sub_views >= GRID_VIEWS || s->is_multiplexed;
  // Lens images are coarser than the pictures that one looks at.
  if (is_grid) {
    cfg->min_scale_px = 0.4f;
    cfg->dilation_px2 = SV_DILATION_AREA_PX2;
    cfg->newton.damping_mean = GRID_DAMPING_MEAN;
  }
  // With compensation a low-pass of 0.3 takes what the pixels show for blur of their own: finer
  // detail is lost.
  if (cfg->is_antialiased) cfg->dilation_px2 = SV_DILATION_AREA_PX2;
  // Adam's even steps suit what is seen at some times only, and what is far from its place: there
  // the curvature is another picture's, or that of another place. But of a mean its matrix says
  // where it is uncertain (docs/notes/quality.md). One camera that stands pins nothing down along
  // its rays.
  const bool is_few = s->n_exposures <= SV_FEW_EXPOSURES;
  const bool is_single = s->n_exposures * s->n_sub_views == 1;
  const bool is_uncertain = s->is_far || (is_few && s->n_sub_views == 1 && !s->is_multiplexed);
  if (is_single) cfg->newton.damping_mean = cfg->newton.damping;
  cfg->optimizer = s->is_moving || (is_uncertain && (s->is_multiplexed || !is_single))
                       ? SV_OPTIMIZER_MIXED
                       : SV_OPTIMIZER_GAUSS_NEWTON;
  // The times added last need the full rate, too.
  if (s->is_moving) cfg->newton.rate_end = cfg->newton.rate_start;
  // Detail within a pixel matters only once the splats are in place. Until then one sample a pixel
  // gives the same quality for a quarter of the work.
  cfg->is_supersampled = is_grid && !s->is_multiplexed;
  cfg->supersample_from = 0.7f;
  cfg->background = background_of(s);
  cfg->random_until = random_until(cfg, s);
  if (s->n_exposures < MANY_EXPOSURES && !s->is_moving) cfg->hidden_every = HIDDEN_EVERY;
  cfg->dropout = dropout_of(s, is_grid);
  set_surface(cfg, s, is_grid);
  set_novel(cfg, s, is_grid);
  cfg->dropout_until = cfg->is_supersampled ? cfg->supersample_from : DROPOUT_UNTIL;
  if (is_few && !s->is_moving) cfg->reg_opacity = opacity_weight(s, is_grid);
  // Fog that fits the few pictures of one camera comes back as soon as it costs nothing, and from
  // afar it has long to go.
  if (s->is_far || (is_few && s->n_sub_views == 1)) cfg->reg_opacity_until = 1.0f;
  cfg->reg_opacity *= opacity_share(cfg, s, is_grid);
  if (!is_few) return;
  cfg->newton.is_boosted = true;
  if (s->is_moving) { // of a rig that stands still, also where there is but one camera
    // One camera alone cannot tell what is in front of the surface; a low weight leaves more of it.
    cfg->reg_opacity = s->n_sub_views > 1 ? 0.03f : 0.05f;
    cfg->sh_step = 2.0f;
    return;
  }
  if (is_single) cfg->sh_step = 2.0f; // one view cannot tell how colour turns: never
  if (!is_grid) return;
  cfg->weight_tv = 0.05f;
  cfg->weight_tv_novel = 0.1f;
  cfg->n_novel = 1;
  cfg->novel_every = 4;
  if (s->is_multiplexed) cfg->weight_ssim = 0.3f; // structure tells whose light a pixel holds
}
