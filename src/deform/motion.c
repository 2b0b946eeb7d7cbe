// SPDX-License-Identifier: Apache-2.0
#include "src/deform/motion.h"

#include <string.h>

#include "src/base/mathx.h"

#define BLOCKS_PER_TASK 64
// ln: over the whole clip the window takes less than 0.01 from a logit
#define SHARPNESS_START (-4.0f)
#define SHARPNESS_NONE  (-60.0f)
#define N_SAMPLES       17 // times at which an extent is looked at

sv_status sv_motion_init(sv_motion *mo, const sv_motion_cfg *cfg, const sv_gaussians *g, sv_arena *arena) {
  const int n[3] = {cfg->n_pos, cfg->n_rot, cfg->n_colour};
  for (int i = 0; i < 3; i++)
    if (n[i] < 0 || n[i] > SV_CAP_MOTION_FUNCTIONS) return SV_E_ARG;
  *mo = (sv_motion){.cfg = *cfg,
                    .cap = g->cap,
                    .n_gaussian_rows = g->n_rows,
                    .n_rows = SV_N_MROWS(cfg->n_pos, cfg->n_rot, cfg->n_colour)};
  size_t n_param = (size_t)g->cap * (size_t)mo->n_rows;
  mo->param = SV_TAKE(arena, float, n_param);
  mo->moved = SV_TAKE(arena, float, (size_t)g->cap *(size_t)g->n_rows);
  mo->m = cfg->has_grad ? SV_TAKE(arena, uint16_t, n_param) : NULL;
  mo->v = cfg->has_grad ? SV_TAKE(arena, uint16_t, n_param) : NULL;
  sv_status s = sv_bodies_init(&mo->bodies, g->cap, cfg->cap_knots, cfg->has_grad, arena);
  if (s < 0) return s;
  return arena->status < 0 ? arena->status : SV_OK;
}

static void rest(sv_motion *mo, int i, float sharpness) {
  if (mo->bodies.of) mo->bodies.of[i] = 0;
  for (int r = 0; r < mo->n_rows; r++) *sv_motion_row(mo, i, r) = 0.0f;
  *sv_motion_row(mo, i, SV_MROW_CENTRE) = 0.5f;
  *sv_motion_row(mo, i, SV_MROW_SHARPNESS) = sharpness;
  if (!mo->m) return;
  long at = sv_motion_row(mo, i, 0) - mo->param;
  for (int r = 0; r < mo->n_rows; r++) mo->m[at + 16 * r] = mo->v[at + 16 * r] = 0;
}

// Where time has no end, no window may close by itself.
void sv_motion_rest(sv_motion *mo, int i) {
  rest(mo, i, mo->cfg.functions == SV_MOTION_POWERS ? SHARPNESS_NONE : SHARPNESS_START);
}

void sv_motion_still(sv_motion *mo, int i) { rest(mo, i, SHARPNESS_NONE); }

void sv_motion_reset(sv_motion *mo, int n) {
  for (int i = 0; i < mo->cap; i++) rest(mo, i, i < n ? SHARPNESS_START : SHARPNESS_NONE);
  mo->n_moving = n;
  sv_bodies_reset(&mo->bodies, mo->cap);
}

void sv_motion_functions(const sv_motion_cfg *cfg, int n, float t, float f[SV_CAP_MOTION_FUNCTIONS]) {
  if (n < 1) return;
  if (cfg->functions == SV_MOTION_POWERS) {
    float x = t - cfg->t0, p = x;
    for (int j = 0; j < n; j++, p *= x) f[j] = p;
    return;
  }
  float x = 2.0f * t - 1.0f, before = 1.0f, now = x;
  for (int j = 0; j < n; j++) {
    f[j] = now;
    float next = fmaf(2.0f * x, now, -before);
    before = now;
    now = next;
  }
}

sv_motion_values sv_motion_values_at(const sv_motion_cfg *cfg, float t) {
  sv_motion_values v;
  sv_motion_functions(cfg, cfg->n_pos, t, v.pos);
  sv_motion_functions(cfg, cfg->n_rot, t, v.rot);
  sv_motion_functions(cfg, cfg->n_colour, t, v.colour);
  return v;
}

// Rows of the n coefficients of one component: the first row, and the step to the next.
typedef struct {
  int row, n, step;
} series;

