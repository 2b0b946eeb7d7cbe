// SPDX-License-Identifier: Apache-2.0
// Gauss-Newton: the estimate of the loss's curvature. The photometric loss is a mean of |r| over n
// values, and its curvature is that of weighted squares r^2 / (2 w), w = |r| (iteratively
// reweighted least squares). With the picture's mean for w the Gauss-Newton matrix is J^T J / (n
// w). Every few steps one more backward pass, with random signs of size 1 / sqrt(n w) in the place
// of the gradient, estimates its diagonal by squares, and by products what couples the coordinates
// of each mean (kernels/newton/newton.h). SSIM's share of the loss is taken to have the curvature
// of the rest; smoothing of views, captured or novel, and regularizers do not count. The running
// mean stands where Adam has its second moment.
#include "src/train/curvature.h"

#include <string.h>

#include "src/base/mathx.h"
#include "src/train/appearance.h"
#include "src/train/mask.h"
#include "src/train/optimize.h"
#include "src/train/reach.h"
#include "src/train/supersample.h"

#define BLOCKS_PER_TASK 64
#define ROWS_PER_TASK   16
#define HALF_KEY        3    // of the hash; the channels' probes have 0 to 2
#define MIN_RESIDUAL    1e-4 // display values; below, a picture is as good as its eight bits

bool sv_train_is_probe_due(const sv_trainer *t) {
  const sv_newton_cfg *c = &t->cfg.newton;
  const int every = t->step < (uint32_t)c->first_steps ? c->first_every : c->every;
  return t->cfg.optimizer != SV_OPTIMIZER_ADAM && t->step % (uint32_t)every == 0;
}

typedef struct {
  const sv_trainer *t;
  sv_probe_args probe[3];
  int n_rows, n_bands;
  int n_blocks;
} job;

static void probe_task(void *arg, int i_task, int i_thread) {
  const job *j = arg;
  sv_probe_args a = j->probe[i_task / j->n_bands];
  (void)i_thread;
  a.row0 = i_task % j->n_bands * ROWS_PER_TASK;
  a.row1 = sv_mini(a.row0 + ROWS_PER_TASK, j->n_rows);
  j->t->compute.k->probe(&a);
}

// Of a picture with so many values in the tiles that are looked at.
static void make_probe(const sv_trainer *t, double l1, double n, sv_planes *p) {
  job j = {.t = t, .n_rows = p->height_px, .n_bands = (p->height_px + ROWS_PER_TASK - 1) / ROWS_PER_TASK};
  for (uint32_t c = 0; c < 3; c++)
    j.probe[c] = (sv_probe_args){.plane = p->c[c],
                                 .width_px = p->width_px,
                                 .stride = p->stride,
                                 .size = (float)(1.0 / sqrt(n * (l1 > MIN_RESIDUAL ? l1 : MIN_RESIDUAL))),
                                 .key = sv_hash3((uint32_t)t->cfg.seed, t->step, c)};
  sv_pool_run(t->compute.pool, probe_task, &j, 3 * j.n_bands);
}

static double n_values(const sv_planes *p) { return 3.0 * p->width_px * p->height_px; }

void sv_train_make_probe(const sv_trainer *t, double l1, sv_planes *probe) {
  make_probe(t, l1, n_values(probe), probe);
}

static job blocks_job(sv_trainer *t) {
  return (job){.t = t, .n_rows = sv_train_newton_rows(t), .n_blocks = (t->g.n + 15) / 16};
}

static int n_tasks(const job *j) { return (j->n_blocks + BLOCKS_PER_TASK - 1) / BLOCKS_PER_TASK; }

// A block's gradients of the last picture, in the units of the steps. Returns the touched lanes.
static uint32_t gradients_of(const job *j, int b, int i_thread, float *grad) {
  const sv_trainer *t = j->t;
  uint32_t touched = sv_render_bwd_block(&t->render, b, i_thread, NULL,
                                         &(sv_block_grads){grad, grad + SV_CAP_ROWS * 16, NULL});
  if (t->cfg.is_rolling) sv_train_roll_bwd(t, b, touched, grad, NULL);
  else if (b < t->render.n_moved_blocks && SV_TRAIN_HAS(t, pull_back))
    t->hooks->pull_back(t->hooked, b, touched, grad);
  float factor[16];
  const uint32_t beyond =
      touched ? sv_reach_beyond(t, t->g.param + (size_t)b * (size_t)t->g.n_rows * 16, factor) : 0;
  sv_reach_scale(beyond, factor, grad);
  return touched;
}

