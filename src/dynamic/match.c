// SPDX-License-Identifier: Apache-2.0
// Patch matching: when a time enters the curriculum, its images tell how the Gaussians moved since
// the neighboring time.
//
// Each Gaussian in front takes the patch of the old image around it and searches the new image for
// it: sum of squared differences over the patch at all positions within a radius, then a parabola
// through the three best along x and y (Lucas & Kanade's residual, searched instead of linearized,
// as fast objects move by more than their texture). The search starts at the old position and at
// the predicted one. One displacement in space is solved from what all cameras of a Gaussian saw,
// damped along directions that no camera determines. Gaussians that no camera saw, and outliers
// among neighbors, take their neighbors' displacement (local_motion.h). The basis coefficients are
// then fitted to pass through the new position with the smallest change at the times before.
#include <string.h>

#include "src/base/mathx.h"
#include "src/splat/constants.h"
#include "src/dynamic/patch.h"
#include "src/dynamic/match.h"
#include "src/dynamic/bodies.h"
#include "src/dynamic/curriculum.h"
#include "src/dynamic/search.h"
#include "src/train/step.h"

#define REACH        10    // 1/REACH of the larger side is searched
#define STILL        0.25f // times that: within half a pixel of where it was
#define MAX_MISMATCH 2.0f  // times that: worse matches are rejected
#define BETTER       0.5f  // the best mismatch is at most this share of that at the old position
#define BACK_PX      1     // the backward match returns to the old position within so much
#define MIN_PX       0.3f  // smaller displacements are left to the gradients
#define MOVES_PX     1.0f  // a static Gaussian displaced by more becomes moving
#define APART_PX     2.0f  // cameras that disagree by more have wrong matches
#define DISAGREES_PX 2.0f  // from its neighbors: the match is wrong
#define FAR_PX       1e4f  // larger than any image
// of the mean diagonal: undetermined directions keep the predicted motion
#define DAMPING         0.01f
#define FREE_DAMPING    1e-4f // for bodies, which all of their members determine together
#define SMOOTHNESS      1e-3  // weight of a function's coefficient, times its number squared
#define BLOCKS_PER_TASK 4

#define CAP_TERMS (1 + SV_CAP_MOTION_FUNCTIONS)

typedef struct {
  sv_dynamic *dyn;
  sv_planes prev, next; // reduced
  sv_view from, to;
  sv_motion_values f;           // at the new time
  float gain[CAP_TERMS];        // of the mean and the coefficients, for a displacement of 1
  sv_motion_values f_before;    // at the time before the last
  sv_rigid body[SV_CAP_BODIES]; // at the new time, as expected
  float lead; // from the last to the new time, in spans from the time before to the last; 0: none
              // before
  int n_blocks, reach;
  float px_per_unit; // at the scene's centre
} job;

// --- matching ------------------------------------------------------------------------------------

static int abs_i(int x) { return x < 0 ? -x : x; }

// Moves b to the best match for a near it. False: the backward match from there misses a.
static bool match_near(sv_image_patch a, sv_image_patch *b, int reach, float *mismatch) {
  const int dx = b->x - a.x, dy = b->y - a.y;
  *mismatch = sv_patch_search(a, b, reach);
  if (!sv_patch_is_inside(b->image, b->x, b->y)) return false;
  sv_image_patch back = {a.image, b->x - dx, b->y - dy};
  sv_patch_search(*b, &back, reach);
  return abs_i(back.x - a.x) <= BACK_PX && abs_i(back.y - a.y) <= BACK_PX;
}

// Displacement d of the patch at (x, y) of the old image: none, or to the best match near it or
// near its predicted position (by p). False: unknown.
static bool match_patch(const job *j, int x, int y, const float p[2], float d[2]) {
  const sv_image_patch a = {&j->prev, x, y};
  sv_image_patch b = {&j->next, x, y};
  const float texture = sv_patch_texture(&j->prev, x, y);
  if (texture < SV_PATCH_MIN_TEXTURE) return false;
  const float here = sv_patch_mismatch(a, b, 1e30f);
  if (here > STILL * texture) {
    float best, ahead = 1e30f;
    sv_image_patch b2 = {&j->next, x + (int)floorf(p[0] + 0.5f), y + (int)floorf(p[1] + 0.5f)};
    bool is_found = match_near(a, &b, j->reach, &best);
    bool is_ahead = b2.x != x || b2.y != y ? match_near(a, &b2, j->reach / 2, &ahead) : false;
    if (is_ahead && (!is_found || ahead <= best)) {
      is_found = true;
      best = ahead;
      b = b2;
    }
    if (!is_found || best > MAX_MISMATCH * texture || ((b.x != x || b.y != y) && best > BETTER * here))
      return false;
  }
  d[0] = (float)(b.x - x);
  d[1] = (float)(b.y - y);
  float more[2];
  sv_patch_offset(a, b, more);
  d[0] += more[0];
  d[1] += more[1];
  return true;
}

