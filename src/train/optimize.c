// SPDX-License-Identifier: Apache-2.0
// Gradients of one step to parameters. For each block of 16 Gaussians: projection backward (which
// sums the per-intersection gradients), regularizers, Gauss-Newton or Adam, position noise; the
// gradients never leave the cache. Steps of several images sum their gradients per block first.
#include "src/train/optimize.h"

#include <math.h>
#include <string.h>

#include "src/base/mathx.h"
#include "src/splat/constants.h"
#include "src/train/reach.h"

#define BLOCKS_PER_TASK SV_TRAIN_TASK_BLOCKS
#define ERR_KEEP        0.9f // running mean of the blended error over the views that see a Gaussian

#define KEEP_GRADIENT     0.9f // of its running mean, a step
#define KEEP_GRADIENT_MIN 0.8f // in the shortest runs

#define UNBOOSTED_STEPS 2000.0 // runs of fewer steps learn faster (docs/notes/quality.md)
#define CAP_BOOST       2.5f

typedef struct {
  sv_trainer *t;
  sv_adam_args adam;      // of the rows behind newton.n_rows
  sv_newton_args newton;  // of no rows with Adam alone
  int n_rows;             // of both
  float lr[SV_CAP_ROWS];  // of Adam
  float cap[SV_CAP_ROWS]; // longest Newton steps
  float damping[SV_CAP_ROWS];
  float noise_gain; // displacement in units of sigma^2
  sv_regularisers reg;
  int n_blocks;
  bool has_err; // collect: the error, too
  bool is_error_due;
  bool has_pose; // sum dL/d(twist) of the picture's pose
} job;

bool sv_train_is_error_due(const sv_trainer *t, float progress) {
  if (t->cfg.relocate_every < 1 || progress > t->cfg.relocate_until) return false;
  const uint32_t drawn = sv_hash3((uint32_t)t->cfg.seed, t->step / SV_TRAIN_ERROR_EVERY, 0);
  return t->step % SV_TRAIN_ERROR_EVERY == drawn % SV_TRAIN_ERROR_EVERY;
}

float sv_train_short_run_boost(const sv_train_cfg *c) {
  if (c->has_motion || c->expected_steps < 1) return 1.0f;
  double h = sqrt(UNBOOSTED_STEPS / (double)c->expected_steps);
  return sv_clampf((float)h, 1.0f, CAP_BOOST);
}

float sv_train_mean_lr(const sv_train_cfg *cfg, float progress) {
  double boost = (double)sv_train_short_run_boost(cfg);
  double a = sv_log((double)cfg->lr.mean_start), b = sv_log((double)cfg->lr.mean_end * boost * boost);
  return (float)sv_exp(a + (b - a) * (double)sv_clampf(progress, 0.0f, 1.0f));
}

float sv_train_settling(const sv_train_cfg *c, float progress) {
  if (progress <= c->settle_from || !(c->settle_from < 1.0f)) return 1.0f;
  const float share = sv_minf((progress - c->settle_from) / (1.0f - c->settle_from), 1.0f);
  return 1.0f - (1.0f - c->settle_rate) * share;
}

static void fill_rates(const sv_learning_rates *lr, float mean_lr, float f, float boost, float *out) {
  for (int i = 0; i < SV_CAP_ROWS; i++) {
    float r = i < SV_ROW_QUAT     ? mean_lr
              : i < SV_ROW_SCALE  ? lr->quat
              : i < SV_ROW_LOGIT  ? lr->scale * boost
              : i < SV_ROW_SH     ? lr->logit * boost
              : i < SV_ROW_SH + 3 ? lr->sh0 * boost
                                  : lr->sh_rest;
    out[i] = r * f;
  }
}

