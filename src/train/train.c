// SPDX-License-Identifier: Apache-2.0
#include "src/train/train.h"

#include <string.h>

#include "src/base/mathx.h"
#include "src/splat/constants.h"

#define UNPACK_ROWS 16 // rows a task

sv_train_cfg sv_train_defaults(void) {
  return (sv_train_cfg){.n_gaussians = 20000,
                        .sh_degree = 1,
                        .cap_views = 64,
                        .cap_width_px = 640,
                        .cap_height_px = 480,
                        .n_threads = 1,
                        .seed = 1,
                        .background = SV_BG_BLACK,
                        .weight_ssim = 0.2f,
                        .weight_tv = 0.0f,
                        .reg_opacity = 0.01f,
                        .reg_scale = 0.01f,
                        .lr = {.mean_start = 1.6e-4f,
                               .mean_end = 1.6e-6f,
                               .quat = 1e-3f,
                               .scale = 5e-3f,
                               .logit = 0.05f,
                               .sh0 = 2.5e-3f,
                               .sh_rest = 2.5e-3f / 20.0f},
                        .start_scale = 4,
                        .fine_at = 0.3f,
                        .sh_step = 0.2f,
                        .relocate_every = 100,
                        .relocate_from = 0.05f,
                        .relocate_until = 0.8f,
                        .noise = 1.0f,
                        .steps_hint = 3000};
}

static sv_renderer_cfg renderer_cfg(const sv_train_cfg *c) {
  return (sv_renderer_cfg){.cap_gaussians = c->n_gaussians,
                           .cap_width_px = c->cap_width_px,
                           .cap_height_px = c->cap_height_px,
                           .cap_pixels = c->cap_pixels,
                           .cap_recs = c->cap_recs,
                           .n_threads = c->n_threads,
                           .has_grad = true};
}

static size_t cap_floats(const sv_train_cfg *c) {
  return c->cap_pixels ? c->cap_pixels : sv_plane_floats(c->cap_width_px, c->cap_height_px);
}

static sv_status carve(sv_trainer *t, const sv_train_cfg *c, sv_arena *a) {
  size_t px = cap_floats(c), cap = (size_t)(c->n_gaussians + 15) / 16 * 16;
  sv_arena_part_begin(a, "model");
  sv_status s = sv_gaussians_init(&t->g, c->n_gaussians, c->sh_degree, a);
  if (s < 0) return s;
  sv_arena_part_begin(a, "optimiser");
  t->m = SV_TAKE(a, float, cap *(size_t)t->g.n_rows);
  t->v = SV_TAKE(a, float, cap *(size_t)t->g.n_rows);
  t->err = SV_TAKE(a, float, cap);
  t->block = SV_TAKE(a, float, (size_t)c->n_threads *(SV_CAP_ROWS + 1) * 16);
  t->cum = SV_TAKE(a, double, cap);
  t->copies = SV_TAKE(a, int32_t, cap);
  t->source = SV_TAKE(a, int32_t, cap);
  t->touched_of = SV_TAKE(a, uint32_t, cap / 16 + 1);
  sv_arena_part_begin(a, "renderer");
  sv_renderer_cfg rc = renderer_cfg(c);
  if ((s = sv_renderer_init(&t->render, &rc, a)) < 0) return s;
  sv_arena_part_begin(a, "loss");
  sv_photometric_cfg pc = {.cap_width_px = c->cap_width_px,
                           .cap_height_px = c->cap_height_px,
                           .n_threads = c->n_threads,
                           .has_ssim = c->weight_ssim > 0.0f};
  if ((s = sv_photometric_init(&t->photometric, &pc, a)) < 0) return s;
  sv_tv_cfg tc = {
      .cap_width_px = c->cap_width_px, .cap_height_px = c->cap_height_px, .n_threads = c->n_threads};
  if (c->weight_tv > 0.0f && (s = sv_tv_init(&t->tv, &tc, a)) < 0) return s;
  for (int k = 0; k < 3; k++) t->target.c[k] = SV_TAKE(a, float, px);
  for (int k = 0; k < 3; k++) t->grad.c[k] = SV_TAKE(a, float, px);
  t->err_plane = SV_TAKE(a, float, px);
  t->unpack_scratch =
      SV_TAKE(a, float, (size_t)c->n_threads *SV_UNPACK_SCRATCH_FLOATS((size_t)c->cap_width_px));
  sv_arena_part_begin(a, "views");
  t->views = SV_TAKE(a, sv_train_view, c->cap_views);
  t->order = SV_TAKE(a, int, c->cap_views);
  return a->status < 0 ? a->status : SV_OK;
}