// Taylor shift by h of one value and its coefficients (Horner's scheme: each pass leaves one of the
// new ones).
static void shift(float *value, const sv_motion *mo, int i, series s, float h) {
  for (int first = 0; first < s.n; first++)
    for (int j = s.n - 1; j >= first; j--) {
      float up = *sv_motion_row(mo, i, s.row + s.step * j);
      float *to = j > 0 ? sv_motion_row(mo, i, s.row + s.step * (j - 1)) : value;
      *to += h * up;
    }
}

// Gradients of a quaternion are perpendicular to it, so each step makes it longer, and the next
// steps turn it less.
static void normalize(sv_motion *mo, sv_gaussians *g, int i, int row) {
  float len2 = 0;
  for (int w = 0; w < 4; w++)
    len2 += *sv_gaussians_at(g, i, SV_ROW_QUAT + w) * *sv_gaussians_at(g, i, SV_ROW_QUAT + w);
  if (!(len2 > 0)) return;
  const float f = 1.0f / sqrtf(len2);
  for (int w = 0; w < 4; w++) *sv_gaussians_at(g, i, SV_ROW_QUAT + w) *= f;
  for (int r = 0; r < 4 * mo->cfg.n_rot; r++) *sv_motion_row(mo, i, row + r) *= f;
}

void sv_motion_advance(sv_motion *mo, sv_gaussians *g, float t0) {
  const sv_motion_cfg *c = &mo->cfg;
  float h = t0 - c->t0;
  int rot = SV_MROW_FUNCTIONS + 3 * c->n_pos, colour = rot + 4 * c->n_rot;
  for (int i = 0; i < mo->n_moving; i++) {
    for (int w = 0; w < 3; w++)
      shift(sv_gaussians_at(g, i, SV_ROW_MEAN + w), mo, i, (series){SV_MROW_FUNCTIONS + w, c->n_pos, 3}, h);
    for (int w = 0; w < 4; w++)
      shift(sv_gaussians_at(g, i, SV_ROW_QUAT + w), mo, i, (series){rot + w, c->n_rot, 4}, h);
    for (int w = 0; w < 3; w++)
      shift(sv_gaussians_at(g, i, SV_ROW_SH + w), mo, i, (series){colour + w, c->n_colour, 3}, h);
  }
  for (int i = 0; i < g->n; i++) normalize(mo, g, i, rot);
  mo->cfg.t0 = t0;
}

sv_motion_args sv_motion_args_of(const sv_motion *mo, const sv_gaussians *g, float t,
                                 const sv_motion_values *f) {
  return (sv_motion_args){.param = g->param,
                          .motion = mo->param,
                          .moved = mo->moved,
                          .n_rows = g->n_rows,
                          .n_pos = mo->cfg.n_pos,
                          .n_rot = mo->cfg.n_rot,
                          .n_colour = mo->cfg.n_colour,
                          .f_pos = f->pos,
                          .f_rot = f->rot,
                          .f_colour = f->colour,
                          .t = t};
}

// --- a time --------------------------------------------------------------------------------------

typedef struct {
  const sv_kernels *k;
  const sv_motion *mo;
  sv_motion_args a;
  int n_blocks;
  bool is_carried; // by bodies
} job;

static void move_task(void *arg, int i_task, int i_thread) {
  job *j = arg;
  int b0 = i_task * BLOCKS_PER_TASK;
  (void)i_thread;
  int b1 = sv_mini(b0 + BLOCKS_PER_TASK, j->n_blocks);
  j->k->motion(&j->a, b0, b1);
  if (j->is_carried)
    sv_bodies_carry(&j->mo->bodies, j->mo->bodies.now, j->mo->moved, j->mo->n_gaussian_rows, 16 * b0,
                    sv_mini(16 * b1, j->mo->n_moving));
}

static void move(sv_motion *mo, const sv_compute *c, sv_gaussians *g, float t, bool is_carried) {
  sv_motion_values f = sv_motion_values_at(&mo->cfg, t);
  job j = {.k = c->k,
           .mo = mo,
           .a = sv_motion_args_of(mo, g, t, &f),
           .n_blocks = (mo->n_moving + 15) / 16,
           .is_carried = is_carried};
  if (is_carried) sv_bodies_at(&mo->bodies, t, mo->bodies.now);
  sv_pool_run(c->pool, move_task, &j, (j.n_blocks + BLOCKS_PER_TASK - 1) / BLOCKS_PER_TASK);
  g->moved = mo->moved;
  g->n_moved = mo->n_moving;
}