static sv_adam_args adam_args(job *j, float mean_lr, float progress, double bias1, double bias2) {
  const float settling = sv_train_settling(&j->t->cfg, progress);
  const float boost = sv_train_short_run_boost(&j->t->cfg);
  fill_rates(&j->t->cfg.lr, mean_lr, settling * (float)(1.0 / bias1), boost, j->lr);
  return (sv_adam_args){.beta1 = KEEP_GRADIENT,
                        .beta2 = 0.999f,
                        .eps = 1e-15f,
                        .rsqrt_bias2 = (float)(1.0 / sqrt(bias2)),
                        .lr = j->lr + j->newton.n_rows,
                        .step = j->t->step,
                        .n_rows = j->n_rows - j->newton.n_rows};
}

static float newton_rate(const sv_train_cfg *c, float progress) {
  double boost = (double)sv_train_short_run_boost(c), more = c->newton.is_boosted ? boost : 1.0;
  double a = sv_log((double)c->newton.rate_start * more);
  double b = sv_log((double)c->newton.rate_end * boost * boost * more);
  return (float)sv_exp(a + ((b < a ? b : a) - a) * (double)sv_clampf(progress, 0.0f, 1.0f));
}

// A mean over many steps follows late, which runs of less than 900 steps feel; in longer ones it is
// less noisy.
static float keep_gradient(const sv_train_cfg *c) {
  const float boost = sv_clampf(sv_train_short_run_boost(c), CAP_BOOST - 1.0f, CAP_BOOST);
  return KEEP_GRADIENT_MIN + (KEEP_GRADIENT - KEEP_GRADIENT_MIN) * (CAP_BOOST - boost);
}

static sv_newton_args newton_args(job *j, float mean_lr, float progress) {
  const sv_newton_cfg *c = &j->t->cfg.newton;
  const float settling = sv_train_settling(&j->t->cfg, progress);
  fill_rates(&j->t->cfg.lr, mean_lr, settling * c->cap, 1.0f, j->cap);
  for (int i = SV_ROW_SCALE; i < SV_ROW_LOGIT; i++) j->cap[i] = settling * c->cap_scale * j->t->cfg.lr.scale;
  for (int i = 0; i < SV_CAP_ROWS; i++)
    j->damping[i] = i < SV_ROW_QUAT                      ? c->damping_mean
                    : i >= SV_ROW_SCALE && i < SV_ROW_SH ? c->damping_size
                                                         : c->damping;
  return (sv_newton_args){.beta1 = keep_gradient(&j->t->cfg),
                          .rate = settling * newton_rate(&j->t->cfg, progress),
                          .damping = j->damping,
                          .cap_mean = settling * c->cap_mean,
                          .cap = j->cap,
                          .n_rows = sv_train_newton_rows(j->t)};
}

int sv_train_n_tasks(const sv_trainer *t) {
  return ((t->g.n + 15) / 16 + BLOCKS_PER_TASK - 1) / BLOCKS_PER_TASK;
}

static int n_tasks(const job *j) { return (j->n_blocks + BLOCKS_PER_TASK - 1) / BLOCKS_PER_TASK; }

// The mean of a Gaussian of opacity 0.076 and more stays where it is: the gate's opening is below
// 1e-3.
#define NOISE_BELOW -2.5f

// Those of a block that are beyond reach (reach.h).
typedef struct {
  uint32_t lanes;
  float factor[16]; // read where `lanes` has one only
} far_lanes;

// Gaussians of a task that get position noise, sixteen at a time: few of a block do.
typedef struct {
  float p[SV_ROW_SH][16], eta[3][16];
  float *mean[16]; // of the model; the rows are 16 floats apart
  int n;
} noise_batch;

static void add_position_noise(const job *j, noise_batch *w) {
  if (w->n == 0) return;
  j->t->compute.k->position_noise(w->p[0], (1u << w->n) - 1, w->eta[0], j->noise_gain, SV_OPACITY_DEAD);
  for (int i = 0; i < w->n; i++)
    for (int a = 0; a < 3; a++) w->mean[i][16 * a] = w->p[SV_ROW_MEAN + a][i];
  w->n = 0;
}