size_t sv_trainer_bytes(const sv_train_cfg *cfg) {
  sv_arena dry = sv_arena_dry();
  sv_trainer t;
  memset(&t, 0, sizeof t);
  return carve(&t, cfg, &dry) < 0 ? 0 : dry.used_bytes;
}

static sv_status check(const sv_train_cfg *c, sv_err *err) {
  if (c->n_gaussians < 1 || c->n_gaussians > 4000000)
    return sv_fail(err, SV_E_ARG, "the number of Gaussians is %d, expected 1 to 4000000", c->n_gaussians);
  if (c->sh_degree < 0 || c->sh_degree > 3)
    return sv_fail(err, SV_E_ARG, "the SH degree is %d, expected 0 to 3", c->sh_degree);
  if (c->cap_views < 1) return sv_fail(err, SV_E_ARG, "there are no training views, expected at least one");
  if (c->cap_width_px < 1 || c->cap_height_px < 1 || c->cap_width_px > 16384 || c->cap_height_px > 16384)
    return sv_fail(err, SV_E_ARG, "a view of %dx%d pixels, expected sides of 1 to 16384", c->cap_width_px,
                   c->cap_height_px);
  if (!(c->weight_ssim >= 0 && c->weight_ssim <= 1))
    return sv_fail(err, SV_E_ARG, "the SSIM weight is %g, expected 0 to 1", (double)c->weight_ssim);
  if (c->start_scale != 1 && c->start_scale != 2 && c->start_scale != 4 && c->start_scale != 8)
    return sv_fail(err, SV_E_ARG, "the starting scale is %d, expected 1, 2, 4 or 8", c->start_scale);
  return SV_OK;
}

sv_status sv_trainer_init(sv_trainer *t, const sv_train_cfg *cfg, const sv_kernels *k, const sv_pool *pool,
                          sv_arena *arena, sv_err *err) {
  sv_status s = check(cfg, err);
  if (s < 0) return s;
  memset(t, 0, sizeof *t);
  t->cfg = *cfg;
  t->k = k;
  t->pool = pool;
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
  t->views[t->n_views] = (sv_train_view){*view, *image};
  t->n_views++;
  t->i_order = 0; // a new epoch, with the new view in it
  return SV_OK;
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
  memset(t->err, 0, (size_t)t->g.cap * sizeof *t->err);
  sv_train_set_scene(t, init->centre, init->radius);
  if (init->kind == SV_INIT_POINTS) {
    float centre[3], radius = sv_gaussians_radius(&t->g, scratch, centre);
    sv_train_set_scene(t, centre, radius);
  }
  t->step = 0;
  return SV_OK;
}

int sv_train_scale_at(const sv_trainer *t, const sv_view *view, float progress) {
  int k = t->cfg.start_scale;
  if (progress >= t->cfg.fine_at) return 1;
  if (k == 4 && progress >= 0.5f * t->cfg.fine_at) k = 2;
  // Below about 64 pixels a side there is nothing left to learn from.
  while (k > 1 && (view->width_px / k < 64 || view->height_px / k < 64)) k /= 2;
  return k;
}

static int next_view(sv_trainer *t) {
  if (t->i_order == 0) {
    for (int i = 0; i < t->n_views; i++) t->order[i] = i;
    for (int i = t->n_views - 1; i > 0; i--) {
      int j = (int)sv_rng_below(&t->rng, (uint32_t)i + 1), s = t->order[i];
      t->order[i] = t->order[j];
      t->order[j] = s;
    }
  }
  int v = t->order[t->i_order];
  t->i_order = (t->i_order + 1) % t->n_views;
  return v;
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
  j->t->k->unpack(&a);
}

static void set_size(sv_planes *p, int w, int h) {
  p->width_px = w;
  p->height_px = h;
  p->stride = sv_plane_pad(w);
  p->rows_padded = sv_plane_pad(h);
}