// --- one camera ----------------------------------------------------------------------------------

// Positions of Gaussian i at the time of the last image, and predicted by its motion at the new
// time.
static void predict_position(const job *j, int i, float now[3], float then[3]) {
  const sv_dynamic *dyn = j->dyn;
  const sv_motion *mo = &dyn->deform.motion;
  const bool is_moving = i < mo->n_moving;
  for (int k = 0; k < 3; k++) {
    then[k] = *sv_gaussians_at(&dyn->t->g, i, SV_ROW_MEAN + k);
    now[k] = is_moving ? mo->moved[((long)(i >> 4) * dyn->t->g.n_rows + SV_ROW_MEAN + k) * 16 + (i & 15)]
                       : then[k];
    for (int f = 0; f < mo->cfg.n_pos && is_moving; f++)
      then[k] += j->f.pos[f] * *sv_motion_row(mo, i, SV_MROW_FUNCTIONS + 3 * f + k);
  }
  const int body = sv_dynamic_body_of(dyn, i);
  if (body) sv_rigid_apply(&j->body[body], mo->bodies.centre[body], then, then);
}

// Displacement in pixels of Gaussian i at the new time, extrapolated from its motion between the
// two times before.
static void extrapolate(const job *j, int i, const float now[3], const float px[2], float ahead[2]) {
  const sv_dynamic *dyn = j->dyn;
  const sv_motion *mo = &dyn->deform.motion;
  float x[3], to[2], z;
  ahead[0] = ahead[1] = 0;
  if (i >= mo->n_moving || !(j->lead > 0)) return;
  for (int k = 0; k < 3; k++) {
    x[k] = *sv_gaussians_at(&dyn->t->g, i, SV_ROW_MEAN + k);
    for (int f = 0; f < mo->cfg.n_pos; f++)
      x[k] += j->f_before.pos[f] * *sv_motion_row(mo, i, SV_MROW_FUNCTIONS + 3 * f + k);
  }
  const int body = sv_dynamic_body_of(dyn, i);
  if (body) predict_position(j, i, (float[3]){0}, x);
  else
    for (int k = 0; k < 3; k++) x[k] = now[k] + j->lead * (now[k] - x[k]);
  if (!sv_patch_project(&j->to, x, to, &z, NULL)) return;
  for (int k = 0; k < 2; k++) ahead[k] = fabsf(to[k] - px[k]) < FAR_PX ? to[k] - px[k] : 0;
}

void sv_match_add(sv_match_sum *s, const float jac[6], const float r[2]) {
  for (int e = 0; e < 2; e++) {
    const float *g = jac + 3 * e;
    const float a[6] = {g[0] * g[0], g[0] * g[1], g[0] * g[2], g[1] * g[1], g[1] * g[2], g[2] * g[2]};
    for (int k = 0; k < 6; k++) s->a[k] += a[k];
    for (int k = 0; k < 3; k++) s->b[k] += g[k] * r[e];
    s->r2 += r[e] * r[e];
  }
  s->n++;
}

static void match_gaussian(const job *j, int i) {
  sv_match_sum *s = &j->dyn->match[i];
  float now[3], then[3], px[2], at[2], ahead[2], jac[6], z, d[2];
  if (!(*sv_gaussians_at(&j->dyn->t->g, i, SV_ROW_LOGIT) > SV_PATCH_MIN_LOGIT)) return;
  predict_position(j, i, now, then);
  if (!sv_patch_project(&j->from, now, px, &z, NULL)) return;
  if (!(px[0] >= 0 && px[0] < (float)j->prev.width_px && px[1] >= 0 && px[1] < (float)j->prev.height_px))
    return;
  int x = (int)px[0], y = (int)px[1];
  if (!sv_patch_is_inside(&j->prev, x, y) || !sv_patch_is_in_front(&j->dyn->t->render, x, y, z)) return;
  extrapolate(j, i, now, px, ahead);
  if (!match_patch(j, x, y, ahead, d)) return;
  if (!sv_patch_project(&j->to, then, at, &z, jac)) return;
  const float r[2] = {px[0] + d[0] - at[0], px[1] + d[1] - at[1]};
  sv_match_add(s, jac, r);
}