// far: how many reaches a Gaussian is away. Noise is in units of sigma^2, which grows with the
// square of the distance.
static void add_to_noise_batch(const job *j, int block, uint32_t on, float *p, const far_lanes *far,
                               noise_batch *w) {
  for (; on; on &= on - 1) {
    const int k = __builtin_ctz(on), i = w->n;
#pragma GCC unroll 11
    for (int row = 0; row < SV_ROW_SH; row++) w->p[row][i] = p[16 * row + k];
    for (uint32_t a = 0; a < 3; a++)
      w->eta[a][i] =
          sv_hash_normal(sv_hash3((uint32_t)(block * 16 + k), j->t->step, (uint32_t)j->t->cfg.seed * 4u + a));
    for (int a = 0; far->lanes >> k & 1 && a < 3; a++) w->eta[a][i] /= far->factor[k];
    w->mean[i] = p + 16 * SV_ROW_MEAN + k;
    if (++w->n == 16) add_position_noise(j, w);
  }
}

static void clamp_scales(const float *floor, float *log_scale) { // [16], [3][16]
  for (int i = 0; i < 48; i++)
    if (log_scale[i] < floor[i & 15]) log_scale[i] = floor[i & 15];
}

// Adds a block's pose gradient to its task's.
static void add_pose(const job *j, int i_task, const float pose[6]) {
  for (int k = 0; k < 6 && j->has_pose; k++) j->t->poses.sum[i_task][k] += pose[k];
}

static void begin_pose(const job *j, int i_task) {
  for (int k = 0; k < 6 && j->has_pose; k++) j->t->poses.sum[i_task][k] = 0.0f;
}

static float *block_of(const job *j, int i_thread) {
  return j->t->block + (size_t)i_thread * SV_TRAIN_BLOCK_FLOATS;
}

// Always inline: GCC takes a function that only prefetches for one without effects and drops its
// calls.
static inline __attribute__((always_inline)) void prefetch_lines(const void *block, size_t bytes) {
  for (const char *p = block, *end = p + bytes; p < end; p += 256) { // up to three lines more
    __builtin_prefetch(p);
    __builtin_prefetch(p + 64);
    __builtin_prefetch(p + 128);
    __builtin_prefetch(p + 192);
  }
}

// Gradients and blended errors of a block, and the lanes that have them.
typedef struct {
  float *grad;
  const float *err;
  uint32_t touched, has_err;
} block_grads;

// Of Gaussians beyond reach: gradients of means in units of their distance, and the regularization
// of their scales, too.
static void scale_gradients(const job *j, const far_lanes *far, const float *p, float *grad) {
  sv_reach_scale(far->lanes, far->factor, grad);
  for (uint32_t on = far->lanes; on; on &= on - 1) {
    const int k = __builtin_ctz(on);
    for (int row = SV_ROW_SCALE; row < SV_ROW_SCALE + 3; row++)
      grad[16 * row + k] -=
          j->reg.scale * (1.0f - 1.0f / far->factor[k]) * (float)sv_exp((double)p[16 * row + k]);
  }
}

// p: the block, its means after their steps; old [3][16]: before. A Newton step is still not longer
// than the share of the Gaussian's size.
static void scale_steps(const job *j, const far_lanes *far, const float old[48], float *p) {
  const bool is_newton = j->newton.n_rows > 0;
  for (uint32_t on = far->lanes; on; on &= on - 1) {
    const int k = __builtin_ctz(on);
    const float *s = p + 16 * SV_ROW_SCALE + k;
    const float size = (float)sv_exp((double)(s[0] + s[16] + s[32]) / 3);
    const float most = is_newton ? j->newton.cap_mean * size : HUGE_VALF;
    for (int i = k; i < 48; i += 16) p[i] = old[i] + sv_clampf(far->factor[k] * (p[i] - old[i]), -most, most);
  }
}

