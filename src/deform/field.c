// SPDX-License-Identifier: Apache-2.0
#include "src/deform/field.h"

#include <math.h>
#include <string.h>

#include "src/base/mathx.h"
#include "src/base/str.h"

#define BLOCKS_PER_TASK 16
#define CAP_BASE        512
#define CAP_TIMES       1024

static const int axes[SV_FIELD_PLANES][2] = {{0, 1}, {0, 2}, {0, 3}, {1, 2}, {1, 3}, {2, 3}};

bool sv_field_preset(const char *name, sv_field_cfg *cfg) {
  static const struct {
    const char *name;
    int channels, levels, base, n_times, width;
    bool is_shared, has_colour;
    float tv, smooth;
  } all[] = {{"tiny", 16, 1, 32, 32, 32, true, false, 1e-4f, 0.01f},
             {"small", 16, 1, 48, 48, 64, true, false, 1e-4f, 0.01f},
             {"medium", 16, 2, 48, 48, 64, true, false, 1e-4f, 0.01f},
             {"dnerf", 32, 2, 64, 100, 64, false, false, 1e-4f, 0.01f},
             {"dynerf", 16, 2, 64, 150, 128, false, true, 2e-4f, 0.001f},
             {"hypernerf", 16, 3, 64, 150, 128, false, false, 2e-4f, 0.001f},
             {"dycheck", 16, 3, 64, 150, 128, false, false, 2e-4f, 0.001f},
             {"multiview", 16, 2, 64, 150, 128, false, true, 2e-4f, 0.001f}};
  for (size_t i = 0; i < sizeof all / sizeof *all; i++) {
    if (!sv_str_eq(name, all[i].name)) continue;
    *cfg = (sv_field_cfg){.n_channels = all[i].channels,
                          .n_levels = all[i].levels,
                          .mult = {1, 2, 4},
                          .base = all[i].base,
                          .n_times = all[i].n_times,
                          .width = all[i].width,
                          .is_shared = all[i].is_shared,
                          .has_colour = all[i].has_colour,
                          .start = all[i].is_shared ? 0.1f : 1.0f,
                          .tv = all[i].tv,
                          .smooth = all[i].smooth,
                          .l1_time = 1e-4f,
                          .lr_planes =
                              // for thousands of steps instead of 20,000
                          all[i].is_shared ? 1e-2f : 1.6e-3f,
                          .lr_planes_end = all[i].is_shared ? 1e-3f : 1.6e-4f,
                          .lr_layers = all[i].is_shared ? 1e-3f : 1.6e-4f,
                          .lr_layers_end = all[i].is_shared ? 1e-4f : 1.6e-5f};
    return true;
  }
  return false;
}

// --- layout --------------------------------------------------------------------------------------

static int res_of(const sv_field_cfg *c, int level, int axis) {
  return axis == 3 ? c->n_times : c->base * c->mult[level];
}

static size_t take(size_t *at, size_t n) {
  size_t was = *at;
  *at += (n + 15) / 16 * 16;
  return was;
}

static void add_head(sv_field *f, int row, int n, size_t *at) {
  size_t w = (size_t)f->cfg.width;
  sv_field_head *h = &f->head[f->n_heads++];
  h->row = row;
  h->n = n;
  h->w1 = take(at, w * w);
  h->b1 = take(at, w);
  h->w2 = take(at, w * (size_t)n);
  h->b2 = take(at, (size_t)n);
}

static void lay_out(sv_field *f) {
  const sv_field_cfg *c = &f->cfg;
  size_t at = 0;
  for (int l = 0; l < c->n_levels; l++)
    for (int p = 0; p < SV_FIELD_PLANES; p++) {
      f->plane_n[l][p] =
          (size_t)res_of(c, l, axes[p][0]) * (size_t)res_of(c, l, axes[p][1]) * (size_t)c->n_channels;
      f->plane_at[l][p] = take(&at, f->plane_n[l][p]);
    }
  f->n_planes = at;
  f->n_feature = c->n_levels * c->n_channels;
  f->trunk_w = take(&at, (size_t)f->n_feature * (size_t)c->width);
  f->trunk_b = take(&at, (size_t)c->width);
  if (c->is_shared) add_head(f, SV_ROW_MEAN, SV_ROW_LOGIT, &at);
  else {
    add_head(f, SV_ROW_MEAN, 3, &at);
    add_head(f, SV_ROW_SCALE, 3, &at);
    add_head(f, SV_ROW_QUAT, 4, &at);
    if (c->has_colour) add_head(f, SV_ROW_LOGIT, 1, &at);
    if (c->has_colour) add_head(f, SV_ROW_SH, f->n_gaussian_rows - SV_ROW_SH, &at);
  }
  f->n_param = at;
}

