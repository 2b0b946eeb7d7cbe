// SPDX-License-Identifier: Apache-2.0
// Rigid bodies in training: found among what a new time's pictures show displaced (rigid.h),
// followed from time to time, and refined by the pictures' gradients: dL/dd = sum g, dL/d(turn) =
// sum (x - c - d) x g and the quaternions' part, over the members. Beside that each step takes a
// pose towards the polynomial through those before and behind, as far as a share of the learning
// rate: what pictures do not ask for steadily is smooth in time.
#include <string.h>

#include "src/base/mathx.h"
#include "src/dynamic/rigid.h"
#include "src/dynamic/bodies.h"
#include "src/dynamic/curriculum.h"
#include "src/train/optimize.h"

#define TOLERANCE_PX 0.7f // a member is off by less
#define MIN_PX       1.0f // a new body's members move by more
#define MIN_MEMBERS  12   // of a new body
#define MIN_AGREE    6    // members that tell where a body went
#define MIN_SHARE    0.4f // of those that know, else it goes on as it went
#define NEAR_RADII   1.6f // of a body: who joins it
#define JOIN_PX      2.0f // and moves by more

#define KEEP1 0.8f // of Adam's moments: each knot has a view but every so often
#define KEEP2 0.95f
// Of the learning rate: share by which a step pulls a pose towards its neighbor knots'.
#define PULL 0.5f

// --- refining ------------------------------------------------------------------------------------

// Turned by f v rad, which is little.
static void turn_knot(sv_rigid *knot, float f, const float v[3]) {
  const float turn[4] = {1.0f, 0.5f * f * v[0], 0.5f * f * v[1], 0.5f * f * v[2]};
  float q[4], len2 = 0;
  sv_quat_mul(turn, knot->q, q);
  for (int k = 0; k < 4; k++) len2 += q[k] * q[k];
  for (int k = 0; k < 4; k++) knot->q[k] = q[k] / sqrtf(len2);
}

// By so much at most, rad and world units, towards `to`.
static void pull(sv_rigid *knot, const sv_rigid *to, float most_turn, float most_shift) {
  const float back[4] = {knot->q[0], -knot->q[1], -knot->q[2], -knot->q[3]};
  float by[4], turn2 = 0, shift2 = 0;
  sv_quat_mul(to->q, back, by);
  for (int k = 0; k < 3; k++) {
    turn2 += 4 * by[1 + k] * by[1 + k];
    shift2 += (to->d[k] - knot->d[k]) * (to->d[k] - knot->d[k]);
  }
  const float turn = sv_minf(1, most_turn / (sqrtf(turn2) + 1e-20f));
  const float shift = sv_minf(1, most_shift / (sqrtf(shift2) + 1e-20f));
  turn_knot(knot, (by[0] < 0 ? -2 : 2) * turn, by + 1);
  for (int k = 0; k < 3; k++) knot->d[k] += shift * (to->d[k] - knot->d[k]);
}

static void move_knot(sv_dynamic *dyn, int body, int i_knot, const float g[6], float lr) {
  sv_bodies *b = &dyn->deform.motion.bodies;
  const long at = (long)body * b->cap_knots + i_knot;
  sv_rigid *knot = b->knot + at;
  sv_knot_adam *adam = b->adam + at;
  double n = (double)++adam->n_steps;
  float step[6], f1 = (float)(1.0 - sv_pow((double)KEEP1, n)), f2 = (float)(1.0 - sv_pow((double)KEEP2, n));
  for (int k = 0; k < 6; k++) {
    float *m = &adam->m[k], *v = &adam->v[k];
    *m = KEEP1 * *m + (1.0f - KEEP1) * g[k];
    *v = KEEP2 * *v + (1.0f - KEEP2) * (g[k] * g[k]);
    step[k] = -lr * (*m / f1) / (sqrtf(*v / f2) + 1e-15f);
    if (k < 3) step[k] /= b->radius[body];
  }
  turn_knot(knot, 1, step);
  for (int k = 0; k < 3; k++) knot->d[k] += step[3 + k];
  sv_rigid smooth;
  if (sv_bodies_among(b, body, i_knot, &smooth)) pull(knot, &smooth, PULL * lr / b->radius[body], PULL * lr);
}

void sv_dynamic_clear_body_sums(sv_dynamic *dyn) {
  if (dyn->body_sum) memset(dyn->body_sum, 0, (size_t)sv_train_n_tasks(dyn->t) * sizeof *dyn->body_sum);
}