static void step(const job *j, int b, uint32_t touched, const float *grad) {
  const sv_trainer *t = j->t;
  const size_t at = (size_t)b * (size_t)t->g.n_rows * 16, rest = 16 * (size_t)j->newton.n_rows;
  if (j->newton.n_rows > 0) {
    const sv_curvatures c = {t->v + at, sv_train_cross_at(t, 16 * b)};
    t->compute.k->newton(&j->newton, touched, grad, &c, t->g.param + at, t->m + at);
  }
  if (j->adam.n_rows > 0)
    t->compute.k->adam(&j->adam, touched, grad + rest, t->g.param + at + rest, t->m + at + rest,
                       t->v + at + rest);
}

static void move(const job *j, int b, const block_grads *from, noise_batch *w) {
  sv_trainer *t = j->t;
  float *grad = from->grad, old[48];
  const uint32_t touched = from->touched;
  size_t at = (size_t)b * (size_t)t->g.n_rows * 16;
  float *p = t->g.param + at;
  far_lanes far;
  far.lanes = sv_reach_beyond(t, p, far.factor) & touched;
  if (far.lanes) {
    memcpy(old, p + 16 * SV_ROW_MEAN, sizeof old);
    scale_gradients(j, &far, p, grad);
  }
  step(j, b, touched, grad);
  scale_steps(j, &far, old, p);
  const uint32_t below =
      t->compute.k->blend_errors(j->is_error_due ? from->has_err : 0, ERR_KEEP, from->err,
                                 t->err + 16 * (size_t)b, p + 16 * SV_ROW_LOGIT, NOISE_BELOW);
  if (j->noise_gain > 0.0f) add_to_noise_batch(j, b, below & touched, p, &far, w);
  if (t->floor) clamp_scales(t->floor + 16 * (size_t)b, p + 16 * SV_ROW_SCALE);
}

// How many blocks ahead lines are fetched, in three parts: as many as a block has at once are
// waited for.
#define AHEAD 2

static void optimise_task(void *arg, int i_task, int i_thread) {
  job *j = arg;
  sv_trainer *t = j->t;
  float *grad = block_of(j, i_thread), *err = grad + SV_CAP_ROWS * 16;
  int b0 = i_task * BLOCKS_PER_TASK, b1 = sv_mini(b0 + BLOCKS_PER_TASK, j->n_blocks);
  uint32_t n = 0;
  float pose[6];
  noise_batch w;
  w.n = 0; // the rest is filled before it is read
  const size_t rows = 16 * (size_t)j->n_rows;
  begin_pose(j, i_task);
  for (int b = b0; b < b1; b++) {
    // They have left the near caches since the last step. One after the other: row by row was
    // slower.
    const int next = b + AHEAD < j->n_blocks ? b + AHEAD : b;
    const size_t at = (size_t)next * (size_t)t->g.n_rows * 16;
    // the first and the last splat hold the offsets of the intersections
    __builtin_prefetch(t->render.splat + 16 * next);
    __builtin_prefetch(t->render.splat + 16 * next + 15);
    prefetch_lines(t->g.param + at, rows * sizeof *t->g.param);
    uint32_t touched = sv_render_bwd_block(&t->render, b, i_thread, &j->reg,
                                           &(sv_block_grads){grad, err, j->has_pose ? pose : NULL});
    if (t->cfg.is_rolling) sv_train_roll_bwd(t, b, touched, grad, j->has_pose ? pose : NULL);
    add_pose(j, i_task, pose);
    prefetch_lines(t->m + at, rows * sizeof *t->m);
    if (b < t->render.n_moved_blocks && !t->cfg.is_rolling)
      t->hooks->update_block(t->hooked, b, i_thread, touched, grad, err + 16);
    if (touched) move(j, b, &(block_grads){grad, err, touched, touched}, &w);
    prefetch_lines(t->v + at, rows * sizeof *t->v);
    n += (uint32_t)__builtin_popcount(touched);
  }
  add_position_noise(j, &w);
  t->touched_of[i_task] = n;
}

