// SPDX-License-Identifier: Apache-2.0
// One step, stage by stage: at the end, sv_train_step.
#include "src/train/step.h"

#include <string.h>

#include "src/base/mathx.h"
#include "src/splat/constants.h"
#include "src/train/background.h"
#include "src/train/curvature.h"
#include "src/train/mask.h"
#include "src/train/hidden.h"
#include "src/train/measurement.h"
#include "src/train/novel.h"
#include "src/train/optimize.h"
#include "src/train/relocate.h"
#include "src/train/supersample.h"
#include "src/train/surface.h"

#define UNPACK_ROWS 16 // rows a task

// --- choice --------------------------------------------------------------------------------------

int sv_train_scale_at(const sv_trainer *t, const sv_view *view, float progress, int min_scale) {
  int k = t->cfg.start_scale;
  if (k == 4 && progress >= 0.5f * t->cfg.fine_at) k = 2;
  if (progress >= t->cfg.fine_at) k = 1;
  k = sv_maxi(k, min_scale);
  // Below about 64 pixels a side there is nothing left to learn from.
  while (k > 1 && (view->width_px / k < 64 || view->height_px / k < 64)) k /= 2;
  return k;
}

// Views and regions are drawn without replacement; regions lie elsewhere in each epoch.
int sv_train_next_item(sv_trainer *t) {
  const int n = t->n_views + t->n_regions;
  if (t->i_order == 0) {
    for (int i = 0; i < n; i++) t->order[i] = i;
    for (int i = n - 1; i > 0; i--) {
      int j = (int)sv_rng_below(&t->rng, (uint32_t)i + 1), s = t->order[i];
      t->order[i] = t->order[j];
      t->order[j] = s;
    }
    for (int k = 0; k < 2 && t->n_regions > 0; k++) t->jitter[k] = sv_rng_f(&t->rng);
  }
  int i = t->order[t->i_order];
  t->i_order = (t->i_order + 1) % n;
  return i;
}

static sv_train_choice choose(sv_trainer *t, float progress) {
  sv_train_choice c = {.i_view = -1, .progress = progress, .min_scale = 1, .can_relocate = true};
  if (SV_TRAIN_HAS(t, choose_view)) t->hooks->choose_view(t->hooked, &c);
  else c.i_view = sv_train_next_item(t);
  return c;
}

// --- images --------------------------------------------------------------------------------------

void sv_train_size_images(sv_trainer *t, int w, int h) {
  if (t->grad.width_px == w && t->grad.height_px == h) return;
  sv_planes_set_size(&t->target, w, h);
  sv_planes_set_size(&t->grad, w, h);
  sv_planes_clear(&t->target);
  sv_planes_clear(&t->grad); // the padding must stay 0
  memset(t->err_plane, 0, sv_plane_floats(w, h) * sizeof(float));
}

typedef struct {
  const sv_trainer *t;
  sv_unpack_args a;
  int n_rows;
} unpack_job;

static void unpack_task(void *arg, int i_task, int i_thread) {
  unpack_job *j = arg;
  sv_unpack_args a = j->a;
  a.row0 = i_task * UNPACK_ROWS;
  a.row1 = sv_mini(a.row0 + UNPACK_ROWS, j->n_rows);
  a.scratch += (size_t)i_thread * SV_UNPACK_SCRATCH_FLOATS((size_t)j->t->cfg.cap_width_px);
  j->t->compute.k->unpack(&a);
}

void sv_train_load_image(sv_trainer *t, const sv_image_u8 *im, int scale, const float bg[3], sv_planes *out) {
  int w = im->width_px / scale, h = im->height_px / scale;
  sv_train_size_images(t, w, h);
  unpack_job j = {.t = t,
                  .n_rows = h,
                  .a = {.src = im->px,
                        .src_stride_bytes = (size_t)im->stride_bytes,
                        .n_channels = im->n_channels,
                        .width_px = im->width_px,
                        .height_px = im->height_px,
                        .k = scale,
                        .bg = {bg[0], bg[1], bg[2]},
                        .dst = {out->c[0], out->c[1], out->c[2]},
                        .dst_stride = out->stride,
                        .scratch = t->unpack_scratch}};
  sv_pool_run(t->compute.pool, unpack_task, &j, (h + UNPACK_ROWS - 1) / UNPACK_ROWS);
}

