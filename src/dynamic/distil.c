// SPDX-License-Identifier: Apache-2.0
#include "src/dynamic/distil.h"

#include <math.h>
#include <string.h>

#include "src/base/mathx.h"
#include "src/train/optimize.h"
#include "src/train/step.h"

#define BLOCKS_PER_TASK SV_FIELD_TASK // a field sums by these tasks
#define TURN            4             // one block of so many has a turn in a step
// squared pixels: a turn by 1 rad of what is a few pixels large
#define WEIGHT_QUAT  36.0f
#define WEIGHT_SCALE 9.0f  // of ln
#define FIT_RATE     4.0f  // the fit's rates at first, of the field's
#define FIT_END      0.05f // and at its end, of those at first
#define FIT_TURN     25    // steps of the fit in one call
#define FIT_MOST     0.5f  // of the time after the clip, in a run of so many seconds
#define PICTURE_RATE 0.5f  // lower when images follow, to keep the fit
#define RESUME       0.8f  // of the Gaussians' schedules: they are in place

double sv_fit_loss(const sv_fit_weights *p, const float *is, const float *want) {
  double sum = 0;
  for (int k = 0; k < 16; k++) {
    double o = 1.0 / (1.0 + sv_exp(-(double)is[16 * SV_ROW_LOGIT + k])), e2 = 0, rest = 0;
    for (int r = 0; r < SV_ROW_LOGIT; r++) {
      double e = (double)is[16 * r + k] - (double)want[16 * r + k];
      if (r < SV_ROW_QUAT) e2 += (double)p->row[SV_ROW_MEAN] * e * e;
      else rest += 0.5 * (double)p->row[r] * e * e;
    }
    sum += o * (sqrt(1.0 + e2) - 1.0 + rest);
  }
  return sum;
}

void sv_fit_loss_bwd(const sv_fit_weights *p, const float *is, const float *want, int n_rows, float *grad) {
  float weight[16], mean[16];
  memset(grad, 0, (size_t)n_rows * 16 * sizeof *grad);
  for (int k = 0; k < 16; k++) {
    float e2 = 0;
    for (int r = 0; r < SV_ROW_QUAT; r++) {
      const float e = is[16 * r + k] - want[16 * r + k];
      e2 += e * e;
    }
    weight[k] = 1.0f / (1.0f + (float)sv_exp(-(double)is[16 * SV_ROW_LOGIT + k]));
    mean[k] = weight[k] / sqrtf(1.0f + p->row[SV_ROW_MEAN] * e2);
  }
  for (int i = 0; i < 16 * SV_ROW_LOGIT; i++)
    grad[i] = p->row[i / 16] * (i < 16 * SV_ROW_QUAT ? mean : weight)[i & 15] * (is[i] - want[i]);
}

// --- the clip's side -----------------------------------------------------------------------------

typedef struct {
  sv_dynamic *dyn;
  sv_motion_values middle;
  sv_fit_weights weights;
  uint32_t step;
  int n_blocks;
} job;

static void less(float *f, const float *middle, int n) {
  for (int i = 0; i < n; i++) f[i] -= middle[i];
}

// The clip's Gaussians of one block at a time of its own, in motion.moved, those of bodies in the
// body's frame, as a field deforms them. Functions count from their values at the middle time, as
// what is stored is where things are then.
static void clip_at(const job *j, int b, float time) {
  sv_dynamic *dyn = j->dyn;
  const sv_motion *mo = &dyn->deform.motion;
  sv_motion_values f = sv_motion_values_at(&mo->cfg, time);
  less(f.pos, j->middle.pos, mo->cfg.n_pos);
  less(f.rot, j->middle.rot, mo->cfg.n_rot);
  less(f.colour, j->middle.colour, mo->cfg.n_colour);
  sv_motion_args a = sv_motion_args_of(mo, &dyn->t->g, time, &f);
  dyn->t->compute.k->motion(&a, b, b + 1);
}