sv_status sv_field_check(const sv_field_cfg *c, sv_err *err) {
  if (c->base < 2 || c->base > CAP_BASE || c->n_times < 2 || c->n_times > CAP_TIMES || c->n_levels < 1 ||
      c->n_levels > SV_FIELD_CAP_LEVELS)
    return sv_fail(
        err, SV_E_ARG,
        "a field of %d levels, the first of %d points a side, and %d along time; expected 1 to %d, "
        "2 to %d, 2 to %d",
        c->n_levels, c->base, c->n_times, SV_FIELD_CAP_LEVELS, CAP_BASE, CAP_TIMES);
  if ((c->n_channels != 16 && c->n_channels != 32) || c->width < 16 || c->width > SV_FIELD_CAP_WIDTH ||
      c->width % 16)
    return sv_fail(
        err, SV_E_ARG,
        "a field of %d channels and layers of %d; expected 16 or 32, and a multiple of 16 up to %d",
        c->n_channels, c->width, SV_FIELD_CAP_WIDTH);
  return SV_OK;
}

sv_status sv_field_init(sv_field *f, const sv_field_cfg *cfg, const sv_gaussians *g, sv_arena *a) {
  sv_status s = sv_field_check(cfg, NULL);
  if (s < 0) return s;
  memset(f, 0, sizeof *f);
  f->cfg = *cfg;
  f->cap = g->cap;
  f->n_gaussian_rows = g->n_rows;
  lay_out(f);
  size_t n_blocks = (size_t)g->cap / 16;
  f->n_scratch = 16 * (5 * (size_t)cfg->width + (size_t)f->n_feature + SV_CAP_ROWS);
  f->param = SV_TAKE(a, float, f->n_param);
  f->moved = SV_TAKE(a, float, (size_t)g->cap *(size_t)g->n_rows);
  f->coord = SV_TAKE(a, float, n_blocks * 64);
  f->feature = SV_TAKE(a, float, n_blocks * 16 * (size_t)f->n_feature);
  f->scratch = SV_TAKE(a, float, (size_t)cfg->n_threads * f->n_scratch);
  if ((s = sv_bodies_init(&f->bodies, g->cap, cfg->cap_knots, false, a)) < 0) return s;
  if (!cfg->has_grad) return a->status < 0 ? a->status : SV_OK;
  f->m = SV_TAKE(a, uint16_t, f->n_param);
  f->v = SV_TAKE(a, uint16_t, f->n_param);
  f->grad = SV_TAKE(a, float, f->n_planes);
  f->layers = SV_TAKE(a, float, (n_blocks / SV_FIELD_TASK + 1) * (f->n_param - f->n_planes));
  f->part = SV_TAKE(a, float, n_blocks * 96 * (size_t)f->n_feature);
  f->touched = SV_TAKE(a, uint32_t, n_blocks);
  return a->status < 0 ? a->status : SV_OK;
}

static void fill_uniform(sv_rng *rng, float *p, size_t n, float lo, float hi) {
  for (size_t i = 0; i < n; i++) p[i] = lo + (hi - lo) * sv_rng_f(rng);
}

// A linear layer: where its weights and biases begin in the parameters, and its size.
typedef struct {
  size_t w, b;
  int n_in, n_out;
} layer;

static layer trunk_layer(const sv_field *f) {
  return (layer){f->trunk_w, f->trunk_b, f->n_feature, f->cfg.width};
}
static layer head1_layer(const sv_field *f, int h) {
  return (layer){f->head[h].w1, f->head[h].b1, f->cfg.width, f->cfg.width};
}
static layer head2_layer(const sv_field *f, int h) {
  return (layer){f->head[h].w2, f->head[h].b2, f->cfg.width, f->head[h].n};
}