static void match_task(void *arg, int i_task, int i_thread) {
  const job *j = arg;
  (void)i_thread;
  int i1 = sv_mini(16 * BLOCKS_PER_TASK * (i_task + 1), j->dyn->t->g.n);
  for (int i = 16 * BLOCKS_PER_TASK * i_task; i < i1; i++) match_gaussian(j, i);
}

static sv_status match_views(job *j, int i_from, int i_to, float progress) {
  sv_dynamic *dyn = j->dyn;
  const sv_train_view *a = &dyn->t->views[i_from], *b = &dyn->t->views[i_to];
  const int k = sv_patch_scale(&a->view, dyn->usual_fx_px), k_size = sv_patch_scale(&a->view, 0);
  sv_render_options o = sv_train_render_options(dyn->t, progress, true);
  j->from = sv_view_scaled(&a->view, k);
  j->to = sv_view_scaled(&b->view, k);
  j->reach = sv_maxi(a->view.width_px, a->view.height_px) / k_size / REACH;
  sv_train_set_time(dyn->t, a->view.time);
  // The two images lie in the planes of a step's target and gradient, which are cleared afterwards.
  sv_train_load_image(dyn->t, &a->image, k, o.bg, &dyn->t->target);
  sv_train_load_image(dyn->t, &b->image, k, o.bg, &dyn->t->grad);
  sv_status s = sv_render(&dyn->t->render, &dyn->t->g, &j->from, &o);
  j->prev = dyn->t->target;
  j->next = dyn->t->grad;
  if (s >= 0)
    sv_pool_run(dyn->t->compute.pool, match_task, j, (j->n_blocks + BLOCKS_PER_TASK - 1) / BLOCKS_PER_TASK);
  return s;
}

// --- displacement --------------------------------------------------------------------------------

// Displacement in pixels, as the cameras see it, from the position by motion; -1: unknown.
static float displacement(const sv_match_sum *s, float damping, float d[3]) {
  float a[6], most = 0;
  if (!s->n) return -1;
  memcpy(a, s->a, sizeof a);
  float ridge = damping * 0.5f * (a[0] + a[3] + a[5]) + 1e-20f;
  a[0] += ridge;
  a[3] += ridge;
  a[5] += ridge;
  if (!sv_solve3(a, s->b, d)) return -1;
  float fit = d[0] * s->b[0] + d[1] * s->b[1] + d[2] * s->b[2];
  if (s->r2 - fit > APART_PX * APART_PX * (float)s->n) return -1;
  most = fit / (float)s->n;
  return most > 0 ? sqrtf(most) : 0;
}

static void fit_coefficients(const job *j, int i, const float d[3]) {
  const sv_motion *mo = &j->dyn->deform.motion;
  for (int k = 0; k < 3; k++) {
    *sv_gaussians_at(&j->dyn->t->g, i, SV_ROW_MEAN + k) += j->gain[0] * d[k];
    for (int f = 0; f < mo->cfg.n_pos; f++)
      *sv_motion_row(mo, i, SV_MROW_FUNCTIONS + 3 * f + k) += j->gain[1 + f] * d[k];
  }
}

// --- neighbours ----------------------------------------------------------------------------------

// Displacements of all Gaussians, damped along undetermined directions.
static void fill(const job *j, float damping) {
  sv_dynamic *dyn = j->dyn;
  for (int i = 0; i < dyn->t->g.n; i++) {
    sv_displaced *o = &dyn->near->of[i];
    const sv_match_sum *s = &dyn->match[i];
    float d[3] = {0}, then[3], px = displacement(s, damping, d);
    predict_position(j, i, o->x, then);
    o->is_known = px >= 0;
    for (int k = 0; k < 3 && o->is_known; k++) o->u[k] = then[k] + d[k] - o->x[k];
    for (int k = 0; k < 6 && o->is_known; k++) o->a[k] = s->a[k] / (float)s->n;
  }
}

