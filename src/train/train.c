// SPDX-License-Identifier: Apache-2.0
#include "src/train/train.h"

#include <string.h>

#include "src/base/mathx.h"
#include "src/base/str.h"
#include "src/splat/constants.h"
#include "src/train/background.h"
#include "src/train/novel.h"
#include "src/train/optimize.h"
#include "src/train/supersample.h"

sv_train_cfg sv_train_defaults(void) {
  sv_train_cfg c = {
      .n_gaussians = SV_DEFAULT_GAUSSIANS,
      .sh_degree = SV_DEFAULT_SH_DEGREE,
      .cap_views = 64,
      .cap_width_px = 640,
      .cap_height_px = 480,
      .n_threads = 1,
      .seed = SV_DEFAULT_SEED,
      .background = SV_BG_BLACK,
      .dilation_px2 = SV_DILATION_PX2,
      .weight_ssim = 0.2f,
      .weight_tv = 0.0f,
      .region_px = 128,
      .novel_every = 1,
      .novel_px = 100,
      .novel_rad = 0.35f,
      .reg_opacity = 0.01f,
      .reg_opacity_until = 0.2f,
      .reg_scale = 0.01f,
      .dropout_until = 1.0f,
      .lr = {.mean_start = 1.6e-4f,
             .mean_end = 1.6e-6f,
             .quat = 1e-3f,
             .scale = 1e-2f, // twice the usual: runs are short (docs/notes/quality.md)
             .logit = 0.05f,
             .sh0 = 2.5e-3f,
             .sh_rest = 2.5e-3f / 20.0f},
      .settle_from = 1.0f,
      .settle_rate = 0.1f,
      .optimizer = SV_OPTIMIZER_GAUSS_NEWTON,
      .newton = {.first_every = 5, // no divisors of what repeats otherwise: all kinds of views have
                                   // turns
                 .first_steps = 300,
                 .every = 17,
                 .half_from = 1000, // earlier they may not scatter more (docs/notes/quality.md)
                 .keep = 0.9f,
                 .rate_start = 0.1f,
                 .rate_end = 0.02f,
                 .damping = 1.0f,
                 .damping_mean = 0.03f,
                 .damping_size = 1.0f,
                 .cap_mean = 0.06f,
                 .cap_scale = 2.5f,
                 .cap = 5.0f},
      .start_scale = 4,
      .fine_at = 0.3f,
      .sh_step = 0.2f,
      .relocate_every = 100,
      .relocate_from = 0.05f,
      .relocate_until = 0.8f,
      .relocate_share_until = 0.4f,
      .noise = 1.0f,
      .expected_steps = SV_DEFAULT_STEPS,
      .appearance = sv_appearance_defaults()};
  return c;
}

static const char *const optimizer_names[] = {"adam", "gauss-newton", "mixed"};

const char *sv_optimizer_name(sv_optimizer o) { return optimizer_names[o]; }

int sv_optimizer_by_name(const char *name) {
  for (int i = 0; i < 3; i++)
    if (sv_str_eq(name, optimizer_names[i])) return i;
  return -1;
}

static size_t cap_floats(const sv_train_cfg *c) {
  return c->cap_pixels ? c->cap_pixels : sv_plane_floats(c->cap_width_px, c->cap_height_px);
}

// Steps of several pictures need their gradients' sum.
static bool has_sum(const sv_train_cfg *c) {
  return c->cap_measurements > 0 || c->n_novel > 0 || c->has_images;
}

static sv_status carve_sum(sv_trainer *t, const sv_train_cfg *c, size_t cap, size_t px, sv_arena *a) {
  if (!has_sum(c)) return SV_OK;
  sv_arena_part_begin(a, "several pictures a step");
  t->sum = SV_TAKE(a, float, cap *(size_t)(t->g.n_rows + SV_TRAIN_SUM_MORE));
  t->sum_touched = SV_TAKE(a, uint32_t, cap / 8);
  for (int k = 0; k < 3; k++) t->part_grad.c[k] = SV_TAKE(a, float, px);
  t->part_err = SV_TAKE(a, float, px);
  if (c->cap_measurements < 1) return SV_OK;
  t->part_trans = SV_TAKE(a, float, px);
  sv_forward_cfg fc = {
      .cap_width_px = c->region_px, .cap_height_px = c->region_px, .n_threads = c->n_threads};
  return sv_forward_init(&t->forward, &fc, t->compute, a);
}

