// SPDX-License-Identifier: Apache-2.0
// The context's memory, its start, and the hooks by which it attaches to a trainer.
#include "src/dynamic/dynamic.h"

#include <string.h>

#include "src/base/mathx.h"
#include "src/dynamic/checkpoint.h"
#include "src/dynamic/curriculum.h"
#include "src/dynamic/distil.h"
#include "src/dynamic/match.h"
#include "src/dynamic/search.h"
#include "src/dynamic/update.h"
#include "src/train/relocate.h"

// The trainer's sizes may be those of one that is only planned.
static sv_status carve(sv_dynamic *dyn, const sv_dynamic_cfg *c, const sv_train_cfg *t, const sv_gaussians *g,
                       sv_arena *a) {
  const sv_motion_cfg mc = {.functions = c->functions,
                            .n_pos = c->n_pos,
                            .n_rot = c->n_rot,
                            .n_colour = c->n_colour,
                            .has_grad = true,
                            .cap_knots = sv_dynamic_has_bodies(c) ? sv_mini(t->cap_views, SV_CAP_KNOTS) : 0};
  sv_arena_part_begin(a, "motion");
  dyn->is_moving = SV_TAKE(a, uint8_t, g->cap);
  dyn->hidden_for = SV_TAKE(a, uint8_t, g->cap);
  float **each[] = {&dyn->n_seen, &dyn->residual_mean, &dyn->residual_dev, &dyn->temporal_residual,
                    &dyn->share,  &dyn->residual};
  for (size_t i = 0; i < sizeof each / sizeof *each; i++) *each[i] = SV_TAKE(a, float, g->cap);
  const bool is_matched = sv_dynamic_has_clip(c) && c->grow_until > 0;
  dyn->match = is_matched ? SV_TAKE(a, sv_match_sum, g->cap) : NULL;
  dyn->near = is_matched ? sv_local_motion_carve(g->cap, a) : NULL;
  dyn->assignment = sv_dynamic_has_bodies(c) ? SV_TAKE(a, sv_body_assignment, g->cap) : NULL;
  if (sv_dynamic_has_bodies(c))
    dyn->body_sum = sv_arena_take(a, (size_t)g->cap / 16 / SV_FIELD_TASK + 1, sizeof *dyn->body_sum);
  dyn->deform.kind = c->kind;
  if (c->kind == SV_DEFORM_FIELD) {
    sv_field_cfg fc = c->field;
    fc.has_grad = true;
    fc.n_threads = t->n_threads;
    fc.cap_knots = mc.cap_knots;
    sv_status s = sv_field_init(&dyn->deform.field, &fc, g, a);
    if (s < 0 || !sv_dynamic_has_clip(c)) return s;
    dyn->deform.kind = SV_DEFORM_CLIP;
    dyn->distilled = *g;
    dyn->distilled.param = SV_TAKE(a, float, (size_t)g->cap *(size_t)g->n_rows);
  }
  return sv_motion_init(&dyn->deform.motion, &mc, g, a);
}

// Apart, so that the context and the arena do not share a stack frame.
static __attribute__((noinline)) size_t carved_bytes(sv_dynamic *dyn, const sv_dynamic_cfg *cfg,
                                                     const sv_train_cfg *t) {
  const sv_gaussians g = {.n = t->n_gaussians,
                          .cap = (t->n_gaussians + 15) / 16 * 16,
                          .sh_degree = t->sh_degree,
                          .n_rows = SV_N_ROWS(t->sh_degree)};
  sv_arena dry = sv_arena_dry();
  return carve(dyn, cfg, t, &g, &dry) < 0 ? 0 : dry.used_bytes;
}

size_t sv_dynamic_bytes(const sv_dynamic_cfg *cfg, const sv_train_cfg *train) {
  sv_dynamic dyn;
  memset(&dyn, 0, sizeof dyn);
  return cfg->kind == SV_DEFORM_NONE ? 0 : carved_bytes(&dyn, cfg, train);
}

// --- state ---------------------------------------------------------------------------------------