typedef struct {
  const sv_trainer *t;
  const sv_image_deep *deep;
  sv_unpack16_args a;
  int n_rows;
} deep_job;

static void deep_task(void *arg, int i_task, int i_thread) {
  const deep_job *j = arg;
  const sv_kernels *k = j->t->compute.k;
  sv_unpack16_args a = j->a;
  (void)i_thread;
  a.row0 = i_task * UNPACK_ROWS;
  a.row1 = sv_mini(a.row0 + UNPACK_ROWS, j->n_rows);
  k->unpack16(&a);
  for (int c = 0; c < 3; c++) {
    float *rows = a.dst[c] + (size_t)a.row0 * (size_t)a.dst_stride;
    k->noise_curve(&(sv_noise_curve_args){.src = rows,
                                          .dst = rows,
                                          .n = (a.row1 - a.row0) * a.dst_stride,
                                          .read = sv_deep_read(j->deep),
                                          .shot = sv_deep_shot(j->deep)});
  }
}

void sv_train_load_target(sv_trainer *t, int i_view, int scale, const float bg[3]) {
  const sv_image_deep *deep = &t->views[i_view].deep;
  const size_t plane = (size_t)deep->width_px * (size_t)deep->height_px;
  if (!deep->px) {
    sv_train_load_image(t, &t->views[i_view].image, scale, bg, &t->target);
    return;
  }
  const int w = deep->width_px / scale, h = deep->height_px / scale;
  sv_train_size_images(t, w, h);
  deep_job j = {.t = t,
                .deep = deep,
                .n_rows = h,
                .a = {.src = {deep->px, deep->px + plane, deep->px + 2 * plane},
                      .width_px = deep->width_px,
                      .height_px = deep->height_px,
                      .k = scale,
                      .scale = 1 / deep->white,
                      .dst = {t->target.c[0], t->target.c[1], t->target.c[2]},
                      .dst_stride = t->target.stride}};
  sv_pool_run(t->compute.pool, deep_task, &j, (h + UNPACK_ROWS - 1) / UNPACK_ROWS);
}

typedef struct {
  float *plane[4];
  size_t n;
  float weight;
} weigh_job;

static void weigh_task(void *arg, int i_plane, int i_thread) {
  const weigh_job *j = arg;
  (void)i_thread;
  for (size_t i = 0; i < j->n; i++) j->plane[i_plane][i] *= j->weight;
}

void sv_train_weigh(sv_trainer *t, float weight, float *err) {
  const sv_planes *g = &t->grad;
  weigh_job j = {.plane = {g->c[0], g->c[1], g->c[2], err},
                 .n = (size_t)g->stride * (size_t)g->rows_padded,
                 .weight = weight};
  if (weight != 1.0f) sv_pool_run(t->compute.pool, weigh_task, &j, err ? 4 : 3);
}

// --- a view --------------------------------------------------------------------------------------

sv_render_options sv_train_render_options(const sv_trainer *t, float progress, bool has_depth) {
  sv_render_options o = {.sh_degree = t->cfg.sh_degree,
                         .near_z = SV_NEAR_FRACTION * t->radius,
                         .is_antialiased = t->cfg.is_antialiased,
                         .dilation_px2 = t->cfg.dilation_px2,
                         .has_depth = has_depth};
  if (t->cfg.sh_step > 0.0f) o.sh_degree = sv_mini(t->cfg.sh_degree, (int)(progress / t->cfg.sh_step));
  sv_train_background_color(t->cfg.background, t->background.rgb, o.bg);
  return o;
}

void sv_train_set_time(sv_trainer *t, float time) {
  if (SV_TRAIN_HAS(t, set_time)) t->hooks->set_time(t->hooked, time);
}

