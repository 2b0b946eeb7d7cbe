// SPDX-License-Identifier: Apache-2.0
#include "src/train/rolling.h"

#include <math.h>
#include <string.h>

#include "calib/fisheye.h"
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

// --- sixteen Gaussians ---------------------------------------------------------------------------
// Loops over the lanes of a block, which compilers vectorize; without branches, so that they do.

typedef float lanes[16];

// Means in the camera's frame: at the view's pose, their velocity and acceleration there.
typedef struct {
  lanes x0[3], a[3], b[3];
} paths;

static void cross(lanes out[3], const float w[3], lanes x[3]) {
  for (int k = 0; k < 16; k++) {
    const float x0 = x[0][k], x1 = x[1][k], x2 = x[2][k];
    out[0][k] = w[1] * x2 - w[2] * x1;
    out[1][k] = w[2] * x0 - w[0] * x2;
    out[2][k] = w[0] * x1 - w[1] * x0;
  }
}

static void paths_of(const sv_rolling *r, const float *mean, paths *p) {
  const float *m = r->at.r, *t = r->at.t;
  for (int i = 0; i < 3; i++)
    for (int k = 0; k < 16; k++)
      p->x0[i][k] = m[3 * i] * mean[k] + m[3 * i + 1] * mean[16 + k] + m[3 * i + 2] * mean[32 + k] + t[i];
  cross(p->a, r->now->omega, p->x0);
  cross(p->b, r->now->omega, p->a);
  for (int i = 0; i < 3; i++)
    for (int k = 0; k < 16; k++) p->a[i][k] += r->now->v[i];
}

static void at_time(const paths *p, const float *s, lanes x[3]) {
  for (int i = 0; i < 3; i++)
    for (int k = 0; k < 16; k++) x[i][k] = p->x0[i][k] + s[k] * (p->a[i][k] + 0.5f * s[k] * p->b[i][k]);
}

static float larger(float a, float b) { return a > b ? a : b; }
static float smaller(float a, float b) { return a < b ? a : b; }

// Places of a view, (u - cx) / fx and (v - cy) / fy; rows of their derivatives by the point.
typedef struct {
  lanes u, v, du[3], dv[3];
} places;

static void place_pinhole(const sv_rolling *r, lanes x[3], places *p) {
  for (int k = 0; k < 16; k++) {
    const float iz = 1.0f / larger(x[2][k], r->near_z), u = x[0][k] * iz, v = x[1][k] * iz;
    p->u[k] = u;
    p->v[k] = v;
    p->du[0][k] = p->dv[1][k] = iz;
    p->du[1][k] = p->dv[0][k] = 0;
    p->du[2][k] = -u * iz;
    p->dv[2][k] = -v * iz;
  }
}

// As sv_fisheye_project and sv_fisheye_jacobian have it. Beyond the lens's range its radial
// function stays as at the end.
static void place_fisheye(const sv_rolling *r, lanes x[3], places *p) {
  const sv_fisheye *f = r->at.fisheye;
  for (int k = 0; k < 16; k++) {
    const float n = sqrtf(x[0][k] * x[0][k] + x[1][k] * x[1][k] + x[2][k] * x[2][k]),
                inv_n = 1.0f / larger(n, 1e-20f), is = 1.0f / larger(n + x[2][k], 1e-20f);
    const float hx = x[0][k] * is, hy = x[1][k] * is, w = hx * hx + hy * hy;
    const float y = f->scale * smaller(w, f->max_w) - 1.0f;
    const float g[3] = {x[0][k] * inv_n, x[1][k] * inv_n, (n + x[2][k]) * inv_n};
    float at = f->term[0], slope = 0;
    for (int i = 1; i < SV_FISHEYE_TERMS; i++) {
      slope = slope * y + at;
      at = at * y + f->term[i];
    }
    slope *= f->scale;
    p->u[k] = hx * at;
    p->v[k] = hy * at;
    for (int i = 0; i < 3; i++) {
      const float along = (i == 0   ? hx
                           : i == 1 ? hy
                                    : 0.0f) -
                          w * g[i],
                  both = (2 * slope * along - at * g[i]) * is;
      p->du[i][k] = hx * both + (i == 0 ? at * is : 0.0f);
      p->dv[i][k] = hy * both + (i == 1 ? at * is : 0.0f);
    }
  }
}