static sv_status carve(sv_trainer *t, const sv_train_cfg *c, sv_arena *a) {
  size_t px = cap_floats(c), cap = (size_t)(c->n_gaussians + 15) / 16 * 16;
  sv_arena_part_begin(a, "model");
  sv_status s = sv_gaussians_init(&t->g, c->n_gaussians, c->sh_degree, a);
  if (s < 0) return s;
  sv_arena_part_begin(a, "optimizer");
  t->m = SV_TAKE(a, uint16_t, cap * (size_t)t->g.n_rows);
  t->v = SV_TAKE(a, uint16_t, cap * (size_t)t->g.n_rows);
  t->cross = c->optimizer != SV_OPTIMIZER_ADAM ? SV_TAKE(a, uint16_t, 3 * cap) : NULL;
  t->err = SV_TAKE(a, float, cap);
  t->block = SV_TAKE(a, float, (size_t)c->n_threads *SV_TRAIN_BLOCK_FLOATS);
  t->floor = c->min_scale_px > 0.0f ? SV_TAKE(a, float, cap) : NULL;
  t->relocation.cum = SV_TAKE(a, double, cap);
  t->relocation.copies = SV_TAKE(a, int32_t, cap);
  t->relocation.source = SV_TAKE(a, int32_t, cap);
  t->touched_of = SV_TAKE(a, uint32_t, cap / 16 + 1);
  sv_arena_part_begin(a, "renderer");
  sv_renderer_cfg rc = sv_train_renderer_cfg(c);
  if ((s = sv_renderer_init(&t->render, &rc, t->compute, a)) < 0) return s;
  sv_arena_part_begin(a, "loss");
  sv_photometric_cfg pc = {.cap_width_px = c->cap_width_px,
                           .cap_height_px = c->cap_height_px,
                           .n_threads = c->n_threads,
                           .has_ssim = c->weight_ssim > 0.0f};
  if ((s = sv_photometric_init(&t->photometric, &pc, t->compute, a)) < 0) return s;
  sv_tv_cfg tc = {
      .cap_width_px = c->cap_width_px, .cap_height_px = c->cap_height_px, .n_threads = c->n_threads};
  const bool has_novel = c->n_novel > 0;
  const bool has_tv = c->weight_tv > 0.0f || (has_novel && c->weight_tv_novel > 0.0f);
  const bool has_smooth = c->weight_smooth > 0.0f || sv_train_is_novel_beside(c);
  if (has_tv && (s = sv_tv_init(&t->tv, &tc, t->compute, a)) < 0) return s;
  const sv_smooth_cfg sc = {px, c->cap_height_px};
  if (has_smooth && (s = sv_smooth_init(&t->smooth, &sc, t->compute, a)) < 0) return s;
  for (int k = 0; k < 3; k++) t->target.c[k] = SV_TAKE(a, float, px);
  for (int k = 0; k < 3; k++) t->grad.c[k] = SV_TAKE(a, float, px);
  t->err_plane = SV_TAKE(a, float, px);
  t->unpack_scratch =
      SV_TAKE(a, float, (size_t)c->n_threads *SV_UNPACK_SCRATCH_FLOATS((size_t)c->cap_width_px));
  if (c->is_supersampled) sv_train_supersample_carve(&t->supersample, px, a);
  if ((s = carve_sum(t, c, cap, px, a)) < 0) return s;
  sv_arena_part_begin(a, "views");
  t->views = SV_TAKE(a, sv_train_view, c->cap_views);
  t->measurements = SV_TAKE(a, sv_train_measurement, c->cap_measurements);
  t->order = SV_TAKE(a, int, c->cap_views + c->cap_regions);
  if (c->poses.cap_poses > 0) {
    t->poses.pose = SV_TAKE(a, sv_train_pose, c->poses.cap_poses);
    t->poses.pose_of = SV_TAKE(a, int32_t, c->cap_views);
    t->poses.cam_from_rig = SV_TAKE(a, sv_pose, c->cap_views);
    t->poses.sum = sv_arena_take(a, cap / 16 + 1, sizeof *t->poses.sum);
  }
  sv_appearance_carve(&t->appearance, c, px, a);
  if (c->is_rolling) sv_rolling_carve(&t->rolling, &t->g, c->cap_views, a);
  return a->status < 0 ? a->status : SV_OK;
}

