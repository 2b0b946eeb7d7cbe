// SPDX-License-Identifier: Apache-2.0
// Training of moving scenes: what belongs to time in a step.
#include <string.h>

#include "src/base/mathx.h"
#include "src/train/train.h"

// What a body's part does of its own has to be asked for more: the body should have done it.
#define PART_SHRINK 3.0f

bool sv_train_is_dynamic(const sv_trainer *t) { return t->cfg.dynamic.kind != SV_DEFORM_NONE; }

void sv_train_set_time(sv_trainer *t, float time) {
  if (!sv_train_is_dynamic(t)) return;
  t->time = time;
  sv_deform_at(&t->deform, &t->compute, &t->g, time);
}

// 0..1 while the times come in, to both sides of the middle one; 1 when there is nothing to wait for.
static float grown(const sv_dynamic_cfg *d, float progress) {
  if (!(d->grow_until > d->from) || progress >= d->grow_until) return 1.0f;
  return sv_maxf((progress - d->from) / (d->grow_until - d->from), 0.0f);
}

static float farthest(const sv_trainer *t) { return sv_maxf(t->middle, 1.0f - t->middle); }

bool sv_train_has_time(const sv_trainer *t, float time, float progress) {
  const sv_dynamic_cfg *d = &t->cfg.dynamic;
  if (!sv_train_is_dynamic(t) || progress >= d->grow_until) return true;
  float reach = sv_maxf(d->grow_start, 1e-6f) + (farthest(t) - d->grow_start) * grown(d, progress);
  return fabsf(time - t->middle) <= reach;
}

int sv_train_new_time_scale(const sv_trainer *t, float time, float progress) {
  const sv_dynamic_cfg *d = &t->cfg.dynamic;
  if (!sv_train_is_dynamic(t) || !(d->grow_until > d->from) || progress <= d->from) return 1;
  float x = (fabsf(time - t->middle) - d->grow_start) / (farthest(t) - d->grow_start);
  float age = progress - d->from - (d->grow_until - d->from) * sv_maxf(x, 0.0f);
  if (x <= 0 || age >= d->coarse_for) return 1;
  return age < 0.5f * d->coarse_for ? t->cfg.start_scale : sv_mini(2, t->cfg.start_scale);
}

static float solid_angle(const sv_view *v) {
  return (float)v->width_px * (float)v->height_px / (v->fx * v->fy);
}

// Square root of a view's solid angle, in that of the usual picture; 1 for still scenes.
static float width_of(const sv_trainer *t, const sv_view *view) {
  return sv_train_is_dynamic(t) && t->usual_sr > 0 ? sqrtf(solid_angle(view) / t->usual_sr) : 1.0f;
}

float sv_train_share(const sv_trainer *t, const sv_view *view) {
  float width = width_of(t, view), share = width > 1.0f ? 1.0f / width : width;
  return share < t->cfg.dynamic.least_share ? t->cfg.dynamic.least_share : share;
}

float sv_train_weight(const sv_trainer *t, const sv_view *view) { return sv_minf(width_of(t, view), 1.0f); }

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
  if (weight < 1.0f) sv_pool_run(t->compute.pool, weigh_task, &j, err ? 4 : 3);
}

static void set_usual_view(sv_trainer *t) {
  t->usual_sr = t->usual_fx_px = 0.0f;
  for (int i = 0; i < t->n_views; i++) {
    float here = solid_angle(&t->views[i].view);
    int n_less = 0, n_same = 0;
    for (int j = 0; j < t->n_views; j++) {
      float there = solid_angle(&t->views[j].view);
      n_less += there < here, n_same += there == here;
    }
    if (n_less > t->n_views / 2 || n_less + n_same <= t->n_views / 2) continue;
    t->usual_sr = here, t->usual_fx_px = t->views[i].view.fx;
    return;
  }
}

int sv_train_n_functions(const sv_trainer *t, float progress) {
  const sv_motion_cfg *mc = &t->deform.motion.cfg;
  if (mc->functions != SV_MOTION_CHEBYSHEV) return mc->n_pos;
  return sv_mini(mc->n_pos, 1 + (int)((float)mc->n_pos * grown(&t->cfg.dynamic, progress)));
}