// The sub-view's picture as planes at 1/scale, laid over the background.
static void load_target(sv_trainer *t, const sv_image_u8 *im, int scale, const float bg[3]) {
  int w = im->width_px / scale, h = im->height_px / scale;
  if (t->grad.width_px != w || t->grad.height_px != h) {
    set_size(&t->target, w, h);
    set_size(&t->grad, w, h);
    size_t n = sv_plane_floats(w, h) * sizeof(float);
    for (int c = 0; c < 3; c++) memset(t->target.c[c], 0, n);
    for (int c = 0; c < 3; c++) memset(t->grad.c[c], 0, n); // the padding must stay 0
    memset(t->err_plane, 0, n);
  }
  unpack_job j = {.t = t,
                  .n_rows = h,
                  .a = {.src = im->px,
                        .src_stride_bytes = (size_t)im->stride_bytes,
                        .n_channels = im->n_channels,
                        .width_px = im->width_px,
                        .height_px = im->height_px,
                        .k = scale,
                        .bg = {bg[0], bg[1], bg[2]},
                        .dst = {t->target.c[0], t->target.c[1], t->target.c[2]},
                        .dst_stride = t->target.stride,
                        .scratch = t->unpack_scratch}};
  sv_pool_run(t->pool, unpack_task, &j, (h + UNPACK_ROWS - 1) / UNPACK_ROWS);
}

sv_render_options sv_train_render_options(const sv_trainer *t, float progress, bool has_depth) {
  sv_render_options o = {.sh_degree = t->cfg.sh_degree,
                         .near_z = SV_NEAR_FRACTION * t->radius,
                         .is_antialiased = t->cfg.is_antialiased,
                         .has_depth = has_depth};
  if (t->cfg.sh_step > 0.0f) o.sh_degree = sv_mini(t->cfg.sh_degree, (int)(progress / t->cfg.sh_step));
  if (t->cfg.background == SV_BG_WHITE) o.bg[0] = o.bg[1] = o.bg[2] = 1.0f;
  return o;
}

static void maybe_relocate(sv_trainer *t, float progress) {
  if (t->cfg.relocate_every < 1 || progress < t->cfg.relocate_from || progress > t->cfg.relocate_until)
    return;
  if (t->step % (uint32_t)t->cfg.relocate_every == 0) sv_train_relocate(t);
}

sv_status sv_train_step(sv_trainer *t, float progress, sv_step_stats *out) {
  if (t->n_views < 1) return SV_E_ARG;
  int i = next_view(t);
  const sv_train_view *tv = &t->views[i];
  int scale = sv_train_scale_at(t, &tv->view, progress);
  sv_view view = sv_view_scaled(&tv->view, scale);
  sv_render_options o = sv_train_render_options(t, progress, false);
  if (t->cfg.background == SV_BG_RANDOM && tv->image.n_channels == 4)
    for (int c = 0; c < 3; c++) o.bg[c] = sv_rng_f(&t->rng);
  load_target(t, &tv->image, scale, o.bg);
  sv_status s = sv_render(&t->render, t->k, t->pool, &t->g, &view, &o);
  if (s < 0) return s;
  sv_photometric_value loss;
  sv_photometric_loss(&t->photometric, t->k, t->pool, &t->render.rgb, &t->target, &t->grad, t->err_plane,
                      t->cfg.weight_ssim, &loss);
  if (t->cfg.weight_tv > 0.0f)
    loss.loss += sv_tv_loss(&t->tv, t->k, t->pool, &t->render.rgb, &t->grad, SV_TV_SQUARED, t->cfg.weight_tv);
  s = sv_render_bwd(&t->render, t->k, t->pool, &t->grad, NULL, NULL, t->err_plane);
  if (s < 0) return s;
  uint32_t n_touched = sv_train_optimise(t, progress);
  t->step++;
  maybe_relocate(t, progress);
  if (out)
    *out = (sv_step_stats){.i_view = i,
                           .scale = scale,
                           .loss = loss.loss,
                           .l1 = loss.l1,
                           .ssim = loss.ssim,
                           .n_touched = n_touched};
  return SV_OK;
}

uint64_t sv_train_digest(const sv_trainer *t) {
  uint64_t h = 14695981039346656037ull;
  size_t n = (size_t)t->g.cap * (size_t)t->g.n_rows;
  for (size_t i = 0; i < n; i++) {
    uint32_t b;
    memcpy(&b, t->g.param + i, 4);
    for (int k = 0; k < 4; k++) h = (h ^ (b >> (8 * k) & 255)) * 1099511628211ull;
  }
  return h;
}