// --- several pictures ----------------------------------------------------------------------------

static float *sum_of(const sv_trainer *t, int b) {
  return t->sum + (size_t)b * (size_t)(t->g.n_rows + SV_TRAIN_SUM_MORE) * 16;
}

static void collect_task(void *arg, int i_task, int i_thread) {
  job *j = arg;
  sv_trainer *t = j->t;
  float *grad = block_of(j, i_thread), *err = grad + SV_CAP_ROWS * 16;
  int b0 = i_task * BLOCKS_PER_TASK, b1 = sv_mini(b0 + BLOCKS_PER_TASK, j->n_blocks);
  float pose[6];
  begin_pose(j, i_task);
  for (int b = b0; b < b1; b++) {
    uint32_t touched = sv_render_bwd_block(&t->render, b, i_thread, &j->reg,
                                           &(sv_block_grads){grad, err, j->has_pose ? pose : NULL});
    if (t->cfg.is_rolling) sv_train_roll_bwd(t, b, touched, grad, j->has_pose ? pose : NULL);
    add_pose(j, i_task, pose);
    if (!touched) continue;
    float *sum = sum_of(t, b);
    // lanes that were not touched are 0
    for (int i = 0; i < 16 * j->n_rows; i++) sum[i] += grad[i];
    t->sum_touched[2 * b] |= touched;
    if (!j->has_err) continue;
    for (int k = 0; k < 16; k++) sum[16 * t->g.n_rows + k] += err[k];
    t->sum_touched[2 * b + 1] |= touched;
  }
}

static void apply_task(void *arg, int i_task, int i_thread) {
  job *j = arg;
  sv_trainer *t = j->t;
  int b0 = i_task * BLOCKS_PER_TASK, b1 = sv_mini(b0 + BLOCKS_PER_TASK, j->n_blocks);
  uint32_t n = 0;
  noise_batch w;
  w.n = 0; // the rest is filled before it is read
  (void)i_thread;
  for (int b = b0; b < b1; b++) {
    uint32_t *touched = t->sum_touched + 2 * b;
    if (!touched[0]) continue;
    float *sum = sum_of(t, b);
    move(j, b, &(block_grads){sum, sum + 16 * t->g.n_rows, touched[0], touched[1]}, &w);
    n += (uint32_t)__builtin_popcount(touched[0]);
    memset(sum, 0, (size_t)(t->g.n_rows + SV_TRAIN_SUM_MORE) * 16 * sizeof *sum);
    touched[0] = touched[1] = 0;
  }
  add_position_noise(j, &w);
  t->touched_of[i_task] = n;
}

// --- least scales --------------------------------------------------------------------------------

// Adds the sampling rate of one view, pixels per world unit, to those of a block.
static void sample(const sv_view *v, const float *p, float near_z, float rate[16]) {
  for (int i = 0; i < 16; i++) {
    float x[3];
    for (int r = 0; r < 3; r++)
      x[r] = v->r[3 * r] * p[i] + v->r[3 * r + 1] * p[16 + i] + v->r[3 * r + 2] * p[32 + i] + v->t[r];
    float uv[2], depth;
    if (!sv_view_project(v, x, uv, &depth) || !(depth > near_z)) continue;
    const float here = v->fx / depth;
    if (uv[0] >= 0 && uv[0] < (float)v->width_px && uv[1] >= 0 && uv[1] < (float)v->height_px &&
        here > rate[i])
      rate[i] = here;
  }
}

