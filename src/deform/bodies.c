// SPDX-License-Identifier: Apache-2.0
#include "src/deform/bodies.h"

#include <math.h>
#include <string.h>

#include "src/base/mathx.h"
#include "src/splat/gaussians.h"

void sv_quat_mul(const float a[4], const float b[4], float out[4]) {
  out[0] = a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3];
  out[1] = a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2];
  out[2] = a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1];
  out[3] = a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0];
}

// y = x + 2 w (v x x) + 2 v x (v x x) of the unit quaternion (w, v).
static void turn(const float q[4], const float x[3], float y[3]) {
  const float a[3] = {q[2] * x[2] - q[3] * x[1], q[3] * x[0] - q[1] * x[2], q[1] * x[1] - q[2] * x[0]};
  const float b[3] = {q[2] * a[2] - q[3] * a[1], q[3] * a[0] - q[1] * a[2], q[1] * a[1] - q[2] * a[0]};
  for (int k = 0; k < 3; k++) y[k] = x[k] + 2.0f * (q[0] * a[k] + b[k]);
}

void sv_rigid_apply(const sv_rigid *m, const float c[3], const float x[3], float y[3]) {
  float from[3] = {x[0] - c[0], x[1] - c[1], x[2] - c[2]}, to[3];
  turn(m->q, from, to);
  for (int k = 0; k < 3; k++) y[k] = to[k] + c[k] + m->d[k];
}

void sv_rigid_undo(const sv_rigid *m, const float c[3], const float y[3], float x[3]) {
  const float back[4] = {m->q[0], -m->q[1], -m->q[2], -m->q[3]};
  float from[3], to[3];
  for (int k = 0; k < 3; k++) from[k] = y[k] - c[k] - m->d[k];
  turn(back, from, to);
  for (int k = 0; k < 3; k++) x[k] = to[k] + c[k];
}

sv_rigid sv_rigid_then(const sv_rigid *a, const sv_rigid *b) {
  sv_rigid m;
  sv_quat_mul(b->q, a->q, m.q);
  for (int k = 0; k < 3; k++) m.d[k] = a->d[k] + b->d[k];
  return m;
}

// --- knots ---------------------------------------------------------------------------------------

sv_status sv_bodies_init(sv_bodies *b, int cap, int cap_knots, bool has_grad, sv_arena *arena) {
  memset(b, 0, sizeof *b);
  if (cap_knots < 0 || cap_knots > SV_CAP_KNOTS) return SV_E_ARG;
  if (cap_knots == 0) return SV_OK;
  const size_t n = (size_t)SV_CAP_BODIES * (size_t)cap_knots;
  b->cap_knots = cap_knots;
  b->n = 1;
  b->centre = sv_arena_take(arena, SV_CAP_BODIES, sizeof *b->centre);
  b->radius = SV_TAKE(arena, float, SV_CAP_BODIES);
  b->now = SV_TAKE(arena, sv_rigid, SV_CAP_BODIES);
  b->time = SV_TAKE(arena, float, cap_knots);
  b->knot = SV_TAKE(arena, sv_rigid, n);
  b->of = SV_TAKE(arena, uint8_t, cap);
  if (!has_grad) return arena->status < 0 ? arena->status : SV_OK;
  b->adam = SV_TAKE(arena, sv_knot_adam, n);
  return arena->status < 0 ? arena->status : SV_OK;
}

void sv_bodies_reset(sv_bodies *b, int cap) {
  if (!b->of) return;
  memset(b->of, 0, (size_t)cap);
  memset(b->centre, 0, SV_CAP_BODIES * sizeof *b->centre);
  memset(b->radius, 0, SV_CAP_BODIES * sizeof *b->radius);
  memset(b->time, 0, (size_t)b->cap_knots * sizeof *b->time);
  b->n = 1;
  b->n_knots = 0;
  for (long i = 0; i < (long)SV_CAP_BODIES * b->cap_knots; i++) {
    b->knot[i] = SV_RIGID_IDENTITY;
    if (b->adam) b->adam[i] = (sv_knot_adam){.n_steps = 0};
  }
  for (int i = 0; i < SV_CAP_BODIES; i++) b->now[i] = SV_RIGID_IDENTITY;
}

