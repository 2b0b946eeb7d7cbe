// SPDX-License-Identifier: Apache-2.0
// Tracking rigid bodies from the model to the picture: at a new time a body is expected where its
// motion takes it. What the model looks like there has the body's turn and size, so patches of the
// rendering around its members are found in the picture close by, and how they are displaced says
// by what the expected pose was off. What leaves the picture hardly better explained than the
// expected pose is not taken.
#include <string.h>

#include "src/base/mathx.h"
#include "src/dynamic/patch.h"
#include "src/dynamic/rigid.h"
#include "src/dynamic/bodies.h"
#include "src/train/step.h"

#define BETTER          0.7f  // a place must differ so much less than the expected one
#define DAMPING         1e-4f // of the mean diagonal
#define MAX_RADII       4.0f  // of a body: it is not off by more
#define KEPT            0.9f  // of the mismatch at the expected pose: what leaves more is not taken
#define MIN_AGREE       8
#define MIN_SHARE       0.3f // of those that were found
#define BLOCKS_PER_TASK 4

typedef struct {
  int reach;                   // pixels that are searched
  float wide_px, tolerance_px; // of the fit, first and last
} round_of;

// The last only looks what is left.
enum { N_ROUNDS = 3 };
static const round_of ROUNDS[N_ROUNDS + 1] = {{16, 8, 1.5f}, {4, 2, 1}, {2, 1.4f, 0.7f}, {0, 0, 0}};

typedef struct {
  sv_dynamic *dyn;
  sv_view view;
  int reach;
} job;

// Displacement in pixels from the rendering to the image at (x, y). off_by: adds the mismatch
// without it.
static bool find(const job *j, int x, int y, float d[2], float *off_by) {
  const sv_image_patch a = {&j->dyn->t->render.rgb, x, y};
  sv_image_patch b = {&j->dyn->t->target, x, y};
  if (sv_patch_texture(a.image, x, y) < SV_PATCH_MIN_TEXTURE) return false;
  const float here = sv_patch_mismatch(a, b, 1e30f);
  *off_by += here;
  if (!j->reach) return false;
  const float best = sv_patch_search(a, &b, j->reach);
  const int off = sv_maxi(sv_maxi(b.x - x, x - b.x), sv_maxi(b.y - y, y - b.y));
  if (off == j->reach || (off > 1 && best > BETTER * here)) return false;
  sv_patch_offset(a, b, d);
  d[0] += (float)(b.x - x);
  d[1] += (float)(b.y - y);
  return true;
}

static void place(const sv_dynamic *dyn, int i, float x[3]) {
  const sv_motion *mo = &dyn->deform.motion;
  for (int k = 0; k < 3; k++)
    x[k] = mo->moved[((long)(i >> 4) * dyn->t->g.n_rows + SV_ROW_MEAN + k) * 16 + (i & 15)];
}

static void track_slot(const job *j, int i) {
  sv_dynamic *dyn = j->dyn;
  float x[3], px[2], jac[6], z, d[2];
  if (!dyn->deform.motion.bodies.of[i] ||
      !(*sv_gaussians_at(&dyn->t->g, i, SV_ROW_LOGIT) > SV_PATCH_MIN_LOGIT))
    return;
  place(dyn, i, x);
  if (!sv_patch_project(&j->view, x, px, &z, jac)) return;
  if (!(px[0] >= 0 && px[0] < (float)j->view.width_px && px[1] >= 0 && px[1] < (float)j->view.height_px))
    return;
  const int u = (int)px[0], v = (int)px[1];
  if (!sv_patch_is_inside(&dyn->t->target, u, v) || !sv_patch_is_in_front(&dyn->t->render, u, v, z) ||
      !find(j, u, v, d, &dyn->share[i]))
    return;
  sv_match_add(&dyn->match[i], jac, d);
}

static void track_task(void *arg, int i_task, int i_thread) {
  const job *j = arg;
  (void)i_thread;
  const int i1 = sv_mini(16 * BLOCKS_PER_TASK * (i_task + 1), j->dyn->deform.motion.n_moving);
  for (int i = 16 * BLOCKS_PER_TASK * i_task; i < i1; i++) track_slot(j, i);
}

static sv_status match_view(sv_dynamic *dyn, int i_view, int reach, float progress) {
  const sv_train_view *v = &dyn->t->views[i_view];
  const sv_render_options o = sv_train_render_options(dyn->t, progress, true);
  const int n_blocks = (dyn->deform.motion.n_moving + 15) / 16;
  const int k = sv_patch_scale(&v->view, dyn->usual_fx_px);
  job j = {.dyn = dyn, .view = sv_view_scaled(&v->view, k), .reach = reach};
  sv_train_set_time(dyn->t, v->view.time);
  sv_train_load_image(dyn->t, &v->image, k, o.bg, &dyn->t->target);
  sv_status s = sv_render(&dyn->t->render, &dyn->t->g, &j.view, &o);
  if (s >= 0)
    sv_pool_run(dyn->t->compute.pool, track_task, &j, (n_blocks + BLOCKS_PER_TASK - 1) / BLOCKS_PER_TASK);
  return s;
}

