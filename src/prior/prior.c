// SPDX-License-Identifier: Apache-2.0
#include "src/prior/prior.h"

#include <string.h>

#include "src/prior/methods.h"
#include "src/prior/views.h"

#define METHOD_VIEWS 8 // warped pseudo-views kept

size_t sv_prior_scratch_bytes(int n_gaussians) {
  const size_t unpool = sv_prior_unpool_bytes(n_gaussians), prune = sv_prior_prune_bytes(n_gaussians);
  return SV_ARENA_ALIGN + (unpool > prune ? unpool : prune);
}

void sv_prior_set_method(sv_prior_cfg *c, sv_prior_method method, int n_views) {
  c->method = method;
  c->prune_at[0] = c->prune_at[1] = 2.0f;
  if (method == SV_PRIOR_NONE) return;
  c->late_from = 2.0f;
  c->late_factor = 1.0f;
  c->warp_until = 2.0f;
  c->cap_depths += n_views;
  c->cap_pseudo += METHOD_VIEWS;
  c->cap_depths += METHOD_VIEWS;
  if (method == SV_PRIOR_FSGS) { // Zhu et al. 2024, in shares of 10,000 steps
    c->every = 10;
    c->warp_every = 10;
    c->late_from = 0.95f;
    c->late_factor = 0.02f;
    c->warp_from = 0.2f;
    c->warp_until = 0.95f;
    c->warp_ramp = 0.05f;
    c->warp_depth = 0.5f;
    c->unpool_from = 0.05f;
    c->unpool_until = 1.0f;
    c->unpool_distance = 3.0f;
    c->unpool_share = 0.02f;
    return;
  }
  // Xiong et al. 2023, in shares of 30,000 steps.
  c->patch_weight = 3.0f;
  c->patch_side = 0.25f;
  c->patch_share = 0.5f;
  c->every = 3;
  c->warp_every = 12;
  c->warp_from = 1.0f / 6.0f;
  c->warp_ramp = 0.01f;
  c->warp_colour = 0.1f;
  c->prune_at[0] = 2.0f / 3.0f;
}

static bool has_any(const sv_prior_cfg *c) { return c->cap_pseudo != 0 || c->cap_depths != 0; }

static size_t cap_pixels_of(const sv_train_cfg *t) {
  return t->cap_pixels ? t->cap_pixels : sv_plane_floats(t->cap_width_px, t->cap_height_px);
}

static sv_status carve(sv_prior *p, const sv_prior_cfg *cfg, const sv_train_cfg *train, sv_compute compute,
                       sv_arena *a) {
  const size_t cap_pixels = cap_pixels_of(train);
  float **planes[] = {&p->expected, &p->target, &p->g_depth, &p->g_trans, &p->g_expected, &p->share};
  const sv_pearson_cfg pc = {.cap_patches = SV_PRIOR_PATCHES};
  sv_arena_part_begin(a, "priors");
  p->views = SV_TAKE(a, sv_prior_view, cfg->cap_pseudo);
  p->depths = SV_TAKE(a, sv_prior_depth, cfg->cap_depths);
  for (int i = 0; i < cfg->cap_pseudo; i++) {
    uint8_t *px = SV_TAKE(a, uint8_t, 4 * cap_pixels);
    if (p->views) p->views[i] = (sv_prior_view){.rgba = px};
  }
  for (int i = 0; i < cfg->cap_depths; i++) {
    float *map = SV_TAKE(a, float, cap_pixels);
    if (p->depths) p->depths[i] = (sv_prior_depth){.id = -1, .map = map};
  }
  for (size_t i = 0; i < sizeof planes / sizeof *planes; i++) *planes[i] = SV_TAKE(a, float, cap_pixels);
  p->mask = SV_TAKE(a, uint8_t, cap_pixels);
  p->samples = SV_TAKE(a, sv_prior_samples, cfg->cap_depths > 0);
  if (cfg->method) {
    p->warped = SV_TAKE(a, uint8_t, 4 * cap_pixels);
    p->scratch = SV_TAKE(a, sv_arena, 1);
    const sv_arena scratch = sv_arena_sub(a, sv_prior_scratch_bytes(train->n_gaussians));
    if (p->scratch) *p->scratch = scratch;
  }
  sv_status s = sv_pearson_init(&p->pearson, &pc, compute, a);
  return s < 0 ? s : a->status < 0 ? a->status : SV_OK;
}

// Apart, so that the context and the arena do not share a stack frame.
static __attribute__((noinline)) size_t carved_bytes(sv_prior *p, const sv_prior_cfg *cfg,
                                                     const sv_train_cfg *train) {
  sv_arena dry = sv_arena_dry();
  return carve(p, cfg, train, (sv_compute){0}, &dry) < 0 ? 0 : dry.used_bytes;
}