// Apart, so that trainer and arena do not share a stack frame.
static __attribute__((noinline)) size_t carved_bytes(sv_trainer *t, const sv_train_cfg *cfg) {
  sv_arena dry = sv_arena_dry();
  return carve(t, cfg, &dry) < 0 ? 0 : dry.used_bytes;
}

size_t sv_trainer_bytes(const sv_train_cfg *cfg) {
  sv_trainer t;
  memset(&t, 0, sizeof t);
  return carved_bytes(&t, cfg);
}

static sv_status check(const sv_train_cfg *c, sv_err *err) {
  if (c->n_gaussians < 1 || c->n_gaussians > 4000000)
    return sv_fail(err, SV_E_ARG, "the number of Gaussians is %d, expected 1 to 4000000", c->n_gaussians);
  if (c->sh_degree < 0 || c->sh_degree > 3)
    return sv_fail(err, SV_E_ARG, "the SH degree is %d, expected 0 to 3", c->sh_degree);
  if (c->cap_views < 0 || c->cap_measurements < 0 || c->cap_views + c->cap_measurements < 1)
    return sv_fail(err, SV_E_ARG, "there are no training views, expected at least one");
  if (c->cap_measurements > 0 && (c->region_px < 16 || c->region_px > c->cap_width_px ||
                                  c->region_px > c->cap_height_px || c->cap_regions < c->cap_measurements))
    return sv_fail(err, SV_E_ARG,
                   "regions of %d px, expected at least 16 and at most the largest view, %dx%d", c->region_px,
                   c->cap_width_px, c->cap_height_px);
  if (c->n_novel < 0 || (c->n_novel > 0 && (c->novel_every < 1 || c->novel_px < 8)))
    return sv_fail(err, SV_E_ARG, "%d novel views of %d px, expected 0 or more of at least 8", c->n_novel,
                   c->novel_px);
  if (c->cap_width_px < 1 || c->cap_height_px < 1 || c->cap_width_px > 16384 || c->cap_height_px > 16384)
    return sv_fail(err, SV_E_ARG, "a view of %dx%d pixels, expected sides of 1 to 16384", c->cap_width_px,
                   c->cap_height_px);
  if (c->is_supersampled && (c->cap_width_px > 8192 || c->cap_height_px > 8192))
    return sv_fail(err, SV_E_ARG, "a view of %dx%d pixels with 2x2 samples each, expected sides of 1 to 8192",
                   c->cap_width_px, c->cap_height_px);
  if (!(c->weight_ssim >= 0 && c->weight_ssim <= 1))
    return sv_fail(err, SV_E_ARG, "the SSIM weight is %g, expected 0 to 1", (double)c->weight_ssim);
  if (c->has_motion && (c->cap_measurements > 0 || c->n_novel > 0))
    return sv_fail(err, SV_E_UNSUPPORTED,
                   "moving scenes are trained on whole pictures: not on multiplexed sensors, and without "
                   "novel views");
  if (c->poses.cap_poses > 0 && (c->has_motion || c->cap_measurements > 0))
    return sv_fail(err, SV_E_UNSUPPORTED,
                   "poses are refined with still scenes and whole pictures: not with moving ones, and not on "
                   "multiplexed sensors");
  if (c->is_rolling && (c->has_motion || c->cap_measurements > 0))
    return sv_fail(err, SV_E_UNSUPPORTED,
                   "rolling shutters are modeled with still scenes and whole pictures: not with moving ones, "
                   "and not on multiplexed sensors");
  if (c->has_images && (c->has_motion || c->cap_measurements > 0))
    return sv_fail(
        err, SV_E_UNSUPPORTED,
        "sparse-view priors are for still scenes and whole pictures: not for moving ones, and not on "
        "multiplexed sensors");
  if (c->optimizer != SV_OPTIMIZER_ADAM && (c->newton.every < 1 || c->newton.first_every < 1 ||
                                            !(c->newton.rate_start > 0) || !(c->newton.rate_end > 0)))
    return sv_fail(
        err, SV_E_ARG,
        "an estimate of the curvature every %d and %d steps, and rates of %g to %g, expected more than 0",
        c->newton.first_every, c->newton.every, (double)c->newton.rate_start, (double)c->newton.rate_end);
  if (!(c->settle_from >= 0) || !(c->settle_rate > 0 && c->settle_rate <= 1))
    return sv_fail(err, SV_E_ARG,
                   "rates fall from progress %g on to %g of themselves, expected 0 or more, and above 0 to 1",
                   (double)c->settle_from, (double)c->settle_rate);
  if (c->start_scale != 1 && c->start_scale != 2 && c->start_scale != 4 && c->start_scale != 8)
    return sv_fail(err, SV_E_ARG, "the starting scale is %d, expected 1, 2, 4 or 8", c->start_scale);
  return SV_OK;
}