void sv_dynamic_step_bodies(sv_dynamic *dyn, float mean_lr) {
  sv_bodies *b = &dyn->deform.motion.bodies;
  const int i_knot = dyn->body_sum && b->n > 1 ? sv_bodies_find_knot(b, dyn->time) : -1;
  if (i_knot < 0 || dyn->time == dyn->t->reference_time) return; // there they are at rest
  for (int body = 1; body < b->n; body++) {
    float g[6] = {0}, any = 0;
    for (int i = 0; i < sv_train_n_tasks(dyn->t); i++)
      for (int k = 0; k < 6; k++) g[k] += dyn->body_sum[i][body][k];
    for (int k = 0; k < 6; k++) any += fabsf(g[k]);
    if (any > 0) move_knot(dyn, body, i_knot, g, dyn->cfg.lr_body * mean_lr);
  }
}

// --- following -----------------------------------------------------------------------------------

void sv_dynamic_extrapolate_bodies(sv_dynamic *dyn, float to, float before) {
  sv_bodies *b = &dyn->deform.motion.bodies;
  if (!b->of) return;
  for (int i = 0; i < dyn->t->n_views; i++)
    if (sv_dynamic_has_time(dyn, dyn->t->views[i].view.time, before))
      (void)sv_bodies_add_knot(b, dyn->t->views[i].view.time);
  (void)sv_bodies_add_knot(b, to);
}

// The motion about the centre as moved by from, after which it is as by to.
static sv_rigid relative(const sv_rigid *from, const sv_rigid *to) {
  const float back[4] = {from->q[0], -from->q[1], -from->q[2], -from->q[3]};
  sv_rigid m;
  sv_quat_mul(to->q, back, m.q);
  for (int k = 0; k < 3; k++) m.d[k] = to->d[k] - from->d[k];
  return m;
}

// Gaussians of a body, in scratch memory of dyn->near.
static const uint32_t *members(const sv_dynamic *dyn, int body, int *n) {
  uint32_t *list = (uint32_t *)dyn->near->tmp;
  *n = 0;
  for (int i = 0; i < dyn->t->g.n; i++)
    if (dyn->deform.motion.bodies.of[i] == body) list[(*n)++] = (uint32_t)i;
  return list;
}

// Poses of the known bodies at a new time. With too few inliers the extrapolated pose stays.
static void track_known(sv_dynamic *dyn, int i_from, int i_to) {
  sv_bodies *b = &dyn->deform.motion.bodies;
  for (int body = 1; body < b->n; body++) {
    int n, n_inliers = 0;
    const uint32_t *list = members(dyn, body, &n);
    const sv_rigid *from = sv_bodies_knot(b, body, i_from);
    sv_rigid *to = sv_bodies_knot(b, body, i_to), rel = relative(from, to), found;
    float c[3];
    for (int k = 0; k < 3; k++) c[k] = b->centre[body][k] + from->d[k];
    if (!sv_rigid_fit(&(sv_rigid_points){dyn->near->of, list, n, c}, TOLERANCE_PX, &rel, &found, &n_inliers))
      continue;
    int n_known = 0;
    for (int i = 0; i < n; i++) n_known += dyn->near->of[list[i]].is_known;
    if (n_inliers >= MIN_AGREE && (float)n_inliers >= MIN_SHARE * (float)n_known)
      *to = sv_rigid_then(from, &found);
  }
}

// --- new bodies ----------------------------------------------------------------------------------

void sv_dynamic_local_position(const sv_dynamic *dyn, int i, const sv_motion_values *f, float x[3],
                               float q[4]) {
  const sv_motion *mo = &dyn->deform.motion;
  const sv_motion_cfg *c = &mo->cfg;
  const bool is_moving = i < mo->n_moving;
  for (int k = 0; k < 3; k++) {
    x[k] = *sv_gaussians_at(&dyn->t->g, i, SV_ROW_MEAN + k);
    for (int j = 0; j < c->n_pos && is_moving; j++)
      x[k] += f->pos[j] * *sv_motion_row(mo, i, SV_MROW_FUNCTIONS + 3 * j + k);
  }
  for (int k = 0; k < 4 && q; k++) {
    q[k] = *sv_gaussians_at(&dyn->t->g, i, SV_ROW_QUAT + k);
    for (int j = 0; j < c->n_rot && is_moving; j++)
      q[k] += f->rot[j] * *sv_motion_row(mo, i, SV_MROW_FUNCTIONS + 3 * c->n_pos + 4 * j + k);
  }
}