size_t sv_prior_bytes(const sv_prior_cfg *cfg, const sv_train_cfg *train) {
  sv_prior p;
  memset(&p, 0, sizeof p);
  return has_any(cfg) ? carved_bytes(&p, cfg, train) : 0;
}

void sv_prior_prepare(const sv_prior_cfg *cfg, sv_train_cfg *train) {
  train->has_images = cfg->cap_pseudo > 0;
  // One exposure cannot tell how colour turns: what was switched off stays off.
  if (cfg->method == SV_PRIOR_FSGS && train->sh_step <= 1.0f) train->sh_step = 0.05f;
}

// Pseudo-views, their depth maps and the counts.
static void forget_steps(sv_prior *p) {
  for (int i = 0; i < p->cfg.cap_pseudo; i++) p->views[i].id = 0;
  for (int i = 0; i < p->cfg.cap_depths; i++)
    if (p->depths[i].id >= SV_PRIOR_FIRST_PSEUDO) p->depths[i].id = -1;
  p->n_views = p->n_unpooled = p->n_pruned = p->n_warped = 0;
  p->updated_until = 0.0f;
}

// --- hooks ---------------------------------------------------------------------------------------

// Depth maps of the views stay: the Gaussians may have been placed from them.
static void start(void *self) { forget_steps(self); }

static sv_status before_render(void *self, sv_train_image *im) {
  const sv_prior *p = self;
  // Depth has one value a pixel: with several samples, late in the run, it is no longer needed.
  im->options.has_depth =
      !im->is_supersampled && sv_prior_depth_of(p, im->i_view, &p->t->views[im->i_view].view);
  return SV_OK;
}

static double add_loss(void *self, sv_train_image *im) {
  sv_prior *p = self;
  const sv_prior_depth *d = sv_prior_depth_of(p, im->i_view, &p->t->views[im->i_view].view);
  const double loss = sv_prior_depth_loss(p, d, im->scale, sv_prior_depth_share(p, im->progress));
  im->g_depth = p->g_depth;
  im->g_trans = p->g_trans;
  return loss;
}

static bool has_images(void *self, float progress) { return sv_prior_is_due(self, progress); }

static sv_status add_images(void *self, float progress, const sv_render_options *o, double *loss) {
  return sv_prior_step(self, progress, o, loss);
}

static sv_status after_step(void *self, float progress) { return sv_prior_update(self, progress); }

static const sv_train_hooks hooks = {.before_render = before_render,
                                     .add_loss = add_loss,
                                     .has_images = has_images,
                                     .add_images = add_images,
                                     .after_step = after_step,
                                     .start = start};

static sv_status check(const sv_prior_cfg *c, const sv_train_cfg *t, sv_err *err) {
  if (t->has_motion || t->cap_measurements > 0)
    return sv_fail(
        err, SV_E_UNSUPPORTED,
        "sparse-view priors are for still scenes and whole pictures: not for moving ones, and not on "
        "multiplexed sensors");
  if (c->cap_pseudo < 0 || c->cap_depths < 0 || (c->cap_pseudo > 0 && c->every < 1))
    return sv_fail(err, SV_E_ARG,
                   "%d pseudo-views, one every %d steps, and %d depth maps, expected 0 or more",
                   c->cap_pseudo, c->every, c->cap_depths);
  if (c->cap_pseudo > 0 && !t->has_images)
    return sv_fail(err, SV_E_ARG, "pseudo-views for a trainer without room for further images");
  return SV_OK;
}

sv_status sv_prior_init(sv_prior *p, const sv_prior_cfg *cfg, sv_trainer *t, sv_arena *arena, sv_err *err) {
  memset(p, 0, sizeof *p);
  p->cfg = *cfg;
  p->t = t;
  p->cap_pixels = cap_pixels_of(&t->cfg);
  p->rng = sv_rng_make(t->cfg.seed, 11);
  if (!has_any(cfg) && !cfg->method) return SV_OK;
  sv_status s = check(cfg, &t->cfg, err);
  if (s < 0 || !has_any(cfg)) return s;
  s = carve(p, cfg, &t->cfg, t->compute, arena);
  if (s < 0)
    return sv_fail(err, s, "priors need %zu bytes beside the trainer's, and the memory block has %zu left",
                   sv_prior_bytes(cfg, &t->cfg), arena->cap_bytes - arena->used_bytes);
  return sv_train_attach(t, &hooks, p);
}

