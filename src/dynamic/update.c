// SPDX-License-Identifier: Apache-2.0
// The optimizer's step of per-Gaussian motion and of the bodies' poses, beside that of the
// Gaussians.
#include "src/dynamic/update.h"

#include <math.h>

#include "src/base/mathx.h"
#include "src/dynamic/bodies.h"
#include "src/dynamic/curriculum.h"
#include "src/dynamic/distil.h"
#include "src/train/optimize.h"

// A body's part shrinks faster: the body's pose should explain its motion.
#define PART_SHRINK 3.0f

_Static_assert(SV_FIELD_TASK == SV_TRAIN_TASK_BLOCKS,
               "a field and bodies are summed by the optimizer's tasks");

void sv_dynamic_rates(const sv_dynamic *dyn, float progress, float mean_lr, double bias1,
                      float lr[SV_CAP_MROWS]) {
  const sv_dynamic_cfg *d = &dyn->cfg;
  const sv_motion_cfg *mc = &dyn->deform.motion.cfg;
  // What is not a position follows the means' schedule half as far (in the logarithm).
  float late = sqrtf(mean_lr / (dyn->t->cfg.lr.mean_start * dyn->t->radius)), f = (float)(1.0 / bias1);
  int n_on = sv_dynamic_n_functions(dyn, progress);
  int rot = SV_MROW_FUNCTIONS + 3 * mc->n_pos, colour = rot + 4 * mc->n_rot;
  // What a field is to begin with neither comes and goes nor changes its colour.
  const float window = d->kind == SV_DEFORM_CLIP ? d->lr_window : 0,
              color_rate = d->kind == SV_DEFORM_CLIP ? d->lr_colour : 0;
  int off = SV_MROW_FUNCTIONS + 3 * n_on;
  for (int i = 0; i < dyn->deform.motion.n_rows; i++)
    lr[i] = f * (i < SV_MROW_FUNCTIONS ? window * late
                 : i < off             ? d->lr_pos * mean_lr
                 : i < rot             ? 0.0f
                 : i < colour          ? d->lr_rot * late
                                       : color_rate * late);
}

// A step of length `by` down the length of each touched lane's coefficients c[n][3][16], function
// j's times j + 1: the group lasso's, beside Adam as in AdamW (Loshchilov & Hutter 2019), so that
// it is not normalised away. Parts of bodies (of, or NULL): PART_SHRINK as long.
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

void sv_dynamic_move_block(sv_dynamic *dyn, int block, uint32_t touched, float *grad, float *scratch) {
  const sv_motion_args *a = &dyn->update.args;
  const sv_adam_args *adam = &dyn->update.adam;
  int left = dyn->deform.motion.n_moving - 16 * block;
  if (left < 16) touched &= (1u << left) - 1; // the still ones of the last block stay still
  const sv_motion *mo = &dyn->deform.motion;
  if (mo->bodies.n > 1)
    sv_bodies_carry_bwd(&mo->bodies, mo->moved, mo->n_gaussian_rows, block, touched, grad,
                        dyn->body_sum[block / SV_FIELD_TASK]);
  dyn->t->compute.k->motion_bwd(a, block, touched, grad, scratch);
  size_t at = (size_t)block * (size_t)dyn->deform.motion.n_rows * 16;
  float *p = dyn->deform.motion.param + at;
  dyn->t->compute.k->adam(adam, touched, scratch, p, dyn->deform.motion.m + at, dyn->deform.motion.v + at);
  if (dyn->cfg.shrink_pos > 0 && a->n_pos > 0)
    shrink(p + 16 * SV_MROW_FUNCTIONS, a->n_pos, dyn->cfg.shrink_pos * adam->lr[SV_MROW_FUNCTIONS], touched,
           dyn->deform.motion.bodies.of ? dyn->deform.motion.bodies.of + 16 * block : NULL);
}

void sv_dynamic_begin_update(sv_dynamic *dyn, float progress, const sv_adam_args *adam) {
  const sv_trainer *t = dyn->t;
  const sv_motion *mo = &dyn->deform.motion;
  sv_dynamic_update *u = &dyn->update;
  sv_dynamic_clear_body_sums(dyn);
  if (dyn->deform.kind != SV_DEFORM_CLIP) return;
  const float n = (float)t->g.n, mean_lr = sv_train_mean_lr(&t->cfg, progress) * t->radius;
  const double bias1 = 1.0 - sv_pow(0.9, (double)t->step + 1.0);
  u->f = sv_motion_values_at(&mo->cfg, dyn->time);
  sv_dynamic_rates(dyn, progress, mean_lr, bias1, u->lr);
  u->args = sv_motion_args_of(mo, &t->g, dyn->time, &u->f);
  u->args.reg_pos = dyn->cfg.reg_pos / (n * t->radius);
  u->args.reg_rot = dyn->cfg.reg_rot / n;
  u->args.reg_col = dyn->cfg.reg_colour / n;
  u->adam = *adam;
  u->adam.lr = u->lr;
  u->adam.n_rows = mo->n_rows;
}

void sv_dynamic_update_block(sv_dynamic *dyn, int block, int i_thread, uint32_t touched, float *grad,
                             float *scratch) {
  sv_field *f = &dyn->deform.field;
  if (dyn->deform.kind == SV_DEFORM_FIELD) {
    sv_bodies_carry_bwd(&f->bodies, f->moved, f->n_gaussian_rows, block, touched, grad, NULL);
    sv_field_bwd_block(f, dyn->t->compute.k, block, i_thread, touched, grad);
  } else if (touched) sv_dynamic_move_block(dyn, block, touched, grad, scratch);
}

void sv_dynamic_pull_back(sv_dynamic *dyn, int block, uint32_t touched, float *grad) {
  const sv_motion *mo = &dyn->deform.motion;
  if (dyn->deform.kind == SV_DEFORM_CLIP)
    sv_bodies_carry_bwd(&mo->bodies, mo->moved, mo->n_gaussian_rows, block, touched, grad, NULL);
}

void sv_dynamic_finish_update(sv_dynamic *dyn, float progress) {
  const sv_trainer *t = dyn->t;
  if (dyn->deform.kind == SV_DEFORM_CLIP)
    sv_dynamic_step_bodies(dyn, sv_train_mean_lr(&t->cfg, progress) * t->radius);
  else if (t->render.n_moved_blocks > 0) sv_distil_step_field(dyn, progress);
}
