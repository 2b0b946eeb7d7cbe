// SPDX-License-Identifier: Apache-2.0
#include "src/dynamic/distil.h"

#include <math.h>
#include <string.h>

#include "src/base/mathx.h"

#define BLOCKS_PER_TASK SV_FIELD_TASK // a field sums by these tasks
#define TURN            4             // one block of so many has a turn in a step
#define PRICE_QUAT      36.0f         // squared pixels: a turn by 1 rad of what is a few pixels large
#define PRICE_SCALE     9.0f          // of ln
#define FIT_RATE        4.0f          // the fit's rates at first, of the field's
#define FIT_END         0.05f         // and at its end, of those at first
#define FIT_TURN        25            // steps of the fit in one call
#define FIT_MOST        0.5f          // of the time after the clip, in a run of so many seconds
#define PICTURE_RATE    0.5f          // with pictures, what is there already is not to be lost
#define RESUME          0.8f          // of the Gaussians' schedules: they are in place

double sv_fit_loss(const sv_fit_prices *p, const float *is, const float *want) {
  double sum = 0;
  for (int k = 0; k < 16; k++) {
    double o = 1.0 / (1.0 + sv_exp(-(double)is[16 * SV_ROW_LOGIT + k])), e2 = 0, rest = 0;
    for (int r = 0; r < SV_ROW_LOGIT; r++) {
      double e = (double)is[16 * r + k] - (double)want[16 * r + k];
      if (r < SV_ROW_QUAT) e2 += (double)p->price[SV_ROW_MEAN] * e * e;
      else rest += 0.5 * (double)p->price[r] * e * e;
    }
    sum += o * (sqrt(1.0 + e2) - 1.0 + rest);
  }
  return sum;
}

void sv_fit_loss_bwd(const sv_fit_prices *p, const float *is, const float *want, int n_rows, float *grad) {
  float weight[16], mean[16];
  memset(grad, 0, (size_t)n_rows * 16 * sizeof *grad);
  for (int k = 0; k < 16; k++) {
    float e2 = 0;
    for (int r = 0; r < SV_ROW_QUAT; r++) {
      const float e = is[16 * r + k] - want[16 * r + k];
      e2 += e * e;
    }
    weight[k] = 1.0f / (1.0f + (float)sv_exp(-(double)is[16 * SV_ROW_LOGIT + k]));
    mean[k] = weight[k] / sqrtf(1.0f + p->price[SV_ROW_MEAN] * e2);
  }
  for (int i = 0; i < 16 * SV_ROW_LOGIT; i++)
    grad[i] = p->price[i / 16] * (i < 16 * SV_ROW_QUAT ? mean : weight)[i & 15] * (is[i] - want[i]);
}

// --- the clip's side -----------------------------------------------------------------------------

typedef struct {
  sv_trainer *t;
  sv_motion_values middle;
  sv_fit_prices prices;
  uint32_t step;
  int n_blocks;
} job;

static void less(float *f, const float *middle, int n) {
  for (int i = 0; i < n; i++) f[i] -= middle[i];
}

// The clip's Gaussians of one block at a time of its own, in motion.moved. Functions count from their values at the
// middle time, as what is stored is where things are then.
static void clip_at(const job *j, int b, float time) {
  sv_trainer *t = j->t;
  const sv_motion *mo = &t->deform.motion;
  sv_motion_values f = sv_motion_values_at(&mo->cfg, time);
  less(f.pos, j->middle.pos, mo->cfg.n_pos);
  less(f.rot, j->middle.rot, mo->cfg.n_rot);
  less(f.colour, j->middle.colour, mo->cfg.n_colour);
  sv_motion_args a = sv_motion_args_of(mo, &t->g, time, &f);
  sv_rigid now[SV_CAP_BODIES];
  t->compute.k->motion(&a, b, b + 1);
  if (mo->bodies.n < 2) return;
  sv_bodies_at(&mo->bodies, time, now);
  sv_motion_go_with_bodies(mo, now, 16 * b, sv_mini(16 * b + 16, mo->n_moving));
}

// Pixels per world unit at the scene's centre, in the view that sees it largest.
static float px_per_unit(const sv_trainer *t) {
  float most = 0;
  for (int i = 0; i < t->n_views; i++) {
    const sv_view *v = &t->views[i].view;
    float z = v->t[2];
    for (int k = 0; k < 3; k++) z += v->r[6 + k] * t->centre[k];
    if (z > 0.1f * t->radius && v->fx / z > most) most = v->fx / z;
  }
  return most > 0 ? most : 100.0f / t->radius;
}

static job job_of(sv_trainer *t) {
  job j = {.t = t,
           .middle = sv_motion_values_at(&t->deform.motion.cfg, t->middle),
           .n_blocks = (t->deform.field.n_moving + 15) / 16};
  const float px = px_per_unit(t);
  for (int r = 0; r < SV_ROW_LOGIT; r++)
    j.prices.price[r] = r < SV_ROW_QUAT ? px * px : r < SV_ROW_SCALE ? PRICE_QUAT : PRICE_SCALE;
  return j;
}

// --- a step --------------------------------------------------------------------------------------

static void fit_task(void *arg, int i_task, int i_thread) {
  const job *j = arg;
  sv_trainer *t = j->t;
  sv_field *f = &t->deform.field;
  float *grad = t->block + (size_t)i_thread * SV_TRAIN_BLOCK_FLOATS;
  int b1 = sv_mini((i_task + 1) * BLOCKS_PER_TASK, j->n_blocks);
  for (int b = i_task * BLOCKS_PER_TASK; b < b1; b++) {
    const uint32_t h = sv_hash3((uint32_t)b, j->step, (uint32_t)t->cfg.seed);
    const bool has_turn = h % TURN == 0;
    if (has_turn) {
      const float time = (float)(h >> 8) * (1.0f / 16777216.0f);
      const size_t at = (size_t)b * (size_t)t->g.n_rows * 16;
      clip_at(j, b, time);
      sv_field_at_block(f, t->compute.k, &t->g, b, i_thread, time);
      sv_fit_loss_bwd(&j->prices, f->moved + at, t->deform.motion.moved + at, t->g.n_rows, grad);
    }
    sv_field_bwd_block(f, t->compute.k, b, i_thread, has_turn ? 0xffff : 0, grad);
  }
}