void sv_train_motion_rates(const sv_trainer *t, float progress, float mean_lr, double bias1,
                           float lr[SV_CAP_MROWS]) {
  const sv_dynamic_cfg *d = &t->cfg.dynamic;
  const sv_motion_cfg *mc = &t->deform.motion.cfg;
  // What is not a position follows the means' schedule half as far (in the logarithm).
  float late = sqrtf(mean_lr / (t->cfg.lr.mean_start * t->radius)), f = (float)(1.0 / bias1);
  int n_on = sv_train_n_functions(t, progress);
  int rot = SV_MROW_FUNCTIONS + 3 * mc->n_pos, colour = rot + 4 * mc->n_rot;
  // What a field is to begin with neither comes and goes nor changes its colour.
  const float window = d->kind == SV_DEFORM_CLIP ? d->window : 0,
              dye = d->kind == SV_DEFORM_CLIP ? d->colour : 0;
  int off = SV_MROW_FUNCTIONS + 3 * n_on;
  for (int i = 0; i < t->deform.motion.n_rows; i++)
    lr[i] = f * (i < SV_MROW_FUNCTIONS ? window * late
                 : i < off             ? d->pos * mean_lr
                 : i < rot             ? 0.0f
                 : i < colour          ? d->rot * late
                                       : dye * late);
}

// A step of length `by` down the length of each touched lane's coefficients c[n][3][16], function j's times j + 1:
// the group lasso's, beside Adam as in AdamW (Loshchilov & Hutter 2019), so that it is not normalised away. Parts of
// bodies (of, or NULL): PART_SHRINK as long.
static void shrink(float *c, int n, float by, uint32_t touched, const uint8_t *of) {
  float len2[16] = {0}, share[16];
  for (int j = 0; j < n; j++) {
    float w = (float)((j + 1) * (j + 1));
    for (int i = 0; i < 48; i++) len2[i & 15] += w * (c[48 * j + i] * c[48 * j + i]);
  }
  for (int k = 0; k < 16; k++)
    share[k] =
        (touched >> k & 1) && len2[k] > 0 ? (of && of[k] ? PART_SHRINK : 1.0f) * by / sqrtf(len2[k]) : 0.0f;
  for (int j = 0; j < n; j++) {
    float w = (float)((j + 1) * (j + 1));
    for (int i = 0; i < 48; i++) c[48 * j + i] -= c[48 * j + i] * sv_minf(1.0f, w * share[i & 15]);
  }
}

void sv_train_move_block(sv_trainer *t, const sv_motion_args *a, const sv_adam_args *adam, int block,
                         uint32_t touched, float *grad, float *scratch) {
  int left = t->deform.motion.n_moving - 16 * block;
  if (left < 16) touched &= (1u << left) - 1; // the still ones of the last block stay still
  if (t->deform.motion.bodies.n > 1)
    sv_motion_bodies_bwd(&t->deform.motion, block, touched, grad, t->body_sum[block / SV_FIELD_TASK]);
  t->compute.k->motion_bwd(a, block, touched, grad, scratch);
  size_t at = (size_t)block * (size_t)t->deform.motion.n_rows * 16;
  float *p = t->deform.motion.param + at;
  t->compute.k->adam(adam, touched, scratch, p, t->deform.motion.m + at, t->deform.motion.v + at);
  if (t->cfg.dynamic.shrink_pos > 0 && a->n_pos > 0)
    shrink(p + 16 * SV_MROW_FUNCTIONS, a->n_pos, t->cfg.dynamic.shrink_pos * adam->lr[SV_MROW_FUNCTIONS],
           touched, t->deform.motion.bodies.of ? t->deform.motion.bodies.of + 16 * block : NULL);
}

// --- who moves -----------------------------------------------------------------------------------

// Pixels per world unit at a place, in the view that sees it largest.
static float rate_at(const sv_trainer *t, const float x[3]) {
  float most = 0;
  for (int i = 0; i < t->n_views; i++) {
    const sv_view *v = &t->views[i].view;
    float z = v->r[6] * x[0] + v->r[7] * x[1] + v->r[8] * x[2] + v->t[2];
    if (z > 0 && v->fx / z > most) most = v->fx / z;
  }
  return most;
}