void sv_motion_at(sv_motion *mo, const sv_compute *c, sv_gaussians *g, float t) {
  move(mo, c, g, t, mo->bodies.n > 1);
}

void sv_motion_local_at(sv_motion *mo, const sv_compute *c, sv_gaussians *g, float t) {
  move(mo, c, g, t, false);
}

// Spread of what `width` sums of functions do over the clip: the largest distance from their mean.
static float spread(const sv_motion *mo, int i, int row, int n, int width) {
  float x[N_SAMPLES][4] = {{0}}, mean[4] = {0}, most = 0, f[SV_CAP_MOTION_FUNCTIONS];
  for (int s = 0; s < N_SAMPLES; s++) {
    float t = (float)s / (N_SAMPLES - 1);
    sv_motion_functions(&mo->cfg, n, mo->cfg.functions == SV_MOTION_POWERS ? mo->cfg.t0 - t : t, f);
    for (int w = 0; w < width; w++) {
      for (int j = 0; j < n; j++) x[s][w] += f[j] * *sv_motion_row(mo, i, row + width * j + w);
      mean[w] += x[s][w] / N_SAMPLES;
    }
  }
  for (int s = 0; s < N_SAMPLES; s++) {
    float d2 = 0;
    for (int w = 0; w < width; w++) d2 += (x[s][w] - mean[w]) * (x[s][w] - mean[w]);
    most = sv_maxf(most, d2);
  }
  return sqrtf(most);
}

sv_motion_extent sv_motion_extent_of(const sv_motion *mo, int i) {
  float centre = *sv_motion_row(mo, i, SV_MROW_CENTRE);
  int pos = SV_MROW_FUNCTIONS, colour = pos + 3 * mo->cfg.n_pos + 4 * mo->cfg.n_rot;
  float far = sv_maxf(centre * centre, (1.0f - centre) * (1.0f - centre));
  const int body = mo->bodies.n > 1 ? mo->bodies.of[i] : 0;
  return (sv_motion_extent){
      .distance = spread(mo, i, pos, mo->cfg.n_pos, 3) + (body ? sv_bodies_reach(&mo->bodies, body) : 0.0f),
      .colour = (float)SV_SH_C0 * spread(mo, i, colour, mo->cfg.n_colour, 3),
      .fade = sv_minf(far * (float)sv_exp((double)*sv_motion_row(mo, i, SV_MROW_SHARPNESS)), SV_WINDOW_MAX)};
}

static void swap_h(uint16_t *a, uint16_t *b) {
  uint16_t s = *a;
  *a = *b;
  *b = s;
}

static void swap(float *a, float *b) {
  float t = *a;
  *a = *b;
  *b = t;
}

void sv_motion_swap(sv_motion *mo, int i, int j) {
  long a = sv_motion_row(mo, i, 0) - mo->param, b = sv_motion_row(mo, j, 0) - mo->param;
  if (mo->bodies.of) {
    uint8_t of = mo->bodies.of[i];
    mo->bodies.of[i] = mo->bodies.of[j];
    mo->bodies.of[j] = of;
  }
  for (int r = 0; r < mo->n_rows; r++) {
    swap(mo->param + a + 16 * r, mo->param + b + 16 * r);
    if (!mo->m) continue;
    swap_h(mo->m + a + 16 * r, mo->m + b + 16 * r);
    swap_h(mo->v + a + 16 * r, mo->v + b + 16 * r);
  }
}

void sv_motion_copy(sv_motion *mo, int to, int from) {
  long a = sv_motion_row(mo, to, 0) - mo->param, b = sv_motion_row(mo, from, 0) - mo->param;
  if (mo->bodies.of) mo->bodies.of[to] = mo->bodies.of[from];
  for (int r = 0; r < mo->n_rows; r++) {
    mo->param[a + 16 * r] = mo->param[b + 16 * r];
    if (mo->m) mo->m[a + 16 * r] = mo->v[a + 16 * r] = 0;
  }
}
