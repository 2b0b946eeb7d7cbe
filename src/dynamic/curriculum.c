// SPDX-License-Identifier: Apache-2.0
// Which image a step takes. Times are added outwards from the middle one (temporal curriculum), the
// latest ones at reduced size and with more turns; images of unusual lenses have fewer turns and
// count less.
#include "src/dynamic/curriculum.h"

#include <math.h>

#include "src/base/mathx.h"
#include "src/dynamic/distil.h"
#include "src/train/step.h"

// Progress of the temporal curriculum, 0 to 1: the share of the times on both sides of the middle
// one that are trained on. 1 without a curriculum.
static float grown(const sv_dynamic_cfg *d, float progress) {
  if (!(d->grow_until > d->from) || progress >= d->grow_until) return 1.0f;
  return sv_maxf((progress - d->from) / (d->grow_until - d->from), 0.0f);
}

static float farthest(const sv_dynamic *dyn) {
  return sv_maxf(dyn->t->reference_time, 1.0f - dyn->t->reference_time);
}

bool sv_dynamic_has_time(const sv_dynamic *dyn, float time, float progress) {
  const sv_dynamic_cfg *d = &dyn->cfg;
  if (progress >= d->grow_until) return true;
  float reach = sv_maxf(d->grow_start, 1e-6f) + (farthest(dyn) - d->grow_start) * grown(d, progress);
  return fabsf(time - dyn->t->reference_time) <= reach;
}

int sv_dynamic_min_scale(const sv_dynamic *dyn, float time, float progress) {
  const sv_dynamic_cfg *d = &dyn->cfg;
  if (!(d->grow_until > d->from) || progress <= d->from) return sv_maxi(d->min_scale, 1);
  float x = (fabsf(time - dyn->t->reference_time) - d->grow_start) / (farthest(dyn) - d->grow_start);
  float age = progress - d->from - (d->grow_until - d->from) * sv_maxf(x, 0.0f);
  if (x <= 0 || age >= d->coarse_for) return 1;
  return age < 0.5f * d->coarse_for ? dyn->t->cfg.start_scale : sv_mini(2, dyn->t->cfg.start_scale);
}

static float solid_angle(const sv_view *v) {
  return (float)v->width_px * (float)v->height_px / (v->fx * v->fy);
}

// Square root of a view's solid angle, in that of the usual picture; 1 for still scenes.
static float width_of(const sv_dynamic *dyn, const sv_view *view) {
  return dyn->usual_sr > 0 ? sqrtf(solid_angle(view) / dyn->usual_sr) : 1.0f;
}

float sv_dynamic_turn_share(const sv_dynamic *dyn, const sv_view *view) {
  float width = width_of(dyn, view), share = width > 1.0f ? 1.0f / width : width;
  return share < dyn->cfg.share_min ? dyn->cfg.share_min : share;
}

float sv_dynamic_weight(const sv_dynamic *dyn, const sv_view *view) {
  return sv_minf(width_of(dyn, view), 1.0f);
}

void sv_dynamic_set_usual_view(sv_dynamic *dyn) {
  dyn->usual_sr = dyn->usual_fx_px = 0.0f;
  for (int i = 0; i < dyn->t->n_views; i++) {
    float here = solid_angle(&dyn->t->views[i].view);
    int n_less = 0, n_same = 0;
    for (int j = 0; j < dyn->t->n_views; j++) {
      float there = solid_angle(&dyn->t->views[j].view);
      n_less += there < here;
      n_same += there == here;
    }
    if (n_less > dyn->t->n_views / 2 || n_less + n_same <= dyn->t->n_views / 2) continue;
    dyn->usual_sr = here;
    dyn->usual_fx_px = dyn->t->views[i].view.fx;
    return;
  }
}

int sv_dynamic_n_functions(const sv_dynamic *dyn, float progress) {
  const sv_motion_cfg *mc = &dyn->deform.motion.cfg;
  if (mc->functions != SV_MOTION_CHEBYSHEV) return mc->n_pos;
  return sv_mini(mc->n_pos, 1 + (int)((float)mc->n_pos * grown(&dyn->cfg, progress)));
}

// --- choice --------------------------------------------------------------------------------------

static bool is_newest_due(const sv_dynamic *dyn) {
  const int every = dyn->cfg.older_every;
  return every > 0 && dyn->t->n_views > 0 && dyn->t->step % (uint32_t)every != 0;
}

// One of the sub-views of the newest time, in turn.
static int newest_view(const sv_dynamic *dyn) {
  int n = 0, k = 0;
  for (int i = 0; i < dyn->t->n_views; i++) n += dyn->t->views[i].view.time >= dyn->t->newest_time;
  if (n == 0) return 0; // its picture was replaced by an older one
  uint32_t turn = (dyn->t->step - dyn->t->step / (uint32_t)dyn->cfg.older_every) % (uint32_t)n;
  while (dyn->t->views[k].view.time < dyn->t->newest_time || turn-- > 0) k++;
  return k;
}

// In clip mode now and then one of the views whose time came in last, on either side. -1: none is
// due. (A network that all times share would forget the others.)
static int frontier_view(sv_dynamic *dyn, float progress) {
  const sv_dynamic_cfg *d = &dyn->cfg;
  if (dyn->deform.kind != SV_DEFORM_CLIP || d->front_every < 1 || dyn->t->step % (uint32_t)d->front_every)
    return -1;
  if (progress < d->from || progress >= d->grow_until) return -1;
  float first = dyn->t->reference_time, last = dyn->t->reference_time;
  for (int i = 0; i < dyn->t->n_views; i++) {
    float time = dyn->t->views[i].view.time;
    if (!sv_dynamic_has_time(dyn, time, progress)) continue;
    first = sv_minf(first, time);
    last = sv_maxf(last, time);
  }
  int n = 0, k = 0;
  for (int i = 0; i < dyn->t->n_views; i++)
    n += dyn->t->views[i].view.time == first || dyn->t->views[i].view.time == last;
  if (n == 0) return -1;
  int turn = (int)sv_rng_below(&dyn->t->rng, (uint32_t)n);
  while ((dyn->t->views[k].view.time != first && dyn->t->views[k].view.time != last) || turn-- > 0) k++;
  return k;
}

static bool is_passed_over(sv_dynamic *dyn, int i, float progress) {
  if (!sv_dynamic_has_time(dyn, dyn->t->views[i].view.time, progress)) return true;
  float share = sv_dynamic_turn_share(dyn, &dyn->t->views[i].view);
  return share < 1.0f && sv_rng_f(&dyn->t->rng) >= share;
}

static int choose(sv_dynamic *dyn, float progress) {
  int i = is_newest_due(dyn) ? newest_view(dyn) : frontier_view(dyn, progress);
  if (i >= 0 && !is_passed_over(dyn, i, progress)) return i;
  do i = sv_train_next_item(dyn->t);
  while (is_passed_over(dyn, i, progress));
  return i;
}

void sv_dynamic_choose_view(sv_dynamic *dyn, sv_train_choice *c) {
  if (dyn->deform.kind != dyn->cfg.kind && c->progress >= dyn->cfg.distil_at) sv_distil_begin(dyn);
  if (dyn->fit_steps_left > 0) {
    sv_distil_fit(dyn, c->progress);
    return; // no step
  }
  c->progress = sv_distil_stage_progress(dyn, c->progress);
  c->i_view = choose(dyn, c->progress);
  c->min_scale = sv_dynamic_min_scale(dyn, dyn->t->views[c->i_view].view.time, c->progress);
  c->can_relocate = !sv_distil_is_on(dyn); // the distilled model has as many Gaussians that move
}