static void floor_task(void *arg, int i_task, int i_thread) {
  const job *j = arg;
  const sv_trainer *t = j->t;
  int b0 = i_task * BLOCKS_PER_TASK, b1 = sv_mini(b0 + BLOCKS_PER_TASK, j->n_blocks);
  float near_z = SV_NEAR_FRACTION * t->radius;
  (void)i_thread;
  for (int b = b0; b < b1; b++) {
    const float *p = t->g.param + (size_t)b * (size_t)t->g.n_rows * 16;
    float rate[16] = {0}, *floor = t->floor + 16 * (size_t)b;
    for (int i = 0; i < t->n_views; i++) sample(&t->views[i].view, p, near_z, rate);
    for (int c = 0; c < t->n_measurements; c++)
      for (int i = 0; i < t->measurements[c].model.n_lenses; i++)
        sample(&t->measurements[c].model.lenses[i].view, p, near_z, rate);
    for (int i = 0; i < 16; i++)
      floor[i] = rate[i] > 0 ? (float)sv_log((double)(t->cfg.min_scale_px / rate[i])) : -1e30f;
  }
}

void sv_train_set_floors(sv_trainer *t) {
  job j = {.t = t, .n_blocks = (t->g.n + 15) / 16};
  if (t->floor) sv_pool_run(t->compute.pool, floor_task, &j, n_tasks(&j));
}

// --- the step's job ------------------------------------------------------------------------------

int sv_train_newton_rows(const sv_trainer *t) {
  const int n = SV_N_ROWS(t->render.project.sh_degree);
  return t->cfg.optimizer == SV_OPTIMIZER_ADAM ? 0 : t->cfg.optimizer == SV_OPTIMIZER_MIXED ? SV_ROW_QUAT : n;
}

sv_regularisers sv_train_regularisers(const sv_trainer *t, float progress, float share) {
  const float opacity = progress < t->cfg.reg_opacity_until ? t->cfg.reg_opacity : 0.0f;
  return (sv_regularisers){.opacity = share * (opacity / (float)t->g.n),
                           .scale = share * (t->cfg.reg_scale / (3.0f * (float)t->g.n * t->radius))};
}

static uint32_t run(sv_trainer *t, float progress, sv_task_fn task) {
  double step = (double)t->step + 1.0;
  float mean_lr = sv_train_mean_lr(&t->cfg, progress);
  bool is_noisy = progress < t->cfg.relocate_until;
  job j = {.t = t,
           .n_blocks = (t->g.n + 15) / 16,
           .n_rows = SV_N_ROWS(t->render.project.sh_degree),
           .reg = sv_train_regularisers(t, progress, 1.0f)};
  j.has_pose = t->cfg.poses.cap_poses > 0 && task == optimise_task;
  j.is_error_due = sv_train_is_error_due(t, progress);
  double bias1 = 1.0 - sv_pow(0.9, step), bias2 = 1.0 - sv_pow(0.999, step);
  j.noise_gain = is_noisy ? t->cfg.noise * 5e5f * mean_lr / t->radius : 0.0f;
  j.newton = newton_args(&j, mean_lr * t->radius, progress);
  j.adam = adam_args(&j, mean_lr * t->radius, progress, bias1, bias2); // motion's, too
  if (SV_TRAIN_HAS(t, begin_update)) t->hooks->begin_update(t->hooked, progress, &j.adam);
  sv_pool_run(t->compute.pool, task, &j, n_tasks(&j));
  uint32_t n = 0;
  for (int i = 0; i < n_tasks(&j); i++) n += t->touched_of[i];
  return n;
}

uint32_t sv_train_optimise(sv_trainer *t, float progress) { return run(t, progress, optimise_task); }

uint32_t sv_train_apply(sv_trainer *t, float progress) { return run(t, progress, apply_task); }

void sv_train_collect(sv_trainer *t, const sv_regularisers *reg, bool has_err) {
  job j = {.t = t, .n_blocks = (t->g.n + 15) / 16, .has_err = has_err};
  if (reg) j.reg = *reg;
  j.has_pose = t->cfg.poses.cap_poses > 0 && has_err;
  j.n_rows = SV_N_ROWS(t->render.project.sh_degree);
  sv_pool_run(t->compute.pool, collect_task, &j, n_tasks(&j));
}