void sv_prior_clear(sv_prior *p) {
  for (int i = 0; i < p->cfg.cap_depths; i++) p->depths[i].id = -1;
  p->n_depths = 0;
  forget_steps(p);
}

sv_status sv_prior_submit_view(sv_prior *p, const sv_view *view, const sv_image_u8 *im, float weight,
                               float until, int *id) {
  const int n = im->n_channels;
  if (p->cfg.cap_pseudo < 1) return SV_E_FULL;
  if (im->width_px != view->width_px || im->height_px != view->height_px || view->width_px < 1 ||
      view->height_px < 1 || (n != 3 && n != 4) || !(weight >= 0.0f) ||
      sv_plane_floats(view->width_px, view->height_px) > p->cap_pixels)
    return SV_E_RANGE;
  sv_prior_view *v = &p->views[p->n_views % p->cfg.cap_pseudo];
  v->view = *view;
  v->weight = weight;
  v->until = until;
  v->id = SV_PRIOR_FIRST_PSEUDO + p->n_views++;
  for (int y = 0; y < im->height_px; y++) {
    const uint8_t *src = im->px + (size_t)y * (size_t)im->stride_bytes;
    uint8_t *dst = v->rgba + 4 * (size_t)y * (size_t)im->width_px;
    for (int x = 0; x < im->width_px; x++) {
      memcpy(dst + 4 * x, src + n * x, 3);
      dst[4 * x + 3] = n == 4 ? src[4 * x + 3] : 255;
    }
  }
  *id = v->id;
  return SV_OK;
}

// The map that this view already has, a place that nobody needs (never used, or of a pseudo-view
// that is gone), else the next in turn: maps of training views stay while there is room.
static sv_prior_depth *place_of(sv_prior *p, int id) {
  sv_prior_depth *unused = NULL;
  for (int i = 0; i < p->cfg.cap_depths; i++) {
    sv_prior_depth *d = &p->depths[i];
    const bool is_gone =
        d->id >= SV_PRIOR_FIRST_PSEUDO && d->id - SV_PRIOR_FIRST_PSEUDO < p->n_views - p->cfg.cap_pseudo;
    if (d->id == id) return d;
    if (!unused && (d->id < 0 || is_gone)) unused = d;
  }
  return unused ? unused : &p->depths[p->n_depths++ % p->cfg.cap_depths];
}

static bool is_opaque(const sv_image_u8 *im, int x, int y) {
  const size_t at = (size_t)y * (size_t)im->stride_bytes + (size_t)(x * im->n_channels);
  return im->n_channels < 4 || im->px[at + 3] >= 128;
}

// What was estimated from masked or transparent pixels of a training view is not known.
static void forget_masked(const sv_trainer *t, sv_prior_depth *d) {
  const sv_image_u8 *im = d->id < t->n_views ? &t->views[d->id].image : NULL;
  if (!im || im->width_px != d->width_px || im->height_px != d->height_px) return;
  for (int y = 0; y < d->height_px; y++)
    for (int x = 0; x < d->width_px; x++)
      if (!sv_image_counts(im, 1, x, y) || !is_opaque(im, x, y))
        d->map[(size_t)y * (size_t)d->width_px + (size_t)x] = -1.0f;
}

sv_status sv_prior_submit_depth(sv_prior *p, int id, const sv_prior_map *map) {
  const int width_px = map->width_px, height_px = map->height_px;
  if (p->cfg.cap_depths < 1) return SV_E_FULL;
  if (id < 0 || width_px < 1 || height_px < 1 || !(map->weight >= 0.0f) ||
      sv_plane_floats(width_px, height_px) > p->cap_pixels)
    return SV_E_RANGE;
  sv_prior_depth *d = place_of(p, id);
  d->id = id;
  d->width_px = width_px;
  d->height_px = height_px;
  d->kind = map->kind;
  d->weight = map->weight;
  d->is_of_depth = d->is_measured = false;
  d->trust = 1.0f;
  memcpy(d->map, map->px, (size_t)width_px * (size_t)height_px * sizeof *map->px);
  forget_masked(p->t, d);
  return SV_OK;
}

sv_prior_depth *sv_prior_find_depth(const sv_prior *p, int id, const sv_view *view) {
  for (int i = 0; i < p->cfg.cap_depths; i++) {
    sv_prior_depth *d = &p->depths[i];
    if (d->id == id && d->weight > 0.0f && d->width_px == view->width_px && d->height_px == view->height_px)
      return d;
  }
  return NULL;
}

int sv_prior_n_alive(const sv_prior *p, float progress) {
  int n = 0;
  for (int i = 0; i < p->cfg.cap_pseudo; i++) n += p->views[i].id > 0 && p->views[i].until > progress;
  return n;
}