sv_status sv_trainer_init(sv_trainer *t, const sv_train_cfg *cfg, sv_compute compute, sv_arena *arena,
                          sv_err *err) {
  sv_status s = check(cfg, err);
  if (s < 0) return s;
  memset(t, 0, sizeof *t);
  t->cfg = *cfg;
  t->compute = compute;
  t->radius = 1.0f;
  t->rng = sv_rng_make(cfg->seed, 7);
  s = carve(t, cfg, arena);
  if (s < 0)
    return sv_fail(
        err, s,
        "training needs %zu bytes and the memory block has %zu left; use fewer Gaussians or smaller "
        "pictures",
        sv_trainer_bytes(cfg), arena->cap_bytes - arena->used_bytes);
  return SV_OK;
}

sv_status sv_train_attach(sv_trainer *t, const sv_train_hooks *hooks, void *self) {
  if (t->hooks) return SV_E_FULL;
  t->hooks = hooks;
  t->hooked = self;
  return SV_OK;
}

static sv_train_view view_of(const sv_view *view, const sv_image_u8 *im) {
  const double n = (double)im->width_px * im->height_px;
  return (sv_train_view){*view, *im, im->mask ? (float)(sv_maxd(sv_image_n_counted(im), 1) / n) : 1.0f};
}

sv_status sv_train_add_view(sv_trainer *t, const sv_view *view, const sv_image_u8 *image, sv_err *err) {
  if (t->n_views >= t->cfg.cap_views)
    return sv_fail(err, SV_E_FULL, "more than the %d planned training views", t->cfg.cap_views);
  if (view->width_px != image->width_px || view->height_px != image->height_px)
    return sv_fail(err, SV_E_RANGE, "a picture of %dx%d for a camera of %dx%d", image->width_px,
                   image->height_px, view->width_px, view->height_px);
  if (view->width_px > t->cfg.cap_width_px || view->height_px > t->cfg.cap_height_px ||
      sv_plane_floats(view->width_px, view->height_px) > cap_floats(&t->cfg))
    return sv_fail(err, SV_E_RANGE, "a view of %dx%d is larger than the planned %dx%d", view->width_px,
                   view->height_px, t->cfg.cap_width_px, t->cfg.cap_height_px);
  t->views[t->n_views] = view_of(view, image);
  t->share += (double)t->views[t->n_views].share;
  if (t->cfg.poses.cap_poses > 0) t->poses.pose_of[t->n_views] = -1;
  sv_train_set_appearance(t, t->n_views, -1, -1);
  sv_train_set_rolling(t, t->n_views, NULL, NULL);
  if (t->n_views == 0 || fabsf(view->time - 0.5f) < fabsf(t->reference_time - 0.5f))
    t->reference_time = view->time;
  if (t->n_views == 0 || view->time > t->newest_time) t->newest_time = view->time;
  t->n_views++;
  t->i_order = 0; // a new epoch, with the new view in it
  return SV_OK;
}

void sv_train_set_deep(sv_trainer *t, int i_view, const sv_image_deep *deep) {
  if (t->cfg.is_deep) t->views[i_view].deep = *deep;
}

void sv_train_replace_view(sv_trainer *t, int i_view, const sv_view *view, const sv_image_u8 *image) {
  t->share -= (double)t->views[i_view].share;
  t->views[i_view] = view_of(view, image);
  sv_train_set_rolling(t, i_view, NULL, NULL);
  t->share += (double)t->views[i_view].share;
  t->newest_time = sv_maxf(t->newest_time, view->time);
}

void sv_train_mask_changed(sv_trainer *t, int i_view) {
  sv_train_view *v = &t->views[i_view];
  t->share -= (double)v->share;
  v->share = view_of(&v->view, &v->image).share;
  t->share += (double)v->share;
}

void sv_train_shift_times(sv_trainer *t, float by) {
  for (int i = 0; i < t->n_views; i++) t->views[i].view.time += by;
  t->newest_time += by;
  t->reference_time += by;
}