// All pictures of a time: dyn->match and, in dyn->share, the mismatch of each member.
static sv_status look_all(sv_dynamic *dyn, float time, int reach, float progress) {
  sv_status s = SV_OK;
  memset(dyn->match, 0, (size_t)dyn->t->g.cap * sizeof *dyn->match);
  memset(dyn->share, 0, (size_t)dyn->t->g.cap * sizeof *dyn->share);
  for (int i = 0; i < dyn->t->n_views && s >= 0; i++)
    if (dyn->t->views[i].view.time == time) s = match_view(dyn, i, reach, progress);
  return s;
}

// --- poses ---------------------------------------------------------------------------------------

// Body-local displacement of Gaussian i.
static void fill(sv_dynamic *dyn, int i, const sv_rigid *pose, const float c[3]) {
  sv_displaced *o = &dyn->near->of[i];
  const sv_match_sum *s = &dyn->match[i];
  float x[3], d[3], a[6];
  o->is_known = false;
  if (!s->n) return;
  place(dyn, i, x);
  sv_rigid_undo(pose, c, x, o->x);
  memcpy(a, s->a, sizeof a);
  const float ridge = DAMPING * 0.5f * (a[0] + a[3] + a[5]) + 1e-20f;
  a[0] += ridge;
  a[3] += ridge;
  a[5] += ridge;
  if (!sv_solve3(a, s->b, d)) return;
  for (int k = 0; k < 6; k++) o->a[k] = a[k] / (float)s->n;
  for (int k = 0; k < 3; k++) o->u[k] = x[k] + d[k] - o->x[k];
  o->is_known = true;
}

static bool is_far(const sv_rigid *a, const sv_rigid *b, float most) {
  const float d[3] = {a->d[0] - b->d[0], a->d[1] - b->d[1], a->d[2] - b->d[2]};
  return d[0] * d[0] + d[1] * d[1] + d[2] * d[2] > most * most;
}

static void move_body(sv_dynamic *dyn, int body, int i_knot, const round_of *r) {
  sv_bodies *b = &dyn->deform.motion.bodies;
  sv_rigid *knot = sv_bodies_knot(b, body, i_knot), m = *knot;
  uint32_t *list = (uint32_t *)dyn->near->tmp;
  int n = 0, n_inliers = 0;
  for (int i = 0; i < dyn->deform.motion.n_moving; i++) {
    if (b->of[i] != body) continue;
    fill(dyn, i, knot, b->centre[body]);
    if (dyn->near->of[i].is_known) list[n++] = (uint32_t)i;
  }
  if (n < MIN_AGREE) return;
  for (float px = r->wide_px;; px = sv_maxf(0.5f * px, r->tolerance_px)) {
    if (!sv_rigid_fit(&(sv_rigid_points){dyn->near->of, list, n, b->centre[body]}, px, &m, &m, &n_inliers))
      return;
    if (px <= r->tolerance_px) break;
  }
  if (n_inliers < MIN_AGREE || (float)n_inliers < MIN_SHARE * (float)n) return;
  if (!is_far(&m, knot, MAX_RADII * b->radius[body])) *knot = m;
}

// Mean mismatch of each body's members that are seen, as they are drawn; no one seen: much.
static void mismatches(const sv_dynamic *dyn, float out[SV_CAP_BODIES]) {
  const sv_bodies *b = &dyn->deform.motion.bodies;
  float n[SV_CAP_BODIES] = {0};
  memset(out, 0, SV_CAP_BODIES * sizeof *out);
  for (int i = 0; i < dyn->deform.motion.n_moving; i++)
    if (b->of[i] && dyn->share[i] > 0) {
      out[b->of[i]] += dyn->share[i];
      n[b->of[i]] += 1;
    }
  for (int body = 0; body < b->n; body++) out[body] = n[body] > 0 ? out[body] / n[body] : 1e30f;
}

sv_status sv_dynamic_track_bodies(sv_dynamic *dyn, float time, float progress) {
  const sv_bodies *b = &dyn->deform.motion.bodies;
  const int i_knot = b->n > 1 ? sv_bodies_find_knot(b, time) : -1;
  sv_rigid expected[SV_CAP_BODIES];
  float before[SV_CAP_BODIES], after[SV_CAP_BODIES];
  if (i_knot < 0 || time == dyn->t->reference_time) return SV_OK; // there they rest
  for (int body = 1; body < b->n; body++) expected[body] = *sv_bodies_knot(b, body, i_knot);
  for (int round = 0; round <= N_ROUNDS; round++) {
    sv_status s = look_all(dyn, time, ROUNDS[round].reach, progress);
    if (s < 0) return s;
    if (round == 0) mismatches(dyn, before);
    for (int body = 1; body < b->n && round < N_ROUNDS; body++) move_body(dyn, body, i_knot, &ROUNDS[round]);
  }
  mismatches(dyn, after);
  for (int body = 1; body < b->n; body++)
    if (!(after[body] < KEPT * before[body])) *sv_bodies_knot(b, body, i_knot) = expected[body];
  return SV_OK;
}