// Step n, from 1, of the field's optimiser, towards the clip.
static void fit_step(job *j, uint32_t n, float progress, float rate) {
  sv_trainer *t = j->t;
  j->step = n;
  sv_pool_run(t->compute.pool, fit_task, j, (j->n_blocks + BLOCKS_PER_TASK - 1) / BLOCKS_PER_TASK);
  sv_field_step(&t->deform.field, &t->compute, n, progress, rate * t->radius);
}

// --- pictures of the clip ------------------------------------------------------------------------

bool sv_train_is_taught(const sv_trainer *t) {
  return t->deform.kind == SV_DEFORM_FIELD && sv_train_has_clip(&t->cfg);
}

float sv_train_time_between(const sv_trainer *t, float time, float share) {
  float next = INFINITY, last = -INFINITY;
  for (int i = 0; i < t->n_views; i++) {
    const float x = t->views[i].view.time;
    if (x > time && x < next) next = x;
    if (x < time && x > last) last = x;
  }
  if (next == INFINITY) next = last;
  return next == -INFINITY ? time : time + share * (next - time);
}

float sv_train_lesson_time(sv_trainer *t, float time) {
  if (!sv_train_is_taught(t) || sv_rng_f(&t->rng) >= t->cfg.dynamic.taught) return time;
  return sv_train_time_between(t, time, 0.25f + 0.5f * sv_rng_f(&t->rng));
}

sv_status sv_train_load_lesson(sv_trainer *t, const sv_view *view, const sv_render_options *o) {
  sv_motion_at(&t->deform.motion, &t->compute, &t->teacher, view->time);
  sv_status s = sv_render(&t->render, &t->teacher, view, o);
  if (s < 0) return s;
  sv_train_size_target(t, view->width_px, view->height_px);
  const size_t n = (size_t)t->target.stride * (size_t)t->target.rows_padded;
  for (int c = 0; c < 3; c++) memcpy(t->target.c[c], t->render.rgb.c[c], n * sizeof(float));
  return SV_OK;
}

// --- the hand-over -------------------------------------------------------------------------------

float sv_train_stage_progress(const sv_trainer *t, float progress) {
  const sv_dynamic_cfg *d = &t->cfg.dynamic;
  if (d->kind != SV_DEFORM_FIELD || !sv_train_has_clip(&t->cfg)) return progress;
  if (t->deform.kind == SV_DEFORM_CLIP) return progress / d->clip;
  return RESUME + (1.0f - RESUME) * (progress - d->clip) / (1.0f - d->clip);
}

static int n_fit_steps(const sv_train_cfg *c) {
  return sv_maxi(1, (int)(c->dynamic.fit * (float)c->steps_hint));
}

void sv_train_step_field(sv_trainer *t, float progress) {
  const bool is_taught = sv_train_is_taught(t);
  const float from = is_taught ? RESUME : t->cfg.dynamic.from, rate = is_taught ? PICTURE_RATE : 1.0f;
  const float stage = (progress - from) / (1.0f - from);
  sv_field_step(&t->deform.field, &t->compute, ++t->field_step, stage, rate * t->radius);
}

void sv_train_hand_over(sv_trainer *t) {
  const sv_motion *mo = &t->deform.motion;
  sv_field *f = &t->deform.field;
  const size_t n = (size_t)((mo->n_moving + 15) / 16) * 16 * (size_t)t->g.n_rows;
  memcpy(t->teacher.param, t->g.param, (size_t)t->g.cap * (size_t)t->g.n_rows * sizeof *t->g.param);
  sv_train_set_time(t, t->middle);
  memcpy(t->g.param, mo->moved, n * sizeof *t->g.param);
  memset(t->m, 0, n * sizeof *t->m); // of places that were others
  sv_gaussians moving = t->g;
  if (mo->n_moving > 0) moving.n = mo->n_moving; // the box is theirs
  sv_field_reset(f, &moving, t->cfg.seed);
  f->n_moving = mo->n_moving;
  t->deform.kind = SV_DEFORM_FIELD, t->field_step = 0;
  t->fit_left = mo->n_moving > 0 ? (uint32_t)n_fit_steps(&t->cfg) : 0;
}

void sv_train_fit(sv_trainer *t, float progress) {
  const float clip = t->cfg.dynamic.clip;
  sv_field *f = &t->deform.field;
  job j = job_of(t);
  const int n_steps = n_fit_steps(&t->cfg);
  if (t->fit_left > (uint32_t)n_steps) t->fit_left = (uint32_t)n_steps; // of a checkpoint of a longer run
  for (int k = 0; k < FIT_TURN && t->fit_left > 0; k++) {
    const int i = n_steps - (int)--t->fit_left;
    const double x = (double)i / (double)n_steps;
    fit_step(&j, (uint32_t)i, 0.0f, FIT_RATE * (float)sv_pow((double)FIT_END, x));
  }
  if (progress > clip + FIT_MOST * (1.0f - clip)) t->fit_left = 0;
  if (t->fit_left > 0) return;
  memset(f->m, 0, f->n_param * sizeof *f->m); // of another loss
  memset(f->v, 0, f->n_param * sizeof *f->v);
  sv_train_set_time(t, t->middle);
}