static void fill_layer(sv_field *f, sv_rng *rng, layer l, float share) {
  float xavier = share * (float)sqrt(6.0 / (l.n_in + l.n_out)), bias = share * (float)sqrt(1.0 / l.n_in);
  fill_uniform(rng, f->param + l.w, (size_t)l.n_in * (size_t)l.n_out, -xavier, xavier);
  fill_uniform(rng, f->param + l.b, (size_t)l.n_out, -bias, bias);
}

static void set_box(sv_field *f, const sv_gaussians *g) {
  for (int k = 0; k < 3; k++) {
    double mean = 0, var = 0;
    for (int i = 0; i < g->n; i++) mean += (double)*sv_gaussians_at(g, i, k) / g->n;
    for (int i = 0; i < g->n; i++) {
      double d = (double)*sv_gaussians_at(g, i, k) - mean;
      var += d * d / g->n;
    }
    double half = 3.0 * sqrt(var) + 1e-6;
    f->lo[k] = (float)(mean - half);
    f->inv[k] = (float)(0.5 / half);
  }
}

void sv_field_reset(sv_field *f, const sv_gaussians *g, uint64_t seed) {
  sv_rng rng = sv_rng_make(seed, 17);
  memset(f->param, 0, f->n_param * sizeof *f->param);
  for (int l = 0; l < f->cfg.n_levels; l++)
    for (int p = 0; p < SV_FIELD_PLANES; p++) {
      bool is_time = axes[p][1] == 3;
      fill_uniform(&rng, f->param + f->plane_at[l][p], f->plane_n[l][p], is_time ? 1.0f : 0.1f,
                   is_time ? 1.0f : 0.5f);
    }
  fill_layer(f, &rng, trunk_layer(f), 1.0f);
  for (int h = 0; h < f->n_heads; h++) {
    fill_layer(f, &rng, head1_layer(f, h), 1.0f);
    fill_layer(f, &rng, head2_layer(f, h), f->cfg.start);
  }
  set_box(f, g);
  sv_bodies_reset(&f->bodies, f->cap);
  if (!f->m) return;
  memset(f->m, 0, f->n_param * sizeof *f->m);
  memset(f->v, 0, f->n_param * sizeof *f->v);
}

// --- forward -------------------------------------------------------------------------------------

static sv_planes_args planes_of(const sv_field *f) {
  sv_planes_args a = {.n_vec = f->cfg.n_channels / 16, .n_levels = f->cfg.n_levels};
  for (int l = 0; l < a.n_levels; l++) {
    for (int i = 0; i < 4; i++) a.res[l][i] = res_of(&f->cfg, l, i);
    for (int p = 0; p < SV_FIELD_PLANES; p++) a.plane[l][p] = f->param + f->plane_at[l][p];
  }
  return a;
}

static sv_linear_args linear(const sv_field *f, layer l, bool is_relu) {
  return (sv_linear_args){f->param + l.w, f->param + l.b, l.n_in, l.n_out, is_relu};
}
static sv_linear_args trunk(const sv_field *f) { return linear(f, trunk_layer(f), false); }
static sv_linear_args head1(const sv_field *f, int h) { return linear(f, head1_layer(f, h), true); }
static sv_linear_args head2(const sv_field *f, int h) { return linear(f, head2_layer(f, h), true); }

typedef struct {
  float *d_feature, *h, *h2, *dh, *dh2, *dh_one, *out;
} work;

static work work_of(const sv_field *f, int i_thread) {
  float *s = f->scratch + (size_t)i_thread * f->n_scratch;
  size_t w = 16 * (size_t)f->cfg.width, n = 16 * (size_t)f->n_feature;
  return (work){.d_feature = s,
                .h = s + n,
                .h2 = s + n + w,
                .dh = s + n + 2 * w,
                .dh2 = s + n + 3 * w,
                .dh_one = s + n + 4 * w,
                .out = s + n + 5 * w};
}

static float *feature_of(const sv_field *f, int block) {
  return f->feature + (size_t)block * 16 * (size_t)f->n_feature;
}

