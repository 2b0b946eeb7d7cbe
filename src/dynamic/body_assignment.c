// SPDX-License-Identifier: Apache-2.0
// Whose part a Gaussian is, as the pictures say: what goes with a body meets its own colour
// wherever the body takes it.
//
// In a search for what moves (moving.c), which looks at all pictures anyway, the colour of each
// Gaussian that is seen is compared with the pictures' at the places where it is, and where it
// would be as a part of the bodies near it (or, being a part, at rest), at the times at which its
// window is open. A motion that clearly leaves less of a difference is taken over: what was
// followed by too few patches to be a part becomes one, what lies behind is let go.
#include <string.h>

#include "src/base/mathx.h"
#include "src/splat/constants.h"
#include "src/dynamic/patch.h"
#include "src/dynamic/bodies.h"

#define NEAR_RADII      8.0f  // of a body: its parts are no farther
#define HIDDEN          0.02f // of the depth: what is farther than what is seen by so much
#define MAX_OFF         0.6f  // a difference, summed over the colours, counts no more
#define MIN_LOOKS       6.0f  // pictures that tell
#define BETTER          0.7f  // of the difference as it is: another motion leaves less
#define MIN_BETTER      0.03f // and by so much
#define BLOCKS_PER_TASK 4

// --- whom it may be a part of --------------------------------------------------------------------

static bool has_bodies(const sv_dynamic *dyn) {
  return dyn->deform.kind == SV_DEFORM_CLIP && dyn->deform.motion.bodies.n > 1;
}

// The knot nearest to the center of a Gaussian's window.
static int knot_of(const sv_dynamic *dyn, int i) {
  const sv_bodies *b = &dyn->deform.motion.bodies;
  const float at =
      i < dyn->deform.motion.n_moving ? *sv_motion_row(&dyn->deform.motion, i, SV_MROW_CENTRE) : 0.5f;
  int best = 0;
  for (int k = 1; k < b->n_knots; k++)
    if (fabsf(b->time[k] - at) < fabsf(b->time[best] - at)) best = k;
  return best;
}

static void add_near(sv_body_assignment *m, float d[SV_DYNAMIC_NEAR_BODIES], int body, float here) {
  int at = SV_DYNAMIC_NEAR_BODIES - 1;
  if (m->body[at] && here >= d[at]) return;
  for (; at > 0 && (!m->body[at - 1] || d[at - 1] > here); at--) {
    m->body[at] = m->body[at - 1];
    d[at] = d[at - 1];
  }
  m->body[at] = (uint8_t)body;
  d[at] = here;
}

// Candidates: the present body first, then the nearby ones.
static void begin_slot(sv_dynamic *dyn, int i) {
  const sv_motion *mo = &dyn->deform.motion;
  const sv_bodies *b = &mo->bodies;
  sv_body_assignment *m = &dyn->assignment[i];
  float d[SV_DYNAMIC_NEAR_BODIES] = {0};
  memset(m, 0, sizeof *m);
  if (!(*sv_gaussians_at(&dyn->t->g, i, SV_ROW_LOGIT) > SV_PATCH_MIN_LOGIT)) return;
  const int k = knot_of(dyn, i), of = i < mo->n_moving ? b->of[i] : 0;
  const sv_motion_values f = sv_motion_values_at(&mo->cfg, b->time[k]);
  m->knot = (uint8_t)k;
  sv_dynamic_local_position(dyn, i, &f, m->x, NULL);
  if (of) sv_rigid_apply(sv_bodies_knot(b, of, k), b->centre[of], m->x, m->x);
  for (int body = 1; body < b->n; body++) {
    float x[3], r2 = 0, r = b->radius[body];
    sv_rigid_undo(sv_bodies_knot(b, body, k), b->centre[body], m->x, x);
    for (int e = 0; e < 3; e++) r2 += (x[e] - b->centre[body][e]) * (x[e] - b->centre[body][e]);
    if (body == of) add_near(m, d, body, -1);
    else if (r2 < NEAR_RADII * NEAR_RADII * (r * r)) add_near(m, d, body, r2 / (r * r));
  }
}

void sv_dynamic_begin_assignment(sv_dynamic *dyn) {
  if (!has_bodies(dyn)) return;
  for (int i = 0; i < dyn->t->g.n; i++) begin_slot(dyn, i);
}

// --- looking -------------------------------------------------------------------------------------

typedef struct {
  sv_dynamic *dyn;
  sv_view view;
  float time;
  const sv_rigid *now; // [SV_CAP_BODIES]
} job;

static const float *drawn(const sv_dynamic *dyn, int i, int row) {
  const sv_motion *mo = &dyn->deform.motion;
  const float *p = i < mo->n_moving ? mo->moved : dyn->t->g.param;
  return p + ((long)(i >> 4) * dyn->t->g.n_rows + row) * 16 + (i & 15);
}

static void look_at(const job *j, const float x[3], const float colour[3], float *err, float *n) {
  const sv_dynamic *dyn = j->dyn;
  const sv_planes *p = &dyn->t->target;
  float px[2], z, off = 0;
  if (!sv_patch_project(&j->view, x, px, &z, NULL)) return;
  if (!(px[0] >= 0 && px[0] < (float)p->width_px && px[1] >= 0 && px[1] < (float)p->height_px)) return;
  const long at = (long)(int)px[1] * p->stride + (int)px[0];
  const float alpha = 1.0f - dyn->t->render.trans[at];
  if (alpha > 0.5f && z * alpha > (1.0f + HIDDEN) * dyn->t->render.depth[at]) return;
  for (int c = 0; c < 3; c++) off += fabsf(p->c[c][at] - colour[c]);
  *err += sv_minf(off, MAX_OFF);
  *n += 1;
}