// Row times of points, and what they change by with each coordinate: nothing beyond the limits.
static void row_time(const sv_rolling *r, lanes x[3], float *s, lanes slope[3]) {
  const float *c = r->now->time, max_s = r->now->max_s;
  places p;
  if (r->at.fisheye) place_fisheye(r, x, &p);
  else place_pinhole(r, x, &p);
  for (int k = 0; k < 16; k++) {
    const float u = p.u[k], v = p.v[k];
    const float t = c[0] + u * (c[1] + u * (c[3] + u * c[6] + v * c[7])) +
                    v * (c[2] + u * c[4] + v * (c[5] + u * c[8] + v * c[9]));
    const float du = c[1] + u * (2 * c[3] + 3 * u * c[6] + 2 * v * c[7]) + v * (c[4] + v * c[8]);
    const float dv = c[2] + v * (2 * c[5] + 3 * v * c[9] + 2 * u * c[8]) + u * (c[4] + u * c[7]);
    const float is_in = t > -max_s && t < max_s ? 1.0f : 0.0f;
    s[k] = larger(smaller(t, max_s), -max_s);
    for (int i = 0; i < 3; i++) slope[i][k] = (du * p.du[i][k] + dv * p.dv[i][k]) * is_in;
  }
}

// 1 where a mean can be seen, else 0: in front of a pinhole, in the range of a fisheye's lens.
static void visibility(const sv_rolling *r, lanes x[3], lanes out) {
  if (r->at.fisheye) {
    for (int k = 0; k < 16; k++) {
      const float n = sqrtf(x[0][k] * x[0][k] + x[1][k] * x[1][k] + x[2][k] * x[2][k]), s = n + x[2][k];
      out[k] = n > r->near_z && x[0][k] * x[0][k] + x[1][k] * x[1][k] <= r->at.fisheye->max_w * s * s ? 1.0f
                                                                                                      : 0.0f;
    }
  } else {
    for (int k = 0; k < 16; k++) out[k] = x[2][k] > r->near_z ? 1.0f : 0.0f;
  }
}

// --- a view --------------------------------------------------------------------------------------

// The time at which each mean is read, and its displacement until then. What the camera cannot see
// stays.
static void move_block(const sv_rolling *r, const float *from, float *to, float *row_s) {
  paths p;
  lanes x[3], slope[3], is_seen;
  paths_of(r, from, &p);
  visibility(r, p.x0, is_seen);
  memcpy(x, p.x0, sizeof x);
  for (int i = 0; i < ITERATIONS; i++) {
    row_time(r, x, row_s, slope);
    at_time(&p, row_s, x);
  }
  for (int i = 0; i < 3; i++)
    for (int k = 0; k < 16; k++) x[i][k] = is_seen[k] > 0 ? x[i][k] - p.x0[i][k] : 0.0f;
  for (int i = 0; i < 3; i++)
    for (int k = 0; k < 16; k++)
      to[16 * i + k] += r->at.r[i] * x[0][k] + r->at.r[3 + i] * x[1][k] + r->at.r[6 + i] * x[2][k];
}