// The image of a view, its target loaded.
static sv_status begin_image(sv_trainer *t, const sv_train_choice *c, const sv_render_options *o,
                             sv_train_image *im) {
  const sv_train_view *tv = &t->views[c->i_view];
  const int scale = sv_train_scale_at(t, &tv->view, c->progress, c->min_scale);
  *im = (sv_train_image){.i_view = c->i_view,
                         .scale = scale,
                         .progress = c->progress,
                         .is_supersampled = sv_train_is_supersampled(t, scale, c->progress),
                         .view = sv_view_scaled(&tv->view, scale),
                         .options = *o,
                         .weight = 1.0f};
  float *bg = im->options.bg;
  const bool is_random = t->cfg.background == SV_BG_RANDOM || c->progress < t->cfg.random_until;
  if (sv_train_is_background_drawn(t, c->progress) || (is_random && tv->image.n_channels == 4))
    for (int k = 0; k < 3; k++) bg[k] = sv_rng_f(&t->rng);
  sv_status s = SV_OK;
  if (SV_TRAIN_HAS(t, before_render)) s = t->hooks->before_render(t->hooked, im);
  if (s >= 0 && !im->has_target) sv_train_load_target(t, c->i_view, scale, bg);
  im->has_depth_loss = im->options.has_depth;
  im->is_surface = sv_train_is_surface_due(t, im);
  im->has_novel = sv_train_has_novel(t, im);
  im->options.has_depth |= im->is_surface || im->has_novel;
  return s;
}

static sv_status backward(sv_trainer *t, const sv_train_image *im, const float *errors) {
  if (im->is_supersampled) return sv_train_supersample_bwd(t, &t->grad, errors);
  return sv_render_bwd(&t->render, &t->grad, im->g_depth, im->g_trans, errors);
}

// Renders a view and leaves its gradients in the renderer.
static sv_status view_step(sv_trainer *t, const sv_train_choice *c, const sv_render_options *o,
                           sv_step_stats *out, sv_train_image *im) {
  float *const errors = sv_train_is_error_due(t, c->progress) ? t->err_plane : NULL;
  const sv_planes *x;
  sv_status s = begin_image(t, c, o, im);
  if (s < 0) return s;
  sv_train_roll(t, c->i_view, &im->view, im->options.near_z);
  s = sv_train_measure(t, &im->view, &im->options, im->is_supersampled, &x);
  sv_train_unroll(t);
  if (s < 0) return s;
  const sv_planes *shown = sv_train_appear(t, c->i_view, &im->view, x);
  const sv_image_u8 *image = im->has_target ? NULL : &t->views[c->i_view].image; // with its mask
  sv_train_mask_copy(t, image, im->scale, shown, &t->target);
  const sv_photometric_value loss =
      sv_photometric_loss(&t->photometric, shown, &t->target, &t->grad, errors, t->cfg.weight_ssim);
  out->scale = im->scale;
  out->loss = loss.loss;
  out->l1 = loss.l1;
  out->ssim = loss.ssim;
  sv_train_mask_clear(t, image, im->scale, &t->grad); // SSIM has some, from windows that reach out
  const float weight = im->weight * sv_train_mask_weight(t);
  sv_train_weigh(t, weight, errors);
  sv_train_appear_bwd(t, c->i_view, x, &im->view, c->progress);
  if (t->cfg.weight_tv > 0.0f) out->loss += sv_tv_loss(&t->tv, x, &t->grad, SV_TV_SQUARED, t->cfg.weight_tv);
  // Before the probe takes the target's place.
  if (im->is_surface) out->loss += sv_train_surface_loss(t, im);
  if (sv_train_is_probe_due(t)) {
    const double share = image ? (double)t->views[c->i_view].share : 1.0;
    // its square must count once
    const sv_train_residual r = {.l1 = loss.l1 / ((double)weight * share),
                                 .masked = image,
                                 .scale = im->scale,
                                 .is_supersampled = im->is_supersampled,
                                 .i_view = c->i_view,
                                 .rendered = t->views[c->i_view].deep.px ? x : NULL,
                                 .view = &im->view};
    if ((s = sv_train_curvature(t, &r, &t->target)) < 0) return s;
  }
  if (im->has_depth_loss) out->loss += t->hooks->add_loss(t->hooked, im);
  return backward(t, im, errors);
}