int sv_bodies_find_knot(const sv_bodies *b, float time) {
  for (int i = 0; i < b->n_knots; i++)
    if (b->time[i] == time) return i;
  return -1;
}

// The turn q, `share` times.
static void turn_by(const float q[4], float share, float out[4]) {
  double s = sqrt((double)q[1] * (double)q[1] + (double)q[2] * (double)q[2] + (double)q[3] * (double)q[3]);
  double half = sv_atan2(s, (double)q[0]);
  if (half > 1.5707963267948966) half -= 3.141592653589793; // the shorter way
  double by = half * (double)share, f = s > 1e-12 ? sv_sin(by) / s : 0.0;
  out[0] = (float)sv_cos(by);
  for (int k = 1; k < 4; k++) out[k] = (float)(f * (double)q[k]);
}

static void normalise(float q[4]) {
  float n = 1.0f / sqrtf(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
  for (int k = 0; k < 4; k++) q[k] *= n;
}

// Where a body goes that was at a, then at b, `share` times the way from a to b behind b.
static sv_rigid extrapolate(const sv_rigid *a, const sv_rigid *b, float share) {
  const float back[4] = {a->q[0], -a->q[1], -a->q[2], -a->q[3]};
  float by[4], more[4];
  sv_rigid m;
  sv_quat_mul(b->q, back, by);
  turn_by(by, share, more);
  sv_quat_mul(more, b->q, m.q);
  normalise(m.q);
  for (int k = 0; k < 3; k++) m.d[k] = b->d[k] + share * (b->d[k] - a->d[k]);
  return m;
}

int sv_bodies_add_knot(sv_bodies *b, float time) {
  int at = 0, there = sv_bodies_find_knot(b, time);
  if (there >= 0) return there;
  if (b->n_knots >= b->cap_knots) return -1;
  while (at < b->n_knots && b->time[at] < time) at++;
  sv_rigid before[SV_CAP_BODIES];
  const bool is_last = at == b->n_knots && b->n_knots > 1, is_first = at == 0 && b->n_knots > 1;
  sv_bodies_at(b, time, before);
  for (int body = 1; body < b->n && (is_last || is_first); body++) {
    const int i1 = is_last ? at - 1 : 0, i0 = is_last ? at - 2 : 1;
    before[body] = extrapolate(sv_bodies_knot(b, body, i0), sv_bodies_knot(b, body, i1),
                               (time - b->time[i1]) / (b->time[i1] - b->time[i0]));
  }
  const int n_behind = b->n_knots - at;
  memmove(b->time + at + 1, b->time + at, (size_t)n_behind * sizeof *b->time);
  b->time[at] = time;
  for (int body = 0; body < SV_CAP_BODIES; body++) {
    const long i = (long)body * b->cap_knots + at;
    memmove(b->knot + i + 1, b->knot + i, (size_t)n_behind * sizeof *b->knot);
    b->knot[i] = body > 0 && body < b->n ? before[body] : SV_RIGID_IDENTITY;
    if (!b->adam) continue;
    memmove(b->adam + i + 1, b->adam + i, (size_t)n_behind * sizeof *b->adam);
    b->adam[i] = (sv_knot_adam){.n_steps = 0};
  }
  b->n_knots++;
  return at;
}

float sv_bodies_reach(const sv_bodies *b, int body) {
  float most = 0;
  for (int i = 0; i < b->n_knots; i++) {
    const sv_rigid *m = sv_bodies_knot(b, body, i);
    float d2 = 0, turn2 = 0;
    for (int k = 0; k < 3; k++) {
      d2 += m->d[k] * m->d[k];
      turn2 += m->q[1 + k] * m->q[1 + k];
    }
    most = sv_maxf(most, sqrtf(d2) + 2.0f * sqrtf(turn2) * b->radius[body]);
  }
  return most;
}

// --- between knots -------------------------------------------------------------------------------

#define N_AROUND 6    // knots that a pose between two of them is found from, at most
#define MAX_SUM  4.0f // of the weights' sizes: where knots lie unevenly, fewer are taken

typedef struct {
  int n, at[N_AROUND]; // knots, rising
  float w[N_AROUND];
} blend;

// Lagrange's weights at a time t, of the polynomial through the knots of l, of those left of which
// there are n_before.
static void weigh(const sv_bodies *b, float t, int n_before, blend *l) {
  for (;;) {
    float sum = 0;
    for (int k = 0; k < l->n; k++) {
      float p = 1, here = b->time[l->at[k]];
      for (int o = 0; o < l->n; o++)
        if (o != k) p *= (t - b->time[l->at[o]]) / (here - b->time[l->at[o]]);
      l->w[k] = p;
      sum += fabsf(p);
    }
    if (l->n < 3 || sum <= MAX_SUM) return;
    const float before = t - b->time[l->at[0]], behind = b->time[l->at[l->n - 1]] - t;
    l->n--;
    if (n_before < 2 || (n_before < l->n && before < behind)) continue;
    memmove(l->at, l->at + 1, (size_t)l->n * sizeof *l->at);
    n_before--;
  }
}

// Signs of quaternions go along from knot to knot, so that turns of more than half a circle within
// the knots are told.
static sv_rigid mix(const sv_bodies *b, int body, const blend *l) {
  sv_rigid m = {{0}, {0}};
  float sign = 1;
  for (int k = 0; k < l->n; k++) {
    const sv_rigid *here = sv_bodies_knot(b, body, l->at[k]);
    float dot = 0;
    for (int e = 0; e < 4 && k; e++) dot += here->q[e] * sv_bodies_knot(b, body, l->at[k - 1])->q[e];
    if (dot < 0) sign = -sign;
    for (int e = 0; e < 4; e++) m.q[e] += sign * l->w[k] * here->q[e];
    for (int e = 0; e < 3; e++) m.d[e] += l->w[k] * here->d[e];
  }
  normalise(m.q);
  return m;
}

// At a time between knots i - 1 and j: the knots around it.
static blend around(const sv_bodies *b, float t, int i, int j) {
  blend l = {.n = 0};
  const int from = sv_maxi(i - N_AROUND / 2, 0), to = sv_mini(j + N_AROUND / 2, b->n_knots);
  for (int k = from; k < i; k++) l.at[l.n++] = k;
  for (int k = j; k < to; k++) l.at[l.n++] = k;
  weigh(b, t, i - from, &l);
  return l;
}

bool sv_bodies_among(const sv_bodies *b, int body, int i_knot, sv_rigid *out) {
  if (i_knot < 1 || i_knot > b->n_knots - 2 || b->n_knots < 5) return false;
  const blend l = around(b, b->time[i_knot], i_knot, i_knot + 1);
  *out = mix(b, body, &l);
  return true;
}

void sv_bodies_at(const sv_bodies *b, float time, sv_rigid out[SV_CAP_BODIES]) {
  blend l = {.n = 0};
  int i = 0;
  for (int body = 0; body < SV_CAP_BODIES; body++) out[body] = SV_RIGID_IDENTITY;
  if (b->n_knots < 1 || b->n < 2) return;
  while (i < b->n_knots - 1 && b->time[i + 1] <= time) i++;
  const bool is_at = time <= b->time[i] || i == b->n_knots - 1;
  if (!is_at) l = around(b, time, i + 1, i + 1);
  for (int body = 1; body < b->n; body++) out[body] = is_at ? *sv_bodies_knot(b, body, i) : mix(b, body, &l);
}

void sv_bodies_copy(sv_bodies *to, const sv_bodies *from, int n, int cap) {
  if (!to->of) return;
  sv_bodies_reset(to, cap);
  memcpy(to->of, from->of, (size_t)n);
  memcpy(to->centre, from->centre, SV_CAP_BODIES * sizeof *to->centre);
  memcpy(to->radius, from->radius, SV_CAP_BODIES * sizeof *to->radius);
  memcpy(to->time, from->time, (size_t)from->cap_knots * sizeof *to->time);
  memcpy(to->knot, from->knot, (size_t)SV_CAP_BODIES * (size_t)from->cap_knots * sizeof *to->knot);
  to->n = from->n;
  to->n_knots = from->n_knots;
}

// --- members -------------------------------------------------------------------------------------

void sv_bodies_carry(const sv_bodies *b, const sv_rigid *now, float *moved, int n_rows, int i0, int i1) {
  for (int i = i0; i < i1; i++) {
    const int body = b->of[i];
    if (!body) continue;
    float *slot = moved + (long)(i >> 4) * n_rows * 16 + (i & 15);
    float *x = slot + 16 * SV_ROW_MEAN, *p = slot + 16 * SV_ROW_QUAT;
    float at[3] = {x[0], x[16], x[32]}, q[4] = {p[0], p[16], p[32], p[48]}, out[4];
    sv_rigid_apply(&now[body], b->centre[body], at, at);
    sv_quat_mul(now[body].q, q, out);
    for (int k = 0; k < 3; k++) x[16 * k] = at[k];
    for (int k = 0; k < 4; k++) p[16 * k] = out[k];
  }
}

// slot: a Gaussian's lane of moved.
static void bwd_slot(const sv_bodies *b, int body, const float *slot, float *grad, float sum[6]) {
  const float *x = slot + 16 * SV_ROW_MEAN, *p = slot + 16 * SV_ROW_QUAT;
  const float *c = b->centre[body], *d = b->now[body].d;
  const float back[4] = {b->now[body].q[0], -b->now[body].q[1], -b->now[body].q[2], -b->now[body].q[3]};
  float *gx = grad + 16 * SV_ROW_MEAN, *gp = grad + 16 * SV_ROW_QUAT;
  const float g[3] = {gx[0], gx[16], gx[32]}, gq[4] = {gp[0], gp[16], gp[32], gp[48]};
  float to[4];
  const sv_rigid turn_back = {.q = {back[0], back[1], back[2], back[3]}};
  if (sum) {
    const float y[3] = {x[0] - c[0] - d[0], x[16] - c[1] - d[1], x[32] - c[2] - d[2]};
    const float q[4] = {p[0], p[16], p[32], p[48]};
    sum[0] += y[1] * g[2] - y[2] * g[1];
    sum[1] += y[2] * g[0] - y[0] * g[2];
    sum[2] += y[0] * g[1] - y[1] * g[0];
    // d(quaternion)/d(turn_k) = e_k quaternion / 2
    sum[0] += 0.5f * (-q[1] * gq[0] + q[0] * gq[1] - q[3] * gq[2] + q[2] * gq[3]);
    sum[1] += 0.5f * (-q[2] * gq[0] + q[3] * gq[1] + q[0] * gq[2] - q[1] * gq[3]);
    sum[2] += 0.5f * (-q[3] * gq[0] - q[2] * gq[1] + q[1] * gq[2] + q[0] * gq[3]);
    for (int k = 0; k < 3; k++) sum[3 + k] += g[k];
  }
  const float none[3] = {0};
  sv_rigid_apply(&turn_back, none, g, to);
  for (int k = 0; k < 3; k++) gx[16 * k] = to[k];
  sv_quat_mul(back, gq, to);
  for (int k = 0; k < 4; k++) gp[16 * k] = to[k];
}

void sv_bodies_carry_bwd(const sv_bodies *b, const float *moved, int n_rows, int block, uint32_t touched,
                         float *grad, float (*sum)[6]) {
  if (b->n < 2) return;
  for (; touched; touched &= touched - 1) {
    const int k = __builtin_ctz(touched), body = b->of[16 * block + k];
    if (body) bwd_slot(b, body, moved + (long)block * n_rows * 16 + k, grad + k, sum ? sum[body] : NULL);
  }
}