static void move_task(void *arg, int i_task, int i_thread) {
  sv_trainer *t = arg;
  const int n_blocks = (t->g.n + 15) / 16, b1 = sv_mini((i_task + 1) * BLOCKS_PER_TASK, n_blocks);
  const size_t rows = 16 * (size_t)t->g.n_rows;
  (void)i_thread;
  for (int b = i_task * BLOCKS_PER_TASK; b < b1; b++) {
    const float *from = t->g.param + (size_t)b * rows;
    float *to = t->rolling.moved + (size_t)b * rows;
    memcpy(to, from, rows * sizeof *to);
    move_block(&t->rolling, from, to, t->rolling.row_s + 16 * (size_t)b);
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

// From g, dL/dx, to dL/dx0, through the row time, too: s = S(x), x = x(x0, s), so with q = dS/dx
// and w = dx/ds the change of s is q . (dx by x0) / (1 - q . w). x: where the means are at their
// times.
static void to_start(const sv_rolling *r, const paths *p, const float *s, lanes x[3], lanes g[3],
                     lanes out[3]) {
  lanes q[3], e[3], turn[3], turn2[3], again;
  at_time(p, s, x);
  row_time(r, x, again, q);
  for (int k = 0; k < 16; k++) {
    float qw = 0, gw = 0;
    for (int i = 0; i < 3; i++) {
      const float w = p->a[i][k] + s[k] * p->b[i][k];
      qw += q[i][k] * w;
      gw += g[i][k] * w;
    }
    const float share = gw / (1.0f - qw);
    for (int i = 0; i < 3; i++) e[i][k] = g[i][k] + share * q[i][k];
  }
  // The transpose of I + s [omega] + s^2/2 [omega]^2.
  cross(turn, r->now->omega, e);
  cross(turn2, r->now->omega, turn);
  for (int i = 0; i < 3; i++)
    for (int k = 0; k < 16; k++) out[i][k] = e[i][k] - s[k] * (turn[i][k] - 0.5f * s[k] * turn2[i][k]);
}

// The kernel's pose gradient is of a twist at the rows' times: x cross g and g, instead of x0 cross
// g0 and g0.
static void correct_pose(const paths *p, lanes x[3], lanes g[3], lanes g0[3], float pose[6]) {
  for (int i = 0; i < 3; i++) {
    const int j = (i + 1) % 3, n = (i + 2) % 3;
    for (int k = 0; k < 16; k++) {
      pose[i] += p->x0[j][k] * g0[n][k] - p->x0[n][k] * g0[j][k] - (x[j][k] * g[n][k] - x[n][k] * g[j][k]);
      pose[3 + i] += g0[i][k] - g[i][k];
    }
  }
}

void sv_train_roll_bwd(const sv_trainer *t, int b, uint32_t touched, float *grad, float pose[6]) {
  const sv_rolling *r = &t->rolling;
  const float *rot = r->at.r;
  float *m = grad + 16 * SV_ROW_MEAN;
  paths p;
  lanes g[3], g0[3], x[3], is_seen;
  if (b >= t->render.n_moved_blocks || !touched) return;
  paths_of(r, t->g.param + (size_t)b * 16 * (size_t)t->g.n_rows, &p);
  for (int i = 0; i < 3; i++)
    for (int k = 0; k < 16; k++)
      g[i][k] = rot[3 * i] * m[k] + rot[3 * i + 1] * m[16 + k] + rot[3 * i + 2] * m[32 + k];
  visibility(r, p.x0, is_seen);
  to_start(r, &p, r->row_s + 16 * (size_t)b, x, g, g0);
  for (int i = 0; i < 3; i++)
    for (int k = 0; k < 16; k++) g0[i][k] = is_seen[k] > 0 ? g0[i][k] : g[i][k];
  if (pose) correct_pose(&p, x, g, g0, pose);
  for (int i = 0; i < 3; i++)
    for (int k = 0; k < 16; k++) g0[i][k] -= g[i][k];
  for (int i = 0; i < 3; i++)
    for (int k = 0; k < 16; k++)
      m[16 * i + k] += rot[i] * g0[0][k] + rot[3 + i] * g0[1][k] + rot[6 + i] * g0[2][k];
}