typedef struct {
  sv_field *f;
  const sv_kernels *k;
  const sv_gaussians *g;
  sv_planes_args planes;
  float t;
  int n_blocks;
} job;

static void at_block(const job *j, int b, const work *w) {
  sv_field *f = j->f;
  const float *p = j->g->param + (size_t)b * (size_t)f->n_gaussian_rows * 16;
  float *c = f->coord + 64 * (size_t)b, *moved = f->moved + (size_t)b * (size_t)f->n_gaussian_rows * 16;
  for (int i = 0; i < 3; i++)
    for (int k = 0; k < 16; k++) c[16 * i + k] = (p[16 * i + k] - f->lo[i]) * f->inv[i];
  for (int k = 0; k < 16; k++) c[48 + k] = j->t;
  memcpy(moved, p, (size_t)f->n_gaussian_rows * 16 * sizeof *moved);
  sv_linear_args a = trunk(f);
  j->k->planes(&j->planes, c, feature_of(f, b));
  j->k->linear(&a, feature_of(f, b), w->h);
  int left = f->n_moving - 16 * b; // the still ones of the last block stay where they are
  for (int h = 0; h < f->n_heads; h++) {
    a = head1(f, h);
    j->k->linear(&a, w->h, w->h2);
    a = head2(f, h);
    j->k->linear(&a, w->h2, w->out);
    for (int i = 0; i < 16 * f->head[h].n; i++)
      if ((i & 15) < left) moved[16 * f->head[h].row + i] += w->out[i];
  }
}

static void at_task(void *arg, int i_task, int i_thread) {
  const job *j = arg;
  work w = work_of(j->f, i_thread);
  int b1 = sv_mini((i_task + 1) * BLOCKS_PER_TASK, j->n_blocks);
  for (int b = i_task * BLOCKS_PER_TASK; b < b1; b++) at_block(j, b, &w);
  const sv_field *f = j->f;
  if (f->bodies.n > 1)
    sv_bodies_carry(&f->bodies, f->bodies.now, f->moved, f->n_gaussian_rows, 16 * i_task * BLOCKS_PER_TASK,
                    sv_mini(16 * b1, f->n_moving));
}

void sv_field_at(sv_field *f, const sv_compute *c, sv_gaussians *g, float t) {
  job j = {.f = f, .k = c->k, .g = g, .planes = planes_of(f), .t = t, .n_blocks = (f->n_moving + 15) / 16};
  if (f->bodies.n > 1) sv_bodies_at(&f->bodies, t, f->bodies.now);
  sv_pool_run(c->pool, at_task, &j, (j.n_blocks + BLOCKS_PER_TASK - 1) / BLOCKS_PER_TASK);
  g->moved = f->moved;
  g->n_moved = f->n_moving;
}

void sv_field_at_block(sv_field *f, const sv_kernels *k, const sv_gaussians *g, int block, int i_thread,
                       float t) {
  job j = {.f = f, .k = k, .g = g, .planes = planes_of(f), .t = t};
  work w = work_of(f, i_thread);
  at_block(&j, block, &w);
}

// --- backward ------------------------------------------------------------------------------------

static float *layer_grad(sv_field *f, int task, size_t at) {
  return f->layers + (size_t)task * (f->n_param - f->n_planes) + (at - f->n_planes);
}