// One more than fit, so that they can be shifted and still cover the sensor.
static int n_regions_along(int side_px, int region_px) {
  return side_px <= region_px ? 1 : side_px / region_px + 1;
}

int sv_train_n_regions(int width_px, int height_px, int region_px) {
  return n_regions_along(width_px, region_px) * n_regions_along(height_px, region_px);
}

sv_status sv_train_add_measurement(sv_trainer *t, const sv_multiplexed *model, const uint16_t *px,
                                   sv_err *err) {
  const int side = t->cfg.region_px;
  if (t->n_measurements >= t->cfg.cap_measurements)
    return sv_fail(err, SV_E_FULL, "more than the %d planned measurements", t->cfg.cap_measurements);
  sv_status s = sv_multiplexed_check(model, err);
  if (s < 0) return s;
  int n = sv_train_n_regions(model->width_px, model->height_px, side);
  if (n > t->cfg.cap_regions - t->n_regions)
    return sv_fail(err, SV_E_FULL, "a sensor of %dx%d has %d regions, %d are left of those planned",
                   model->width_px, model->height_px, n, t->cfg.cap_regions - t->n_regions);
  t->measurements[t->n_measurements++] =
      (sv_train_measurement){.model = *model,
                             .px = px,
                             .n_x = n_regions_along(model->width_px, side),
                             .n_y = n_regions_along(model->height_px, side)};
  t->n_regions += n;
  t->i_order = 0;
  return SV_OK;
}

void sv_train_set_clear(sv_trainer *t, const uint16_t *clear) {
  t->measurements[t->n_measurements - 1].clear = clear;
}

void sv_train_set_scene(sv_trainer *t, const float centre[3], float radius) {
  memcpy(t->centre, centre, sizeof t->centre);
  t->radius = radius;
}

sv_status sv_train_start(sv_trainer *t, const sv_init_cfg *init, const sv_point *point, int n_points,
                         sv_arena *scratch) {
  sv_status s = sv_gaussians_fill(&t->g, init, point, n_points, scratch);
  if (s < 0) return s;
  size_t n = (size_t)t->g.cap * (size_t)t->g.n_rows;
  memset(t->m, 0, n * sizeof *t->m);
  memset(t->v, 0, n * sizeof *t->v);
  if (t->cross) memset(t->cross, 0, 3 * (size_t)t->g.cap * sizeof *t->cross);
  memset(t->err, 0, (size_t)t->g.cap * sizeof *t->err);
  if (t->sum) {
    memset(t->sum, 0, (size_t)t->g.cap * (size_t)(t->g.n_rows + SV_TRAIN_SUM_MORE) * sizeof *t->sum);
    memset(t->sum_touched, 0, (size_t)t->g.cap / 8 * sizeof *t->sum_touched);
  }
  sv_train_set_scene(t, init->centre, init->radius);
  if (init->kind == SV_INIT_POINTS) {
    float centre[3], radius = sv_gaussians_radius(&t->g, scratch, centre);
    sv_train_set_scene(t, centre, radius);
  }
  // drawn by the first step
  for (int i = 0; i < t->cfg.cap_views + t->cfg.cap_regions; i++) t->order[i] = i;
  t->trained_s = 0.0;
  t->step = 0;
  sv_appearance_reset(&t->appearance, &t->cfg.appearance);
  if (SV_TRAIN_HAS(t, start)) t->hooks->start(t->hooked);
  sv_train_set_floors(t);
  t->background = sv_train_background_of_views(t);
  return SV_OK;
}

static uint64_t fnv1a(uint64_t h, const float *v, size_t n) {
  for (size_t i = 0; i < n; i++) {
    uint32_t b;
    memcpy(&b, v + i, 4);
    for (int k = 0; k < 4; k++) h = (h ^ (b >> (8 * k) & 255)) * 1099511628211ull;
  }
  return h;
}

uint64_t sv_gaussians_digest(const sv_gaussians *g) {
  return fnv1a(14695981039346656037ull, g->param, (size_t)g->cap * (size_t)g->n_rows);
}

uint64_t sv_train_digest(const sv_trainer *t) {
  const uint64_t h = sv_gaussians_digest(&t->g);
  return SV_TRAIN_HAS(t, digest) ? t->hooks->digest(t->hooked, h) : h;
}
