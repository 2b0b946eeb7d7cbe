// SPDX-License-Identifier: Apache-2.0
#include "src/train/rolling.h"

#include <string.h>

#include "src/base/mathx.h"
#include "src/train/train.h"

#define BLOCKS_PER_TASK 32
// Of the row time: each multiplies its error by how many rows the image moves while one is read.
#define ITERATIONS 3

void sv_rolling_carve(sv_rolling *r, const sv_gaussians *g, int cap_views, sv_arena *a) {
  sv_arena_part_begin(a, "rolling shutter");
  r->view = SV_TAKE(a, sv_rolling_view, cap_views);
  r->moved = SV_TAKE(a, float, (size_t)g->cap *(size_t)g->n_rows);
  r->row_s = SV_TAKE(a, float, g->cap);
}

void sv_train_set_rolling(sv_trainer *t, int i_view, const sv_row_time *time, const double motion[6]) {
  double size = 0;
  if (!t->cfg.is_rolling) return;
  sv_rolling_view *r = &t->rolling.view[i_view];
  memset(r, 0, sizeof *r);
  for (int i = 0; time && i < 6; i++) size += fabs(motion[i]);
  if (!time || !(time->max_s > 0) || !(size > 0)) return;
  for (int i = 0; i < SV_ROW_TIME_TERMS; i++) r->time[i] = (float)time->c[i];
  r->max_s = (float)time->max_s;
  for (int i = 0; i < 3; i++) {
    r->omega[i] = (float)motion[i];
    r->v[i] = (float)motion[3 + i];
  }
  r->is_on = true;
}

// --- one Gaussian --------------------------------------------------------------------------------

static void cross(float out[3], const float a[3], const float b[3]) {
  out[0] = a[1] * b[2] - a[2] * b[1];
  out[1] = a[2] * b[0] - a[0] * b[2];
  out[2] = a[0] * b[1] - a[1] * b[0];
}