void sv_field_bwd_block(sv_field *f, const sv_kernels *k, int b, int i_thread, uint32_t touched,
                        float *grad) {
  int task = b / SV_FIELD_TASK, left = f->n_moving - 16 * b;
  if (b % SV_FIELD_TASK == 0)
    memset(layer_grad(f, task, f->n_planes), 0, (f->n_param - f->n_planes) * sizeof(float));
  if (left < 16) touched &= (1u << left) - 1;
  f->touched[b] = touched;
  if (!touched) return;
  work w = work_of(f, i_thread);
  sv_planes_args pa = planes_of(f);
  sv_linear_args a = trunk(f);
  const float *c = f->coord + 64 * (size_t)b;
  k->linear(&a, feature_of(f, b), w.h);
  memset(w.dh, 0, 16 * (size_t)f->cfg.width * sizeof(float));
  for (int h = 0; h < f->n_heads; h++) {
    const sv_field_head *hd = &f->head[h];
    for (int i = 0; i < 16 * hd->n; i++) w.out[i] = touched >> (i & 15) & 1 ? grad[16 * hd->row + i] : 0.0f;
    a = head1(f, h);
    k->linear(&a, w.h, w.h2);
    a = head2(f, h);
    k->linear_bwd(&a, w.h2, w.out, w.dh2, layer_grad(f, task, hd->w2), layer_grad(f, task, hd->b2));
    a = head1(f, h);
    k->linear_bwd(&a, w.h, w.dh2, w.dh_one, layer_grad(f, task, hd->w1), layer_grad(f, task, hd->b1));
    for (int i = 0; i < 16 * f->cfg.width; i++) w.dh[i] += w.dh_one[i];
  }
  a = trunk(f);
  k->linear_bwd(&a, feature_of(f, b), w.dh, w.d_feature, layer_grad(f, task, f->trunk_w),
                layer_grad(f, task, f->trunk_b));
  k->planes_bwd(&pa, c, w.d_feature, f->part + (size_t)b * 96 * (size_t)f->n_feature, w.out);
  for (int i = 0; i < 48; i++)
    if (touched >> (i & 15) & 1) grad[i] += w.out[i] * f->inv[i / 16];
}

// --- plane losses --------------------------------------------------------------------------------

// A plane [n][n_lines][n_channels], whose values change along the second axis in n_lines lines of n
// points.
typedef struct {
  const float *p;
  int n_lines, n, n_channels;
} lines;

// weight times the mean square of second differences along lines.
static double differences(const lines *a, float weight) {
  const size_t row = (size_t)a->n_lines * (size_t)a->n_channels;
  double sum = 0, count = (double)a->n_lines * (a->n - 2) * a->n_channels;
  if (a->n <= 2) return 0;
  for (int i = 0; i < a->n_lines; i++)
    for (int j = 0; j + 2 < a->n; j++)
      for (int ch = 0; ch < a->n_channels; ch++) {
        const float *p = a->p + (size_t)j * row + (size_t)i * (size_t)a->n_channels + ch;
        float d = p[2 * row] - 2.0f * p[row] + p[0];
        sum += (double)d * (double)d;
      }
  return (double)weight * sum / count;
}

// Their gradient, added. Apart from the value, which training does not ask for: this is of every
// step.
static void differences_bwd(const lines *a, float weight, float *restrict grad) {
  if (a->n <= 2) return;
  const size_t row = (size_t)a->n_lines * (size_t)a->n_channels;
  const float scale = (float)(2.0 * (double)weight / ((double)a->n_lines * (a->n - 2) * a->n_channels));
  for (int j = 0; j + 2 < a->n; j++) {
    const float *restrict p = a->p + (size_t)j * row;
    float *restrict g = grad + (size_t)j * row;
    for (size_t i = 0; i < row; i++) {
      float s = scale * (p[2 * row + i] - 2.0f * p[row + i] + p[i]);
      g[i] += s;
      g[row + i] -= 2.0f * s;
      g[2 * row + i] += s;
    }
  }
}

static void l1_bwd(const float *p, size_t n, float step, float *grad) {
  for (size_t i = 0; i < n; i++) grad[i] += p[i] > 1.0f ? step : p[i] < 1.0f ? -step : 0.0f;
}

static double l1(const float *p, size_t n) {
  double sum = 0;
  for (size_t i = 0; i < n; i++) sum += fabs(1.0 - (double)p[i]);
  return sum / (double)n;
}

static lines lines_of(const sv_field *f, int l, int plane) {
  const sv_field_cfg *c = &f->cfg;
  return (lines){f->param + f->plane_at[l][plane], res_of(c, l, axes[plane][0]), res_of(c, l, axes[plane][1]),
                 c->n_channels};
}

double sv_field_plane_loss(const sv_field *f, int l, int plane) {
  const sv_field_cfg *c = &f->cfg;
  const lines a = lines_of(f, l, plane);
  if (axes[plane][1] != 3) return differences(&a, c->tv);
  return differences(&a, c->smooth) + (double)c->l1_time * l1(a.p, f->plane_n[l][plane]);
}