// Pixels per world unit at the scene's centre, in the view that sees it largest.
static float px_per_unit(const sv_dynamic *dyn) {
  float most = 0;
  for (int i = 0; i < dyn->t->n_views; i++) {
    const sv_view *v = &dyn->t->views[i].view;
    float z = v->t[2];
    for (int k = 0; k < 3; k++) z += v->r[6 + k] * dyn->t->centre[k];
    if (v->fisheye) z = sv_view_distance(v, dyn->t->centre);
    if (z > 0.1f * dyn->t->radius && v->fx / z > most) most = v->fx / z;
  }
  return most > 0 ? most : 100.0f / dyn->t->radius;
}

static job job_of(sv_dynamic *dyn) {
  job j = {.dyn = dyn,
           .middle = sv_motion_values_at(&dyn->deform.motion.cfg, dyn->t->reference_time),
           .n_blocks = (dyn->deform.field.n_moving + 15) / 16};
  const float px = px_per_unit(dyn);
  for (int r = 0; r < SV_ROW_LOGIT; r++)
    j.weights.row[r] = r < SV_ROW_QUAT ? px * px : r < SV_ROW_SCALE ? WEIGHT_QUAT : WEIGHT_SCALE;
  return j;
}

// --- a step --------------------------------------------------------------------------------------

static void fit_task(void *arg, int i_task, int i_thread) {
  const job *j = arg;
  sv_dynamic *dyn = j->dyn;
  sv_field *f = &dyn->deform.field;
  float *grad = dyn->t->block + (size_t)i_thread * SV_TRAIN_BLOCK_FLOATS;
  int b1 = sv_mini((i_task + 1) * BLOCKS_PER_TASK, j->n_blocks);
  for (int b = i_task * BLOCKS_PER_TASK; b < b1; b++) {
    const uint32_t h = sv_hash3((uint32_t)b, j->step, (uint32_t)dyn->t->cfg.seed);
    const bool has_turn = h % TURN == 0;
    if (has_turn) {
      const float time = (float)(h >> 8) * (1.0f / 16777216.0f);
      const size_t at = (size_t)b * (size_t)dyn->t->g.n_rows * 16;
      clip_at(j, b, time);
      sv_field_at_block(f, dyn->t->compute.k, &dyn->t->g, b, i_thread, time);
      sv_fit_loss_bwd(&j->weights, f->moved + at, dyn->deform.motion.moved + at, dyn->t->g.n_rows, grad);
    }
    sv_field_bwd_block(f, dyn->t->compute.k, b, i_thread, has_turn ? 0xffff : 0, grad);
  }
}

// Step n, from 1, of the field's optimiser, towards the clip.
static void fit_step(job *j, uint32_t n, float progress, float rate) {
  sv_dynamic *dyn = j->dyn;
  j->step = n;
  sv_pool_run(dyn->t->compute.pool, fit_task, j, (j->n_blocks + BLOCKS_PER_TASK - 1) / BLOCKS_PER_TASK);
  sv_field_step(&dyn->deform.field, &dyn->t->compute, n, progress, rate * dyn->t->radius);
}

// --- pictures of the clip ------------------------------------------------------------------------

bool sv_distil_is_on(const sv_dynamic *dyn) {
  return dyn->deform.kind == SV_DEFORM_FIELD && sv_dynamic_has_clip(&dyn->cfg);
}

float sv_distil_time_between(const sv_dynamic *dyn, float time, float share) {
  float next = INFINITY, last = -INFINITY;
  for (int i = 0; i < dyn->t->n_views; i++) {
    const float x = dyn->t->views[i].view.time;
    if (x > time && x < next) next = x;
    if (x < time && x > last) last = x;
  }
  if (next == INFINITY) next = last;
  return next == -INFINITY ? time : time + share * (next - time);
}

float sv_distil_time(sv_dynamic *dyn, float time) {
  if (!sv_distil_is_on(dyn) || sv_rng_f(&dyn->t->rng) >= dyn->cfg.distilled) return time;
  return sv_distil_time_between(dyn, time, 0.25f + 0.5f * sv_rng_f(&dyn->t->rng));
}