static float dot(const float a[3], const float b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

// Time of a direction; and how it changes with the direction, 0 beyond the limits.
static float row_time(const sv_rolling_view *r, float x, float y, float slope[2]) {
  const float *c = r->time;
  const float s = c[0] + x * (c[1] + x * (c[3] + x * c[6] + y * c[7])) +
                  y * (c[2] + x * c[4] + y * (c[5] + x * c[8] + y * c[9]));
  const bool is_in = s > -r->max_s && s < r->max_s;
  slope[0] = is_in ? c[1] + x * (2 * c[3] + 3 * x * c[6] + 2 * y * c[7]) + y * (c[4] + y * c[8]) : 0.0f;
  slope[1] = is_in ? c[2] + y * (2 * c[5] + 3 * y * c[9] + 2 * x * c[8]) + x * (c[4] + x * c[7]) : 0.0f;
  return sv_clampf(s, -r->max_s, r->max_s);
}

// A mean in the camera's frame: at the view's pose, its velocity and acceleration there.
typedef struct {
  float x0[3], a[3], b[3];
} path;

static path path_of(const sv_rolling *r, const float *mean) { // mean's components are 16 apart
  const float *rot = r->at.r, *t = r->at.t;
  path p;
  for (int i = 0; i < 3; i++)
    p.x0[i] = rot[3 * i] * mean[0] + rot[3 * i + 1] * mean[16] + rot[3 * i + 2] * mean[32] + t[i];
  cross(p.a, r->now->omega, p.x0);
  cross(p.b, r->now->omega, p.a);
  for (int i = 0; i < 3; i++) p.a[i] += r->now->v[i];
  return p;
}

static void at_time(const path *p, float s, float x[3]) {
  for (int i = 0; i < 3; i++) x[i] = p->x0[i] + s * (p->a[i] + 0.5f * s * p->b[i]);
}

// What is not in front of the camera stays.
static bool is_moved(const sv_rolling *r, const path *p) { return p->x0[2] > r->near_z; }

// The time at which the mean is read, and where it is then.
static float read_time(const sv_rolling *r, const path *p, float x[3]) {
  float slope[2], s = 0.0f;
  memcpy(x, p->x0, sizeof p->x0);
  for (int k = 0; k < ITERATIONS; k++) {
    const float iz = 1.0f / sv_maxf(x[2], r->near_z);
    s = row_time(r->now, x[0] * iz, x[1] * iz, slope);
    at_time(p, s, x);
  }
  return s;
}

// --- a view --------------------------------------------------------------------------------------

static void move_task(void *arg, int i_task, int i_thread) {
  sv_trainer *t = arg;
  sv_rolling *r = &t->rolling;
  const int n_blocks = (t->g.n + 15) / 16, b1 = sv_mini((i_task + 1) * BLOCKS_PER_TASK, n_blocks);
  const size_t rows = 16 * (size_t)t->g.n_rows;
  (void)i_thread;
  for (int b = i_task * BLOCKS_PER_TASK; b < b1; b++) {
    const float *from = t->g.param + (size_t)b * rows;
    float *to = r->moved + (size_t)b * rows;
    memcpy(to, from, rows * sizeof *to);
    for (int k = 0; k < 16; k++) {
      const path p = path_of(r, from + k);
      float x[3], d[3];
      if (!is_moved(r, &p)) continue;
      r->row_s[16 * b + k] = read_time(r, &p, x);
      for (int i = 0; i < 3; i++) d[i] = x[i] - p.x0[i];
      for (int i = 0; i < 3; i++)
        to[16 * (SV_ROW_MEAN + i) + k] += r->at.r[i] * d[0] + r->at.r[3 + i] * d[1] + r->at.r[6 + i] * d[2];
    }
  }
}

void sv_train_roll(sv_trainer *t, int i_view, const sv_view *view, float near_z) {
  sv_rolling *r = &t->rolling;
  if (!t->cfg.is_rolling || !r->view[i_view].is_on) return;
  r->at = *view;
  r->now = &r->view[i_view];
  r->near_z = near_z;
  sv_pool_run(t->compute.pool, move_task, t, ((t->g.n + 15) / 16 + BLOCKS_PER_TASK - 1) / BLOCKS_PER_TASK);
  t->g.moved = r->moved;
  t->g.n_moved = t->g.n;
}

void sv_train_unroll(sv_trainer *t) {
  if (!t->cfg.is_rolling) return;
  t->g.moved = NULL;
  t->g.n_moved = 0;
}

// --- backward ------------------------------------------------------------------------------------

// From g, dL/dx, to dL/dx0, through the row time, too: s = S(x), x = x(x0, s), so with q = dS/dx and
// w = dx/ds the change of s is q . (dx by x0) / (1 - q . w). x: where the mean is at its time.
static void to_start(const sv_rolling *r, const path *p, float s, float x[3], const float g[3],
                     float out[3]) {
  const float *omega = r->now->omega;
  float slope[2], w[3], e[3], turn[3], turn2[3];
  at_time(p, s, x);
  const float iz = 1.0f / sv_maxf(x[2], r->near_z);
  (void)row_time(r->now, x[0] * iz, x[1] * iz, slope);
  const float q[3] = {slope[0] * iz, slope[1] * iz, -(slope[0] * x[0] + slope[1] * x[1]) * iz * iz};
  for (int i = 0; i < 3; i++) w[i] = p->a[i] + s * p->b[i];
  const float share = dot(g, w) / (1.0f - dot(q, w));
  for (int i = 0; i < 3; i++) e[i] = g[i] + share * q[i];
  // The transpose of I + s [omega] + s^2/2 [omega]^2.
  cross(turn, omega, e);
  cross(turn2, omega, turn);
  for (int i = 0; i < 3; i++) out[i] = e[i] - s * (turn[i] - 0.5f * s * turn2[i]);
}

void sv_train_roll_bwd(const sv_trainer *t, int b, uint32_t touched, float *grad, float pose[6]) {
  const sv_rolling *r = &t->rolling;
  const float *param = t->g.param + (size_t)b * 16 * (size_t)t->g.n_rows, *rot = r->at.r;
  if (b >= t->render.n_moved_blocks) return;
  for (; touched; touched &= touched - 1) {
    const int k = __builtin_ctz(touched);
    const path p = path_of(r, param + k);
    float *m = grad + 16 * SV_ROW_MEAN + k, g[3], g0[3], x[3], moment[3], moment0[3];
    if (!is_moved(r, &p)) continue;
    for (int i = 0; i < 3; i++) g[i] = rot[3 * i] * m[0] + rot[3 * i + 1] * m[16] + rot[3 * i + 2] * m[32];
    to_start(r, &p, r->row_s[16 * b + k], x, g, g0);
    for (int i = 0; i < 3; i++)
      m[16 * i] += rot[i] * (g0[0] - g[0]) + rot[3 + i] * (g0[1] - g[1]) + rot[6 + i] * (g0[2] - g[2]);
    if (!pose) continue;
    // The kernel's is of a twist at the row's time: x x g and g, instead of x0 x g0 and g0.
    cross(moment, x, g);
    cross(moment0, p.x0, g0);
    for (int i = 0; i < 3; i++) {
      pose[i] += moment0[i] - moment[i];
      pose[3 + i] += g0[i] - g[i];
    }
  }
}