// Neighbors of the Gaussians to be matched, with their displacements.
static void make_neighbours(const job *j) {
  sv_dynamic *dyn = j->dyn;
  int n = 0;
  for (int i = 0; i < dyn->t->g.n; i++) {
    float d[3] = {0}, px = displacement(&dyn->match[i], DAMPING, d);
    if (dyn->is_moving[i] || px >= MOVES_PX) dyn->near->order[n++] = (uint32_t)i;
  }
  sv_local_motion_find(dyn->near, dyn->t->compute.k, n, dyn->t->centre, dyn->t->radius);
}

// Displacement of Gaussian i. Where no camera saw it, or it is an outlier among its neighbors, it
// is interpolated from them.
static float consensus(const job *j, int i, float d[3]) {
  const sv_displaced *o = &j->dyn->near->of[i];
  float px = displacement(&j->dyn->match[i], DAMPING, d), now[3], then[3], u[3], off2 = 0, d2 = 0;
  if (!j->dyn->is_moving[i] || !sv_local_motion_interpolate(j->dyn->near, i, u)) return px;
  for (int k = 0; k < 3; k++) off2 += (u[k] - o->u[k]) * (u[k] - o->u[k]);
  if (o->is_known && j->px_per_unit * sqrtf(off2) < DISAGREES_PX) return px;
  predict_position(j, i, now, then);
  for (int k = 0; k < 3; k++) {
    d[k] = now[k] + u[k] - then[k];
    d2 += d[k] * d[k];
  }
  return j->px_per_unit * sqrtf(d2);
}

static void fit_task(void *arg, int i_task, int i_thread) {
  const job *j = arg;
  sv_dynamic *dyn = j->dyn;
  (void)i_thread;
  int i1 = sv_mini(16 * BLOCKS_PER_TASK * (i_task + 1), dyn->t->g.n);
  for (int i = 16 * BLOCKS_PER_TASK * i_task; i < i1; i++) {
    if (sv_dynamic_body_of(dyn, i)) continue; // goes with its body
    float d[3], px = consensus(j, i, d);
    if (px < (dyn->is_moving[i] ? MIN_PX : MOVES_PX)) continue;
    if (!dyn->is_moving[i]) {
      dyn->is_moving[i] = 2;
      sv_motion_rest(&dyn->deform.motion, i);
    }
    fit_coefficients(j, i, d);
  }
}

// --- basis coefficients --------------------------------------------------------------------------

static bool is_first_of_its_time(const sv_dynamic *dyn, int i) {
  for (int k = 0; k < i; k++)
    if (dyn->t->views[k].view.time == dyn->t->views[i].view.time) return false;
  return true;
}

// a x = b in place, a positive definite: no pivots.
static void solve(int m, double a[CAP_TERMS][CAP_TERMS], double x[CAP_TERMS]) {
  for (int p = 0; p < m; p++)
    for (int q = p + 1; q < m; q++) {
      double w = a[q][p] / a[p][p];
      for (int r = p; r < m; r++) a[q][r] -= w * a[p][r];
      x[q] -= w * x[p];
    }
  for (int p = m - 1; p >= 0; p--) {
    for (int q = p + 1; q < m; q++) x[p] -= a[p][q] * x[q];
    x[p] /= a[p][p];
  }
}

// Change of the mean and the coefficients for a displacement of 1 at the new time: least at all
// times before, and the less the higher the function. n: functions in use.
static void make_gain(job *j, float new_time, float progress, int n) {
  const sv_dynamic *dyn = j->dyn;
  const sv_motion_cfg *mc = &dyn->deform.motion.cfg;
  const int m = 1 + n;
  double a[CAP_TERMS][CAP_TERMS] = {{0}}, x[CAP_TERMS], at = 0;
  float f[CAP_TERMS] = {1.0f};
  for (int p = 0; p < m; p++) a[p][p] = SMOOTHNESS * (p * p) + 1e-9;
  for (int i = 0; i < dyn->t->n_views; i++) {
    float time = dyn->t->views[i].view.time;
    if (time == new_time || !sv_dynamic_has_time(dyn, time, progress) || !is_first_of_its_time(dyn, i))
      continue;
    sv_motion_functions(mc, mc->n_pos, time, f + 1);
    for (int p = 0; p < m; p++)
      for (int q = 0; q < m; q++) a[p][q] += (double)f[p] * (double)f[q];
  }
  sv_motion_functions(mc, mc->n_pos, new_time, f + 1);
  for (int p = 0; p < m; p++) x[p] = (double)f[p];
  solve(m, a, x);
  for (int p = 0; p < m; p++) at += (double)f[p] * x[p];
  memset(j->gain, 0, sizeof j->gain);
  for (int p = 0; p < m; p++) j->gain[p] = (float)(x[p] / at);
}