// Running means of a block with a new estimate, as in kernels/newton/newton.h.
static void follow(const job *j, int b, uint32_t touched, const float *x, const float *products) {
  const sv_trainer *t = j->t;
  const sv_curvatures c = {t->v + (size_t)b * (size_t)t->g.n_rows * 16, sv_train_cross_at(t, 16 * b)};
  t->compute.k->curvature(t->cfg.newton.keep, j->n_rows, touched, x, products, &c);
}

static void single_task(void *arg, int i_task, int i_thread) {
  const job *j = arg;
  const sv_trainer *t = j->t;
  float *grad = t->block + (size_t)i_thread * SV_TRAIN_BLOCK_FLOATS;
  int b1 = sv_mini((i_task + 1) * BLOCKS_PER_TASK, j->n_blocks);
  for (int b = i_task * BLOCKS_PER_TASK; b < b1; b++) {
    uint32_t touched = gradients_of(j, b, i_thread, grad);
    if (touched) follow(j, b, touched, grad, NULL);
  }
}

// Each tile is looked at with a probability of one half, then with twice the squares: no bias.
static sv_status probe_bwd(sv_trainer *t, const sv_planes *probe, bool is_half) {
  if (!is_half) return sv_render_bwd(&t->render, probe, NULL, NULL, NULL);
  const uint32_t colour = sv_hash3((uint32_t)t->cfg.seed, t->step, HALF_KEY) & 1;
  return sv_render_bwd_half(&t->render, probe, colour);
}

sv_status sv_train_curvature(sv_trainer *t, const sv_train_residual *r, sv_planes *probe) {
  const bool is_half = t->step >= (uint32_t)t->cfg.newton.half_from;
  make_probe(t, r->l1, n_values(probe) * (is_half ? 0.5 : 1.0), probe);
  sv_train_mask_clear(t, r->masked, r->scale, probe);
  if (r->rendered) sv_train_appear_probe(t, r->i_view, r->rendered, r->view, probe);
  sv_status s = probe_bwd(t, r->is_supersampled ? sv_train_spread(t, probe, NULL) : probe, is_half);
  if (s < 0) return s;
  job j = blocks_job(t);
  sv_pool_run(t->compute.pool, single_task, &j, n_tasks(&j));
  return SV_OK;
}

// --- several pictures ----------------------------------------------------------------------------

static float *sum_of(const sv_trainer *t, int b) {
  return t->sum + (size_t)b * (size_t)(t->g.n_rows + SV_TRAIN_SUM_MORE) * 16;
}

// The last three rows.
static float *products_of(const sv_trainer *t, float *sum) { return sum + 16 * (t->g.n_rows + 1); }

static void collect_task(void *arg, int i_task, int i_thread) {
  const job *j = arg;
  const sv_trainer *t = j->t;
  float *grad = t->block + (size_t)i_thread * SV_TRAIN_BLOCK_FLOATS;
  int b1 = sv_mini((i_task + 1) * BLOCKS_PER_TASK, j->n_blocks);
  for (int b = i_task * BLOCKS_PER_TASK; b < b1; b++) {
    uint32_t touched = gradients_of(j, b, i_thread, grad);
    float *sum = sum_of(t, b);
    for (int i = 0; i < 16 * j->n_rows && touched; i++) sum[i] += grad[i] * grad[i];
    float *products = products_of(t, sum);
    for (int k = 0; k < 16 && touched; k++) {
      products[k] += grad[k] * grad[16 + k];
      products[16 + k] += grad[k] * grad[32 + k];
      products[32 + k] += grad[16 + k] * grad[32 + k];
    }
    t->sum_touched[2 * b] |= touched;
  }
}

static void apply_task(void *arg, int i_task, int i_thread) {
  const job *j = arg;
  const sv_trainer *t = j->t;
  int b1 = sv_mini((i_task + 1) * BLOCKS_PER_TASK, j->n_blocks);
  (void)i_thread;
  for (int b = i_task * BLOCKS_PER_TASK; b < b1; b++) {
    uint32_t *touched = t->sum_touched + 2 * b;
    float *sum = sum_of(t, b);
    if (!touched[0]) continue;
    follow(j, b, touched[0], sum, products_of(t, sum));
    memset(sum, 0, (size_t)j->n_rows * 16 * sizeof *sum);
    memset(products_of(t, sum), 0, 3 * 16 * sizeof *sum);
    touched[0] = 0;
  }
}

void sv_train_collect_curvature(sv_trainer *t) {
  job j = blocks_job(t);
  sv_pool_run(t->compute.pool, collect_task, &j, n_tasks(&j));
}

void sv_train_apply_curvature(sv_trainer *t) {
  job j = blocks_job(t);
  sv_pool_run(t->compute.pool, apply_task, &j, n_tasks(&j));
}