void sv_dynamic_attach(sv_dynamic *dyn, int i, int body, const float x[3], const float q[4]) {
  sv_motion *mo = &dyn->deform.motion;
  const sv_motion_cfg *c = &mo->cfg;
  if (!dyn->is_moving[i]) {
    sv_motion_rest(mo, i);
    dyn->is_moving[i] = 2;
  }
  for (int k = 0; k < 3; k++) *sv_gaussians_at(&dyn->t->g, i, SV_ROW_MEAN + k) = x[k];
  for (int k = 0; k < 4; k++) *sv_gaussians_at(&dyn->t->g, i, SV_ROW_QUAT + k) = q[k];
  long at = sv_motion_row(mo, i, SV_MROW_FUNCTIONS) - mo->param;
  for (int r = 0; r < 3 * c->n_pos + 4 * c->n_rot; r++)
    mo->param[at + 16 * r] = mo->m[at + 16 * r] = mo->v[at + 16 * r] = 0.0f;
  mo->bodies.of[i] = (uint8_t)body;
}

// Where body `body`, of those in list, was at the times before, by its members' own motion.
static void find_past(sv_dynamic *dyn, int body, const uint32_t *list, int n, int i_to, float px_per_unit) {
  sv_bodies *b = &dyn->deform.motion.bodies;
  const sv_motion_values mid = sv_motion_values_at(&dyn->deform.motion.cfg, dyn->t->reference_time);
  for (int i_knot = 0; i_knot < b->n_knots; i_knot++) {
    if (i_knot == i_to || b->time[i_knot] == dyn->t->reference_time) continue;
    const sv_motion_values f = sv_motion_values_at(&dyn->deform.motion.cfg, b->time[i_knot]);
    for (int p = 0; p < n; p++) {
      sv_displaced *o = &dyn->near->of[list[p]];
      float y[3];
      sv_dynamic_local_position(dyn, (int)list[p], &mid, o->x, NULL);
      sv_dynamic_local_position(dyn, (int)list[p], &f, y, NULL);
      for (int k = 0; k < 3; k++) o->u[k] = y[k] - o->x[k];
      for (int k = 0; k < 6; k++) o->a[k] = k == 0 || k == 3 || k == 5 ? px_per_unit * px_per_unit : 0;
      o->is_known = true;
    }
    sv_rigid found;
    if (sv_rigid_fit(&(sv_rigid_points){dyn->near->of, list, n, b->centre[body]}, TOLERANCE_PX, NULL, &found,
                     NULL))
      *sv_bodies_knot(b, body, i_knot) = found;
  }
}

// Center and radius of a new body from its members' positions at the reference time.
static void measure(sv_dynamic *dyn, int body, const uint32_t *list, int n, const sv_motion_values *mid) {
  float *c = dyn->deform.motion.bodies.centre[body], x[3], sum = 0;
  c[0] = c[1] = c[2] = 0;
  for (int p = 0; p < n; p++) {
    sv_dynamic_local_position(dyn, (int)list[p], mid, x, NULL);
    for (int k = 0; k < 3; k++) c[k] += x[k] / (float)n;
  }
  for (int p = 0; p < n; p++) {
    sv_dynamic_local_position(dyn, (int)list[p], mid, x, NULL);
    for (int k = 0; k < 3; k++) sum += (x[k] - c[k]) * (x[k] - c[k]);
  }
  dyn->deform.motion.bodies.radius[body] = sqrtf(sum / (float)n) + 1e-6f * dyn->t->radius;
}

typedef struct {
  int from, to; // knots
} knot_span;

// Makes a body of the Gaussians assigned to it, which moves between two knots by motion about
// from_centre.
static void make_body(sv_dynamic *dyn, int body, const sv_rigid *motion, const float from_centre[3],
                      knot_span span, float px_per_unit) {
  sv_bodies *b = &dyn->deform.motion.bodies;
  const sv_motion_values mid = sv_motion_values_at(&dyn->deform.motion.cfg, dyn->t->reference_time);
  int n;
  const uint32_t *list = members(dyn, body, &n);
  const float *c = b->centre[body];
  measure(dyn, body, list, n, &mid);
  for (int i = 0; i < b->n_knots; i++) *sv_bodies_knot(b, body, i) = SV_RIGID_IDENTITY;
  find_past(dyn, body, list, n, span.to, px_per_unit);
  const sv_rigid *from = sv_bodies_knot(b, body, span.from);
  sv_rigid *to = sv_bodies_knot(b, body, span.to);
  float x[3], q[4];
  for (int k = 0; k < 3; k++) x[k] = c[k] + from->d[k];
  sv_rigid_apply(motion, from_centre, x, x);
  sv_quat_mul(motion->q, from->q, to->q);
  for (int k = 0; k < 3; k++) to->d[k] = x[k] - c[k];
  for (int p = 0; p < n; p++) {
    sv_dynamic_local_position(dyn, (int)list[p], &mid, x, q);
    sv_dynamic_attach(dyn, (int)list[p], body, x, q);
  }
}