static void start(void *self) {
  sv_dynamic *dyn = self;
  sv_dynamic_set_usual_view(dyn);
  dyn->field_step = dyn->n_renewed = 0;
  dyn->matched_until = 0.0f;
  dyn->next_search = dyn->cfg.from;
  memset(dyn->is_moving, 0, (size_t)dyn->t->g.cap);
  memset(dyn->hidden_for, 0, (size_t)dyn->t->g.cap);
  if (sv_dynamic_has_clip(&dyn->cfg)) dyn->deform.kind = SV_DEFORM_CLIP;
  if (dyn->deform.kind == SV_DEFORM_CLIP) sv_motion_reset(&dyn->deform.motion, 0);
  if (dyn->cfg.kind == SV_DEFORM_FIELD) sv_field_reset(&dyn->deform.field, &dyn->t->g, dyn->t->cfg.seed);
  sv_deform_set_moving(&dyn->deform, 0);
}

static void set_time(void *self, float time) {
  sv_dynamic *dyn = self;
  dyn->time = time;
  sv_deform_at(&dyn->deform, &dyn->t->compute, &dyn->t->g, time);
}

// A relocated Gaussian gets the motion of its source, in a window of its own.
static void copy(void *self, int to, int from) {
  sv_dynamic *dyn = self;
  const double w = (double)dyn->cfg.window_start;
  dyn->is_moving[to] = dyn->is_moving[from];
  sv_field *f = &dyn->deform.field;
  if (dyn->deform.kind == SV_DEFORM_FIELD && f->bodies.n > 1 && to < f->n_moving)
    f->bodies.of[to] = from < f->n_moving ? f->bodies.of[from] : 0;
  if (dyn->deform.kind != SV_DEFORM_CLIP) return;
  sv_motion_copy(&dyn->deform.motion, to, from);
  if (!dyn->is_moving[to] || dyn->cfg.kind != SV_DEFORM_CLIP) return;
  float *c = sv_motion_row(&dyn->deform.motion, to, SV_MROW_CENTRE), *sharpness = c + 16;
  double half = sv_exp(-0.5 * (double)*sharpness); // where the window takes 1 from the logit
  if (w > 0 && half > w) {
    *c = sv_rng_f(&dyn->t->rng);
    *sharpness = (float)sv_log(4.0 / (w * w));
  } else *c = sv_clampf(*c + sv_rng_normal(&dyn->t->rng) * sv_minf(0.5f, 0.5f * (float)half), -0.1f, 1.1f);
}

static uint64_t fnv1a(uint64_t h, const float *v, size_t n) {
  for (size_t i = 0; i < n; i++) {
    uint32_t b;
    memcpy(&b, v + i, 4);
    for (int k = 0; k < 4; k++) h = (h ^ (b >> (8 * k) & 255)) * 1099511628211ull;
  }
  return h;
}

static uint64_t digest_of_bodies(const sv_bodies *b, int n_moving, uint64_t h) {
  for (int body = 1; body < b->n; body++) {
    h = fnv1a(h, b->centre[body], 3);
    for (int i = 0; i < b->n_knots; i++) {
      const sv_rigid *m = sv_bodies_knot(b, body, i);
      h = fnv1a(fnv1a(h, m->q, 4), m->d, 3);
    }
  }
  for (int i = 0; i < n_moving && b->n > 1; i++) h = (h ^ b->of[i]) * 1099511628211ull;
  return h;
}

uint64_t sv_dynamic_digest(const sv_deform *d, uint64_t h) {
  const sv_motion *mo = &d->motion;
  if (d->kind == SV_DEFORM_FIELD)
    return digest_of_bodies(&d->field.bodies, d->field.n_moving, fnv1a(h, d->field.param, d->field.n_param));
  h = fnv1a(h, mo->param, (size_t)(mo->n_moving + 15) / 16 * 16 * (size_t)mo->n_rows);
  return digest_of_bodies(&mo->bodies, mo->n_moving, h);
}

static uint64_t digest(const void *self, uint64_t h) {
  const sv_dynamic *dyn = self;
  return sv_dynamic_digest(&dyn->deform, h);
}

static void count(const void *self, int *n_moving, uint32_t *n_renewed) {
  const sv_dynamic *dyn = self;
  *n_moving = sv_deform_n_moving(&dyn->deform);
  *n_renewed = dyn->n_renewed;
}