static void look_slot(const job *j, int i) {
  const sv_motion *mo = &j->dyn->deform.motion;
  const sv_bodies *b = &mo->bodies;
  sv_body_assignment *m = &j->dyn->assignment[i];
  const int of = i < mo->n_moving ? b->of[i] : 0;
  float colour[3], x[3], y[3];
  if (!m->body[0]) return;
  if (i < mo->n_moving) {
    const float off = j->time - *sv_motion_row(mo, i, SV_MROW_CENTRE);
    if ((float)sv_exp((double)*sv_motion_row(mo, i, SV_MROW_SHARPNESS)) * (off * off) > 1.0f) return;
  }
  for (int c = 0; c < 3; c++) {
    colour[c] = sv_maxf(0, 0.5f + (float)SV_SH_C0 * *drawn(j->dyn, i, SV_ROW_SH + c));
    x[c] = *drawn(j->dyn, i, SV_ROW_MEAN + c);
  }
  look_at(j, of ? m->x : x, colour, &m->err[0], &m->n[0]);
  for (int k = 0; k < SV_DYNAMIC_NEAR_BODIES && m->body[k]; k++) {
    const int body = m->body[k];
    const float *c = b->centre[body];
    if (body != of) {
      sv_rigid_undo(sv_bodies_knot(b, body, m->knot), c, m->x, y);
      sv_rigid_apply(&j->now[body], c, y, y);
    }
    look_at(j, body == of ? x : y, colour, &m->err[1 + k], &m->n[1 + k]);
  }
}

static void look_task(void *arg, int i_task, int i_thread) {
  const job *j = arg;
  (void)i_thread;
  const int i1 = sv_mini(16 * BLOCKS_PER_TASK * (i_task + 1), j->dyn->t->g.n);
  for (int i = 16 * BLOCKS_PER_TASK * i_task; i < i1; i++) look_slot(j, i);
}

void sv_dynamic_compare_assignment(sv_dynamic *dyn, int i_view) {
  const sv_view *v = &dyn->t->views[i_view].view;
  const int n_blocks = (dyn->t->g.n + 15) / 16;
  job j = {.dyn = dyn, .view = sv_view_scaled(v, v->width_px / dyn->t->target.width_px), .time = v->time};
  if (!has_bodies(dyn)) return;
  j.now = dyn->deform.motion.bodies.now;
  sv_pool_run(dyn->t->compute.pool, look_task, &j, (n_blocks + BLOCKS_PER_TASK - 1) / BLOCKS_PER_TASK);
}

// --- deciding ------------------------------------------------------------------------------------

// The candidate to which Gaussian i is attached, by index of its color differences; -1: unchanged.
static int decide(const sv_dynamic *dyn, int i) {
  const sv_body_assignment *m = &dyn->assignment[i];
  const int now = i < dyn->deform.motion.n_moving && dyn->deform.motion.bodies.of[i] ? 1 : 0;
  if (!(m->n[now] > 0)) return -1;
  const float as_is = m->err[now] / m->n[now];
  float least = sv_minf(BETTER * as_is, as_is - MIN_BETTER);
  int best = -1;
  for (int k = 0; k <= SV_DYNAMIC_NEAR_BODIES; k++) {
    if (k == now || (k && !m->body[k - 1]) || m->n[k] < sv_maxf(MIN_LOOKS, 0.5f * m->n[now])) continue;
    const float here = m->err[k] / m->n[k];
    if (here < least) {
      least = here;
      best = k;
    }
  }
  return best;
}

static void change(sv_dynamic *dyn, int i, int body) {
  const sv_bodies *b = &dyn->deform.motion.bodies;
  const sv_body_assignment *m = &dyn->assignment[i];
  const sv_motion_values f = sv_motion_values_at(&dyn->deform.motion.cfg, b->time[m->knot]);
  const int of = i < dyn->deform.motion.n_moving ? b->of[i] : 0;
  float x[3], q[4], own[4];
  sv_dynamic_local_position(dyn, i, &f, x, own);
  memcpy(q, own, sizeof q);
  if (of) sv_quat_mul(sv_bodies_knot(b, of, m->knot)->q, own, q);
  memcpy(x, m->x, sizeof x);
  if (body) {
    const sv_rigid *at = sv_bodies_knot(b, body, m->knot);
    const float back[4] = {at->q[0], -at->q[1], -at->q[2], -at->q[3]};
    memcpy(own, q, sizeof own);
    sv_quat_mul(back, own, q);
    sv_rigid_undo(at, b->centre[body], x, x);
  }
  sv_dynamic_attach(dyn, i, body, x, q);
}

void sv_dynamic_end_assignment(sv_dynamic *dyn) {
  if (!has_bodies(dyn)) return;
  for (int i = 0; i < dyn->t->g.n; i++) {
    const int k = dyn->assignment[i].body[0] ? decide(dyn, i) : -1;
    if (k >= 0) change(dyn, i, k ? dyn->assignment[i].body[k - 1] : 0);
  }
}