static bool is_worth_it(const sv_trainer *t, int i) {
  if (t->deform.kind != SV_DEFORM_CLIP) return true; // a field does not tell before it is asked
  const sv_dynamic_cfg *d = &t->cfg.dynamic;
  const float *p = sv_gaussians_at(&t->g, i, SV_ROW_MEAN), x[3] = {p[0], p[16], p[32]};
  sv_motion_extent e = sv_motion_extent_of(&t->deform.motion, i);
  return e.distance * rate_at(t, x) > d->still_px || e.fade > d->still_fade || e.colour > d->still_colour;
}

static void swap_f(float *a, float *b) {
  float s = *a;
  *a = *b, *b = s;
}

static void swap_h(uint16_t *a, uint16_t *b) {
  uint16_t s = *a;
  *a = *b, *b = s;
}

static void swap_slots(sv_trainer *t, int i, int j) {
  long a = sv_gaussians_at(&t->g, i, 0) - t->g.param, b = sv_gaussians_at(&t->g, j, 0) - t->g.param;
  for (int r = 0; r < t->g.n_rows; r++) {
    swap_f(t->g.param + a + 16 * r, t->g.param + b + 16 * r);
    swap_h(t->m + a + 16 * r, t->m + b + 16 * r);
    swap_h(t->v + a + 16 * r, t->v + b + 16 * r);
  }
  swap_f(t->err + i, t->err + j);
  if (t->floor) swap_f(t->floor + i, t->floor + j);
  if (t->deform.kind == SV_DEFORM_CLIP) sv_motion_swap(&t->deform.motion, i, j);
  uint8_t s = t->is_moving[i];
  t->is_moving[i] = t->is_moving[j], t->is_moving[j] = s;
}

void sv_train_sort_moving(sv_trainer *t) {
  for (int i = 0; i < t->g.n; i++) {
    if (t->is_moving[i] == 1 && !is_worth_it(t, i)) t->is_moving[i] = 0;
    if (t->is_moving[i] == 2) t->is_moving[i] = 1;
    if (!t->is_moving[i] && t->deform.kind == SV_DEFORM_CLIP) sv_motion_still(&t->deform.motion, i);
  }
  int n = 0, j = t->g.n - 1;
  for (;;) {
    while (n <= j && t->is_moving[n]) n++;
    while (j > n && !t->is_moving[j]) j--;
    if (n >= j) break;
    swap_slots(t, n, j);
  }
  sv_deform_set_moving(&t->deform, n);
}

// --- what moves ----------------------------------------------------------------------------------

typedef struct {
  sv_trainer *t;
  float *sum;
  int n_blocks;
} share_job;

#define BLOCKS_PER_TASK 64

static void share_task(void *arg, int i_task, int i_thread) {
  const share_job *j = arg;
  sv_trainer *t = j->t;
  float *grad = t->block + (size_t)i_thread * SV_TRAIN_BLOCK_FLOATS, err[16];
  int b1 = sv_mini((i_task + 1) * BLOCKS_PER_TASK, j->n_blocks);
  for (int b = i_task * BLOCKS_PER_TASK; b < b1; b++) {
    (void)sv_render_bwd_block(&t->render, b, i_thread, NULL, &(sv_block_grads){grad, err, NULL});
    for (int k = 0; k < 16; k++) j->sum[16 * b + k] += err[k];
  }
}

static sv_status share_out(sv_trainer *t, const float *plane, float *sum) {
  share_job j = {.t = t, .sum = sum, .n_blocks = (t->g.n + 15) / 16};
  sv_status s = sv_render_bwd(&t->render, &t->grad, NULL, NULL, plane);
  if (s >= 0)
    sv_pool_run(t->compute.pool, share_task, &j, (j.n_blocks + BLOCKS_PER_TASK - 1) / BLOCKS_PER_TASK);
  return s;
}

void sv_train_clear_shares(sv_trainer *t) {
  for (int i = 0; i < t->g.cap; i++) t->weight[i] = t->residual[i] = 0.0f;
}

sv_status sv_train_share_residual(sv_trainer *t) {
  float *one = t->target.c[0]; // the target has done its duty
  for (size_t p = 0; p < sv_plane_floats(t->grad.width_px, t->grad.height_px); p++) one[p] = 1.0f;
  sv_status s = share_out(t, one, t->weight);
  if (s >= 0) s = share_out(t, t->err_plane, t->residual);
  sv_planes_clear(&t->target);
  return s;
}

