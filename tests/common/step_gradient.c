// SPDX-License-Identifier: Apache-2.0
#include "tests/common/step_gradient.h"

#include <math.h>
#include <string.h>

#include "tests/common/test.h"

#define N STEP_GRADIENT_GAUSSIANS

// A kernel has no place for its caller's data; one trainer at a time, then.
static const sv_trainer *watched;
static float caught[N][SV_CAP_ROWS];
static int n_rows;

static void keep_gradients(const sv_adam_args *a, uint32_t touched, const float *grad, float *p, uint16_t *m,
                           uint16_t *v) {
  int block_of_16 = (int)((p - watched->g.param) / (16 * watched->g.n_rows));
  (void)m, (void)v;
  n_rows = a->n_rows;
  for (int i = 0; i < a->n_rows; i++)
    for (int k = 0; k < 16; k++)
      if ((touched >> k & 1) && 16 * block_of_16 + k < N) caught[16 * block_of_16 + k][i] = grad[16 * i + k];
}

void step_gradient_kernels(sv_kernels *k) {
  sv_kernels_init(k, ~0u);
  k->adam = keep_gradients;
}

void step_gradient_settings(sv_train_cfg *cfg) {
  cfg->n_gaussians = N;
  cfg->optimizer = SV_OPTIMIZER_ADAM; // whose kernel keeps the gradients
  cfg->reg_opacity = cfg->reg_scale = cfg->noise = 0;
  cfg->relocate_every = 0;
  cfg->start_scale = 1;
  cfg->sh_step = 0;
}

void step_gradient_start(sv_trainer *t, float log_scale, sv_arena *arena) {
  sv_rng rng = sv_rng_make(9, 9);
  sv_arena scratch = sv_arena_sub(arena, 1 << 20);
  sv_init_cfg init = {.kind = SV_INIT_SPHERE, .radius = 1, .opacity = 0.5f, .scale_factor = 1, .seed = 1};
  assert_int_equal(sv_train_start(t, &init, NULL, 0, &scratch), SV_OK);
  for (int i = 0; i < N; i++) {
    sv_gaussian g = {.opacity_logit = -1.5f + 0.5f * sv_rng_normal(&rng)};
    for (int q = 0; q < 4; q++) g.quat_wxyz[q] = sv_rng_normal(&rng);
    for (int q = 0; q < 3; q++) {
      g.mean[q] = sv_rng_f(&rng) - 0.5f;
      g.log_scale[q] = log_scale + 0.2f * sv_rng_normal(&rng);
      g.sh[0][q] = 0.8f * (sv_rng_f(&rng) - 0.4f);
    }
    sv_gaussians_put(&t->g, i, &g);
  }
}

// The loss of the next view or region; the trainer is where it was before.
static double loss_of(sv_trainer *t, const sv_trainer *before) {
  sv_step_stats st;
  t->rng = before->rng;
  t->i_order = before->i_order;
  t->step = before->step;
  memcpy(t->jitter, before->jitter, sizeof t->jitter);
  memset(caught, 0, sizeof caught);
  assert_int_equal(sv_train_step(t, 0.5f, &st), SV_OK);
  return st.loss;
}

static double quotient(sv_trainer *t, const sv_trainer *before, float *p, float h) {
  float kept = *p;
  *p = kept + h;
  double up_at = (double)*p, up = loss_of(t, before);
  *p = kept - h;
  double down_at = (double)*p, down = loss_of(t, before);
  *p = kept;
  return (up - down) / (up_at - down_at);
}

// A quotient that depends on its step straddles a jump: splats end where they fall below 1/255,
// change places in depth, or are clamped at 0.99.
static void compare(sv_trainer *t, const sv_trainer *before, float *p, double is,
                    step_gradient_deviation *d) {
  double expected = quotient(t, before, p, 0.01f), wide = quotient(t, before, p, 0.02f);
  bool is_jump = fabs(expected - wide) > 0.03 * fabs(expected) + 5e-7;
  d->n += expected != 0;
  d->n_jumps += is_jump;
  if (is_jump) return;
  d->diff2 += (is - expected) * (is - expected);
  d->size2 += expected * expected;
}

void step_gradient_check(sv_trainer *t, step_gradient *sum) {
  static float grad[N][SV_CAP_ROWS];
  static sv_trainer before;
  before = *t;
  watched = t;
  (void)loss_of(t, &before);
  memcpy(grad, caught, sizeof grad);
  for (int i = 0; i < N; i++)
    for (int r = 0; r < n_rows; r++)
      compare(t, &before, sv_gaussians_at(&t->g, i, r), (double)grad[i][r],
              r < SV_ROW_SH ? &sum->shape : &sum->colour);
  (void)loss_of(t, &before); // and on to the next
}

void step_gradient_agrees(const step_gradient *g, const char *what, int least_colours, int least_shapes,
                          int shapes_a_jump) {
  const step_gradient_deviation *c = &g->colour, *s = &g->shape;
  double of_colour = sqrt(c->diff2 / c->size2), of_shape = sqrt(s->diff2 / s->size2);
  print_message("%s: %d colours off by %.2g (%d jumps), %d shapes by %.2g (%d jumps)\n", what, c->n,
                of_colour, c->n_jumps, s->n, of_shape, s->n_jumps);
  assert_true(c->n > least_colours && s->n > least_shapes);
  assert_true(c->n_jumps < 20 && s->n_jumps < s->n / shapes_a_jump);
  assert_true(of_colour < 2e-3);
  assert_true(of_shape < 0.015);
}