// --- a new time ----------------------------------------------------------------------------------

// The time next to it that was there before; -1: none.
static float neighbour_of(const sv_dynamic *dyn, float time, float before) {
  float best = -1;
  for (int i = 0; i < dyn->t->n_views; i++) {
    float here = dyn->t->views[i].view.time;
    if (here != time && sv_dynamic_has_time(dyn, here, before) &&
        (best < 0 || fabsf(here - time) < fabsf(best - time)))
      best = here;
  }
  return best;
}

static void set_lead(job *j, float from, float to, float before) {
  const sv_dynamic *dyn = j->dyn;
  float last = -1;
  for (int i = 0; i < dyn->t->n_views; i++) {
    float here = dyn->t->views[i].view.time;
    bool is_before = to > from ? here < from : here > from;
    if (is_before && sv_dynamic_has_time(dyn, here, before) &&
        (last < 0 || fabsf(here - from) < fabsf(last - from)))
      last = here;
  }
  j->lead = last < 0 ? 0 : (to - from) / (from - last);
  if (last >= 0) j->f_before = sv_motion_values_at(&dyn->deform.motion.cfg, last);
}

static sv_status follow_to(sv_dynamic *dyn, float from, float to, float progress) {
  job j = {.dyn = dyn, .n_blocks = (dyn->t->g.n + 15) / 16};
  sv_bodies_at(&dyn->deform.motion.bodies, to, j.body);
  memset(dyn->match, 0, (size_t)dyn->t->g.cap * sizeof *dyn->match);
  j.f = sv_motion_values_at(&dyn->deform.motion.cfg, to);
  set_lead(&j, from, to, progress);
  make_gain(&j, to, progress, sv_dynamic_n_functions(dyn, progress));
  for (int a = 0; a < dyn->t->n_views; a++)
    for (int b = 0; b < dyn->t->n_views; b++) {
      const sv_view *p = &dyn->t->views[a].view, *q = &dyn->t->views[b].view;
      if (p->time != from || q->time != to || p->i_sub_view != q->i_sub_view) continue;
      if (p->width_px != q->width_px || p->height_px != q->height_px) continue;
      sv_status s = match_views(&j, a, b, progress);
      if (s < 0) return s;
    }
  sv_planes_clear(&dyn->t->grad);
  float px[2], z;
  j.px_per_unit =
      j.to.fx / (sv_patch_project(&j.to, dyn->t->centre, px, &z, NULL) ? sv_maxf(z, 0.1f * dyn->t->radius)
                                                                       : dyn->t->radius);
  fill(&j, FREE_DAMPING);
  make_neighbours(&j);
  sv_dynamic_match_bodies(dyn, from, to, j.px_per_unit);
  fill(&j, DAMPING);
  sv_pool_run(dyn->t->compute.pool, fit_task, &j, (j.n_blocks + BLOCKS_PER_TASK - 1) / BLOCKS_PER_TASK);
  sv_dynamic_sort(dyn);
  return SV_OK;
}

sv_status sv_dynamic_match(sv_dynamic *dyn, float before, float progress) {
  if (!dyn->match || dyn->deform.kind != SV_DEFORM_CLIP) return SV_OK;
  for (int i = 0; i < dyn->t->n_views; i++) {
    float time = dyn->t->views[i].view.time;
    if (sv_dynamic_has_time(dyn, time, before) || !sv_dynamic_has_time(dyn, time, progress) ||
        !is_first_of_its_time(dyn, i))
      continue;
    float from = neighbour_of(dyn, time, before);
    if (from < 0) continue;
    sv_dynamic_extrapolate_bodies(dyn, time, before);
    sv_status s = sv_dynamic_track_bodies(dyn, time, progress);
    if (s >= 0) s = follow_to(dyn, from, time, progress);
    if (s < 0) return s;
  }
  return SV_OK;
}