// --- stages --------------------------------------------------------------------------------------

static sv_render_options step_options(sv_trainer *t, float progress) {
  sv_render_options o = sv_train_render_options(t, progress, false);
  o.dropout = progress < t->cfg.dropout_until ? t->cfg.dropout : 0.0f;
  o.dropout_seed = sv_hash3((uint32_t)t->cfg.seed, t->step, 0);
  t->photometric.phase = (int)(t->step & 1); // rows on which windows of SSIM stand, in turn
  return o;
}

static bool has_images(const sv_trainer *t, float progress) {
  return SV_TRAIN_HAS(t, has_images) && t->hooks->has_images(t->hooked, progress);
}

// Renderings that are added to the step's sum beside its own image.
static sv_status add_images(sv_trainer *t, const sv_train_image *im, float progress,
                            const sv_render_options *o, double *loss) {
  sv_status s = SV_OK;
  if (sv_train_is_novel_due(t, im)) s = sv_train_novel_step(t, im, o, loss);
  if (s >= 0 && has_images(t, progress)) s = t->hooks->add_images(t->hooked, progress, o, loss);
  return s;
}

static sv_status relocate(sv_trainer *t, float progress) {
  int n_hidden;
  if (t->cfg.relocate_every > 0 && t->step % (uint32_t)t->cfg.relocate_every == 0) sv_train_set_floors(t);
  const sv_status s = sv_train_is_hidden_due(t, progress) ? sv_train_prune_hidden(t, &n_hidden) : SV_OK;
  if (s >= 0 && sv_train_is_relocation_due(t, progress)) sv_train_relocate(t, progress);
  return s;
}

static sv_status run_hook(sv_trainer *t, sv_status (*hook)(void *self, float progress), float progress) {
  return hook ? hook(t->hooked, progress) : SV_OK;
}

sv_status sv_train_step(sv_trainer *t, float progress, sv_step_stats *out) {
  if (t->n_views + t->n_regions < 1) return SV_E_ARG;
  // 1. What the step takes.
  const sv_train_choice c = choose(t, progress);
  sv_step_stats st = {.i_view = c.i_view, .scale = c.i_view < 0 ? 0 : 1};
  if (out) *out = st;
  if (c.i_view < 0) return SV_OK;
  progress = c.progress;
  const bool is_region = c.i_view >= t->n_views;
  sv_train_image im = {0};
  const sv_render_options o = step_options(t, progress);
  // 2. Rendering, loss, and the rasterizer's backward pass.
  sv_status s = is_region ? sv_train_region_step(t, c.i_view - t->n_views, progress, &o, &st)
                          : view_step(t, &c, &o, &st, &im);
  if (s < 0) return s;
  const bool is_sum = is_region || has_images(t, progress) || sv_train_is_novel_due(t, &im);
  // 3. Further images; then gradients are added up first.
  if (is_sum && !is_region) {
    const sv_regularisers reg = sv_train_regularisers(t, progress, 1.0f);
    sv_train_collect(t, &reg, true);
    sv_train_move_pose(t, c.i_view, progress, sv_train_n_tasks(t));
  }
  if ((s = add_images(t, &im, progress, &o, &st.loss)) < 0) return s;
  // 4. Update: projection backward and optimizer, block by block.
  st.n_touched = is_sum ? sv_train_apply(t, progress) : sv_train_optimise(t, progress);
  if (!is_sum) sv_train_move_pose(t, c.i_view, progress, sv_train_n_tasks(t));
  t->step++;
  if (t->hooks && (s = run_hook(t, t->hooks->after_step, progress)) < 0) return s;
  // 5. Dead Gaussians go to where the error is.
  if (c.can_relocate && (s = relocate(t, progress)) < 0) return s;
  // 6. Search for what moves.
  if (t->hooks && (s = run_hook(t, t->hooks->search, progress)) < 0) return s;
  if (out) *out = st;
  return SV_OK;
}