static sv_status look_at(sv_trainer *t, int i_view, float progress) {
  sv_status s = sv_train_residual(t, i_view, progress);
  sv_train_clear_shares(t);
  if (s >= 0) sv_train_look_at_members(t, i_view);
  if (s >= 0) s = sv_train_share_residual(t);
  for (int i = 0; i < t->g.n && s >= 0; i++) {
    if (!(t->weight[i] > SV_TRAIN_WEIGHT_MIN)) continue;
    float x = t->residual[i] / t->weight[i], d = x - t->res_mean[i]; // Welford's update
    t->n_seen[i] += 1.0f;
    t->res_mean[i] += d / t->n_seen[i];
    t->res_dev[i] += d * (x - t->res_mean[i]);
  }
  return s;
}

static void end_camera(sv_trainer *t) {
  for (int i = 0; i < t->g.n; i++) {
    if (t->n_seen[i] > 2.5f) t->unrest[i] = sv_maxf(t->unrest[i], sqrtf(t->res_dev[i] / t->n_seen[i]));
    t->n_seen[i] = t->res_mean[i] = t->res_dev[i] = 0.0f;
  }
}

sv_status sv_train_find_moving(sv_trainer *t, float progress) {
  if (t->deform.kind == SV_DEFORM_FIELD && t->field_step == 0)
    sv_field_reset(&t->deform.field, &t->g, t->cfg.seed); // the box is that of now
  int n_cameras = 1;
  for (int i = 0; i < t->n_views; i++) n_cameras = sv_maxi(n_cameras, t->views[i].view.i_sub_view + 1);
  for (int i = 0; i < t->g.cap; i++) t->unrest[i] = t->n_seen[i] = t->res_mean[i] = t->res_dev[i] = 0.0f;
  sv_train_begin_members(t);
  for (int c = 0; c < n_cameras; c++) {
    for (int i = 0; i < t->n_views; i++) {
      if (sv_maxi(t->views[i].view.i_sub_view, 0) != c) continue;
      if (!sv_train_has_time(t, t->views[i].view.time, progress)) continue;
      sv_status s = look_at(t, i, progress);
      if (s < 0) return s;
    }
    end_camera(t);
  }
  sv_train_end_members(t);
  for (int i = 0; i < t->g.n; i++) {
    if (t->is_moving[i] || !(t->unrest[i] > t->cfg.dynamic.unrest)) continue;
    t->is_moving[i] = 2; // from now on; what has moved before has to be worth it
    if (t->deform.kind == SV_DEFORM_CLIP) sv_motion_rest(&t->deform.motion, i);
  }
  sv_train_sort_moving(t);
  return SV_OK;
}

// --- the start -----------------------------------------------------------------------------------

void sv_train_start_moving(sv_trainer *t) {
  set_usual_view(t);
  memset(t->is_moving, 0, (size_t)t->g.cap);
  if (sv_train_has_clip(&t->cfg)) t->deform.kind = SV_DEFORM_CLIP;
  if (t->deform.kind == SV_DEFORM_CLIP) sv_motion_reset(&t->deform.motion, 0);
  if (t->cfg.dynamic.kind == SV_DEFORM_FIELD) sv_field_reset(&t->deform.field, &t->g, t->cfg.seed);
  sv_deform_set_moving(&t->deform, 0);
}

void sv_train_copy_motion(sv_trainer *t, int to, int from) {
  const double w = (double)t->cfg.dynamic.window_start;
  t->is_moving[to] = t->is_moving[from];
  if (t->deform.kind != SV_DEFORM_CLIP) return;
  sv_motion_copy(&t->deform.motion, to, from);
  if (!t->is_moving[to] || t->cfg.dynamic.kind != SV_DEFORM_CLIP) return;
  float *c = sv_motion_row(&t->deform.motion, to, SV_MROW_CENTRE), *sharpness = c + 16;
  double half = sv_exp(-0.5 * (double)*sharpness); // where the window takes 1 from the logit
  if (w > 0 && half > w) {
    *c = sv_rng_f(&t->rng);
    *sharpness = (float)sv_log(4.0 / (w * w));
  } else *c = sv_clampf(*c + sv_rng_normal(&t->rng) * sv_minf(0.5f, 0.5f * (float)half), -0.1f, 1.1f);
}