void sv_field_plane_loss_bwd(const sv_field *f, int l, int plane, float *grad) {
  const sv_field_cfg *c = &f->cfg;
  const size_t n = f->plane_n[l][plane];
  const lines a = lines_of(f, l, plane);
  if (axes[plane][1] != 3) {
    differences_bwd(&a, c->tv, grad);
    return;
  }
  differences_bwd(&a, c->smooth, grad);
  l1_bwd(a.p, n, c->l1_time / (float)n, grad);
}

// --- a step --------------------------------------------------------------------------------------

#define ADAM_ROWS 32

typedef struct {
  sv_field *f;
  const sv_kernels *k;
  sv_planes_args planes;
  sv_adam_args adam;
  float lr_planes, lr_layers;
  int n_blocks;
} step_job;

static void adam_run(const step_job *j, size_t at, size_t n, const float *grad, float rate) {
  float lr[ADAM_ROWS];
  sv_adam_args a = j->adam;
  a.lr = lr;
  for (int i = 0; i < ADAM_ROWS; i++) lr[i] = rate;
  for (size_t i = 0; i < n; i += 16 * ADAM_ROWS) {
    a.n_rows = (int)((n - i + 15) / 16);
    if (a.n_rows > ADAM_ROWS) a.n_rows = ADAM_ROWS;
    j->k->adam(&a, 0xffff, grad + i, j->f->param + at + i, j->f->m + at + i, j->f->v + at + i);
  }
}

// One plane a task, so that no two threads add to one gradient and the order is that of the
// Gaussians.
static void plane_task(void *arg, int i_task, int i_thread) {
  const step_job *j = arg;
  sv_field *f = j->f;
  int l = i_task / SV_FIELD_PLANES, p = i_task % SV_FIELD_PLANES;
  float *grad = f->grad + f->plane_at[l][p];
  (void)i_thread;
  memset(grad, 0, f->plane_n[l][p] * sizeof *grad);
  for (int b = 0; b < j->n_blocks; b++)
    if (f->touched[b])
      j->k->planes_add(&j->planes, l, p,
                       &(sv_planes_block){f->coord + 64 * (size_t)b,
                                          f->part + (size_t)b * 96 * (size_t)f->n_feature, f->touched[b]},
                       grad);
  sv_field_plane_loss_bwd(f, l, p, grad);
  adam_run(j, f->plane_at[l][p], f->plane_n[l][p], grad, j->lr_planes);
}

void sv_field_step(sv_field *f, const sv_compute *compute, uint32_t step, float progress, float radius) {
  const sv_field_cfg *c = &f->cfg;
  double bias1 = 1.0 - sv_pow(0.9, (double)step), bias2 = 1.0 - sv_pow(0.999, (double)step);
  double x = (double)sv_clampf(progress, 0.0f, 1.0f), r = (double)radius / bias1;
  step_job j = {
      .f = f,
      .k = compute->k,
      .planes = planes_of(f),
      .adam = {.beta1 = 0.9f,
               .beta2 = 0.999f,
               .eps = 1e-15f,
               .step = step,
               .rsqrt_bias2 = (float)(1.0 / sqrt(bias2))},
      .lr_planes = (float)(r * (double)c->lr_planes * sv_pow((double)(c->lr_planes_end / c->lr_planes), x)),
      .lr_layers = (float)(r * (double)c->lr_layers * sv_pow((double)(c->lr_layers_end / c->lr_layers), x)),
      .n_blocks = (f->n_moving + 15) / 16};
  if (!j.n_blocks) return;
  int n_tasks = (j.n_blocks + SV_FIELD_TASK - 1) / SV_FIELD_TASK;
  size_t n = f->n_param - f->n_planes;
  for (int i = 1; i < n_tasks; i++) // folded in the order of the tasks
    for (size_t p = 0; p < n; p++) f->layers[p] += f->layers[(size_t)i * n + p];
  sv_pool_run(compute->pool, plane_task, &j, c->n_levels * SV_FIELD_PLANES);
  adam_run(&j, f->n_planes, n, f->layers, j.lr_layers);
}