// --- who joins -----------------------------------------------------------------------------------

// Squared pixels by which y is off from where o was seen to go.
static float off2(const sv_displaced *o, const float y[3]) {
  const float *a = o->a,
              e[3] = {y[0] - o->x[0] - o->u[0], y[1] - o->x[1] - o->u[1], y[2] - o->x[2] - o->u[2]};
  return a[0] * e[0] * e[0] + a[3] * e[1] * e[1] + a[5] * e[2] * e[2] +
         2 * (a[1] * e[0] * e[1] + a[2] * e[0] * e[2] + a[4] * e[1] * e[2]);
}

// The nearby body whose motion fits that of Gaussian i; 0: none.
static int body_of(const sv_dynamic *dyn, int i, int i_from, int i_to) {
  const sv_bodies *b = &dyn->deform.motion.bodies;
  const sv_displaced *o = &dyn->near->of[i];
  float least = TOLERANCE_PX * TOLERANCE_PX, x[3], y[3];
  int best = 0;
  for (int body = 1; body < b->n; body++) {
    const float *c = b->centre[body];
    float r2 = 0;
    sv_rigid_undo(sv_bodies_knot(b, body, i_from), c, o->x, x);
    for (int k = 0; k < 3; k++) r2 += (x[k] - c[k]) * (x[k] - c[k]);
    if (r2 > NEAR_RADII * NEAR_RADII * b->radius[body] * b->radius[body]) continue;
    sv_rigid_apply(sv_bodies_knot(b, body, i_to), c, x, y);
    float here = off2(o, y);
    if (here < least) {
      least = here;
      best = body;
    }
  }
  return best;
}

// Who was seen to go with a body, and far, becomes one of its members.
static void join(sv_dynamic *dyn, int i_from, int i_to) {
  sv_bodies *b = &dyn->deform.motion.bodies;
  const sv_motion_values f = sv_motion_values_at(&dyn->deform.motion.cfg, b->time[i_from]);
  for (int p = 0; p < dyn->near->n; p++) {
    const int i = (int)dyn->near->order[p];
    const sv_displaced *o = &dyn->near->of[i];
    if (b->of[i] || !o->is_known || off2(o, o->x) < JOIN_PX * JOIN_PX) continue;
    const int body = body_of(dyn, i, i_from, i_to);
    if (!body) continue;
    const sv_rigid *from = sv_bodies_knot(b, body, i_from);
    const float back[4] = {from->q[0], -from->q[1], -from->q[2], -from->q[3]};
    float x[3], q[4], own[4];
    sv_dynamic_local_position(dyn, i, &f, x, own);
    sv_quat_mul(back, own, q);
    sv_rigid_undo(from, b->centre[body], o->x, x);
    sv_dynamic_attach(dyn, i, body, x, q);
  }
}

void sv_dynamic_match_bodies(sv_dynamic *dyn, float from, float to, float px_per_unit) {
  sv_bodies *b = &dyn->deform.motion.bodies;
  if (!b->of) return;
  const int i_from = sv_bodies_find_knot(b, from), i_to = sv_bodies_find_knot(b, to);
  if (i_from < 0 || i_to < 0) return;
  track_known(dyn, i_from, i_to);
  join(dyn, i_from, i_to);
  const int room = sv_mini(dyn->cfg.n_bodies, SV_CAP_BODIES - 1) + 1 - b->n;
  if (room < 1) return;
  sv_rigid motion[SV_CAP_BODIES];
  float centre[SV_CAP_BODIES][3];
  const sv_rigid_search s = {.of = dyn->near->of,
                             .order = dyn->near->order,
                             .label = b->of,
                             .list = (uint32_t *)dyn->near->tmp,
                             .n = dyn->near->n,
                             .first_label = b->n,
                             .cap_bodies = room,
                             .min_members = MIN_MEMBERS,
                             .min_px = MIN_PX,
                             .tolerance_px = TOLERANCE_PX,
                             .seed = dyn->t->cfg.seed};
  const int n = sv_rigid_find(&s, motion, centre), first = b->n;
  b->n += n;
  for (int k = 0; k < n; k++)
    make_body(dyn, first + k, &motion[k], centre[k], (knot_span){i_from, i_to}, px_per_unit);
}