// --- a step's stages -----------------------------------------------------------------------------

static void choose_view(void *self, sv_train_choice *c) { sv_dynamic_choose_view(self, c); }

static sv_status before_render(void *self, sv_train_image *im) {
  sv_dynamic *dyn = self;
  const float time = im->view.time;
  im->weight = sv_dynamic_weight(dyn, &dyn->t->views[im->i_view].view);
  im->view.time = sv_distil_time(dyn, time);
  if (im->view.time != time) {
    sv_status s = sv_distil_load_target(dyn, &im->view, &im->options);
    if (s < 0) return s;
    im->has_target = true;
  }
  set_time(dyn, im->view.time);
  return SV_OK;
}

static sv_status after_step(void *self, float progress) {
  sv_dynamic_finish_update(self, progress);
  return SV_OK;
}

// A search renders all views, at half their size: about half a step each. In progress, by what a
// step has taken so far, so that searches never take more than half of a run, be it one of many
// views and little time.
static float search_costs(const sv_dynamic *dyn, float progress) {
  return 0.5f * (float)dyn->t->n_views * progress / (float)dyn->t->step;
}

static sv_status search(void *self, float progress) {
  sv_dynamic *dyn = self;
  const bool is_distilled = sv_distil_is_on(dyn);
  if (!is_distilled && progress >= dyn->cfg.from && sv_train_is_relocation_due(dyn->t, progress))
    sv_dynamic_sort(dyn);
  sv_status s = sv_dynamic_match(dyn, dyn->matched_until, progress);
  if (s < 0) return s;
  dyn->matched_until = progress;
  if (is_distilled || progress < dyn->next_search || progress > dyn->cfg.find_until) return SV_OK;
  if ((s = sv_dynamic_search(dyn, progress)) < 0) return s;
  dyn->next_search = progress + sv_maxf(dyn->cfg.find_every, search_costs(dyn, progress));
  return SV_OK;
}

static void begin_update(void *self, float progress, const sv_adam_args *adam) {
  sv_dynamic_begin_update(self, progress, adam);
}

static void update_block(void *self, int block, int i_thread, uint32_t touched, float *grad, float *scratch) {
  sv_dynamic_update_block(self, block, i_thread, touched, grad, scratch);
}

static void pull_back(void *self, int block, uint32_t touched, float *grad) {
  sv_dynamic_pull_back(self, block, touched, grad);
}

static const sv_train_hooks hooks = {.choose_view = choose_view,
                                     .before_render = before_render,
                                     .after_step = after_step,
                                     .search = search,
                                     .start = start,
                                     .set_time = set_time,
                                     .copy = copy,
                                     .digest = digest,
                                     .count = count,
                                     .begin_update = begin_update,
                                     .update_block = update_block,
                                     .pull_back = pull_back,
                                     .checkpoint_bytes = sv_dynamic_checkpoint_bytes,
                                     .save_head = sv_dynamic_save_head,
                                     .save = sv_dynamic_save,
                                     .is_loadable = sv_dynamic_is_loadable,
                                     .load = sv_dynamic_load};

sv_status sv_dynamic_init(sv_dynamic *dyn, const sv_dynamic_cfg *cfg, sv_trainer *t, sv_arena *arena,
                          sv_err *err) {
  memset(dyn, 0, sizeof *dyn);
  dyn->cfg = *cfg;
  dyn->t = t;
  if (cfg->kind == SV_DEFORM_NONE) return SV_OK;
  if (!t->cfg.has_motion) return sv_fail(err, SV_E_ARG, "motion for a trainer of still scenes");
  if (cfg->kind == SV_DEFORM_FIELD && sv_field_check(&cfg->field, err) < 0) return SV_E_ARG;
  sv_status s = carve(dyn, cfg, &t->cfg, &t->g, arena);
  if (s >= 0 && arena->status < 0) s = arena->status;
  if (s < 0)
    return sv_fail(
        err, s,
        "motion needs %zu bytes beside the trainer's, and the memory block has %zu left; use fewer "
        "Gaussians",
        sv_dynamic_bytes(cfg, &t->cfg), arena->cap_bytes - arena->used_bytes);
  return sv_train_attach(t, &hooks, dyn);
}