sv_status sv_distil_load_target(sv_dynamic *dyn, const sv_view *view, const sv_render_options *o) {
  sv_motion_at(&dyn->deform.motion, &dyn->t->compute, &dyn->distilled, view->time);
  sv_render_options whole = *o;
  whole.dropout = 0.0f; // of what is learnt from
  sv_status s = sv_render(&dyn->t->render, &dyn->distilled, view, &whole);
  if (s < 0) return s;
  sv_train_size_images(dyn->t, view->width_px, view->height_px);
  const size_t n = (size_t)dyn->t->target.stride * (size_t)dyn->t->target.rows_padded;
  for (int c = 0; c < 3; c++) memcpy(dyn->t->target.c[c], dyn->t->render.rgb.c[c], n * sizeof(float));
  return SV_OK;
}

// --- the hand-over -------------------------------------------------------------------------------

float sv_distil_stage_progress(const sv_dynamic *dyn, float progress) {
  const sv_dynamic_cfg *d = &dyn->cfg;
  if (d->kind != SV_DEFORM_FIELD || !sv_dynamic_has_clip(&dyn->cfg)) return progress;
  if (dyn->deform.kind == SV_DEFORM_CLIP) return progress / d->distil_at;
  return RESUME + (1.0f - RESUME) * (progress - d->distil_at) / (1.0f - d->distil_at);
}

static int n_fit_steps(const sv_dynamic *dyn) {
  return sv_maxi(1, (int)(dyn->cfg.fit * (float)dyn->t->cfg.expected_steps));
}

void sv_distil_step_field(sv_dynamic *dyn, float progress) {
  const bool is_taught = sv_distil_is_on(dyn);
  const float from = is_taught ? RESUME : dyn->cfg.from, rate = is_taught ? PICTURE_RATE : 1.0f;
  const float stage = (progress - from) / (1.0f - from);
  sv_field_step(&dyn->deform.field, &dyn->t->compute, ++dyn->field_step, stage, rate * dyn->t->radius);
}

void sv_distil_begin(sv_dynamic *dyn) {
  sv_motion *mo = &dyn->deform.motion;
  sv_field *f = &dyn->deform.field;
  const size_t n = (size_t)((mo->n_moving + 15) / 16) * 16 * (size_t)dyn->t->g.n_rows;
  memcpy(dyn->distilled.param, dyn->t->g.param,
         (size_t)dyn->t->g.cap * (size_t)dyn->t->g.n_rows * sizeof *dyn->t->g.param);
  sv_motion_local_at(mo, &dyn->t->compute, &dyn->t->g, dyn->t->reference_time);
  memcpy(dyn->t->g.param, mo->moved, n * sizeof *dyn->t->g.param);
  memset(dyn->t->m, 0, n * sizeof *dyn->t->m); // of places that were others
  sv_gaussians moving = dyn->t->g;
  if (mo->n_moving > 0) moving.n = mo->n_moving; // the box is theirs
  sv_field_reset(f, &moving, dyn->t->cfg.seed);
  sv_bodies_copy(&f->bodies, &mo->bodies, mo->n_moving, f->cap);
  f->n_moving = mo->n_moving;
  dyn->deform.kind = SV_DEFORM_FIELD;
  dyn->field_step = 0;
  dyn->fit_steps_left = mo->n_moving > 0 ? (uint32_t)n_fit_steps(dyn) : 0;
}

void sv_distil_fit(sv_dynamic *dyn, float progress) {
  const float clip = dyn->cfg.distil_at;
  sv_field *f = &dyn->deform.field;
  job j = job_of(dyn);
  const int n_steps = n_fit_steps(dyn);
  if (dyn->fit_steps_left > (uint32_t)n_steps)
    dyn->fit_steps_left = (uint32_t)n_steps; // of a checkpoint of a longer run
  for (int k = 0; k < FIT_TURN && dyn->fit_steps_left > 0; k++) {
    const int i = n_steps - (int)--dyn->fit_steps_left;
    const double x = (double)i / (double)n_steps;
    fit_step(&j, (uint32_t)i, 0.0f, FIT_RATE * (float)sv_pow((double)FIT_END, x));
  }
  if (progress > clip + FIT_MOST * (1.0f - clip)) dyn->fit_steps_left = 0;
  if (dyn->fit_steps_left > 0) return;
  memset(f->m, 0, f->n_param * sizeof *f->m); // of another loss
  memset(f->v, 0, f->n_param * sizeof *f->v);
  sv_train_set_time(dyn->t, dyn->t->reference_time);
}
