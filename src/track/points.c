// SPDX-License-Identifier: Apache-2.0
// Life of a point: detected, tracked, triangulated, dropped.
#include <string.h>

#include "src/base/mathx.h"
#include "src/track/tracker.h"

#define COARSE_CORR 0.6f // ignore a level with a lower correlation
#define FOLLOW_CORR 0.8f
#define PARALLAX_PX 4.0  // minimum parallax for a depth
#define WRONG_PX    2.0  // standard deviations: reject a depth that does not fit its observations
#define NEAR_BASE   1.5  // nearest depth searched, in baselines of the two sub-views
#define FAR_BASE    400  // farthest depth searched, in baselines
#define REMATCH     0.08 // search range around a known depth, relative
#define APART_PX    10
#define BACK_PX     1.5f // of the resolution: tolerance of the forward-backward check
#define MATCH_CORR  0.85f
#define MATCH_PX    2.5f // maximum correction of a match by alignment

float sv_track_rank(float *v, int n, int k) {
  if (n < 1) return 0;
  int lo = 0, hi = n - 1;
  while (lo < hi) { // quickselect (Hoare 1961)
    float pivot = v[(lo + hi) / 2];
    int i = lo, j = hi;
    while (i <= j) {
      while (v[i] < pivot) i++;
      while (v[j] > pivot) j--;
      if (i > j) break;
      float s = v[i];
      v[i++] = v[j];
      v[j--] = s;
    }
    if (k <= j) hi = j;
    else if (k >= i) lo = i;
    else break;
  }
  return v[k];
}

int32_t sv_track_add_obs(sv_tracker *t, int32_t i_point, int i_exposure, int i_view, const float uv_px[2],
                         float sigma_px) {
  sv_track_point *p = &t->point[i_point];
  if (t->n_obs == t->cap_obs) {
    t->n_full++;
    return -1;
  }
  int32_t i = t->n_obs++;
  t->obs[i] = (sv_track_obs){.i_point = i_point,
                             .next = -1,
                             .i_exposure = (int16_t)i_exposure,
                             .i_view = (int16_t)i_view,
                             .uv_px = {uv_px[0], uv_px[1]},
                             .sigma_px = sigma_px};
  if (p->last_obs >= 0) t->obs[p->last_obs].next = i;
  else p->first_obs = i;
  p->last_obs = p->now[i_view] = i;
  if (i_exposure == 0) {
    p->uv0_px[i_view][0] = uv_px[0];
    p->uv0_px[i_view][1] = uv_px[1];
    p->has_uv0[i_view] = true;
  }
  return i;
}

// --- tracking -----------------------------------------------------------------------------------

bool sv_track_see(const sv_bundle_camera *c, const sv_pose *rig, const double x[3], double uv[2]) {
  double q[3];
  sv_pose_apply(q, rig, x);
  sv_pose_apply(q, &c->cam_from_rig, (const double[3]){q[0], q[1], q[2]});
  if (!(q[2] > 1e-3)) return false;
  uv[0] = c->fx * q[0] / q[2] + c->cx;
  uv[1] = c->fy * q[1] / q[2] + c->cy;
  return true;
}

// Median depth of the tracked points, in the rig's frame; 0 when none is known.
static double nominal_depth(sv_tracker *t) {
  int n = 0;
  for (int i = 0; i < t->n_live && n < t->cap_found; i++) {
    const sv_track_point *p = &t->point[t->live[i]];
    double q[3];
    if (!p->has_depth) continue;
    sv_pose_apply(q, &t->pose[t->i_last], p->x);
    t->work[n++] = (float)q[2];
  }
  return (double)sv_track_rank(t->work, n, n / 2);
}

// Predicted position of an observation when the rig moves from the last pose to `guess`.
static void expect(const sv_tracker *t, const sv_track_point *p, int v, const sv_pose *guess, double depth,
                   float uv[2]) {
  const sv_pose *last = &t->pose[t->i_last];
  double x[3], a[2], b[2];
  memcpy(x, p->x, sizeof x);
  if (!p->has_depth) {
    if (!(depth > 0)) return;
    double ray[3];
    sv_pose cam = sv_pose_mul(&t->cam[v].cam_from_rig, last), world = sv_pose_inv(&cam);
    sv_track_ray(&t->cam[v], uv, ray);
    for (int i = 0; i < 3; i++) ray[i] *= depth;
    sv_pose_apply(x, &world, ray);
  }
  if (!sv_track_see(&t->cam[v], last, x, a) || !sv_track_see(&t->cam[v], guess, x, b)) return;
  uv[0] += (float)(b[0] - a[0]);
  uv[1] += (float)(b[1] - a[1]);
}

bool sv_track_follow_patch(sv_tracker *t, int i_ref, int v, const float from[2], float uv[2], float warp[4]) {
  for (int l = t->n_levels[v] - 1; l >= 0; l--) {
    sv_track_plane was = sv_track_level(t, false, v, l), now = sv_track_level(t, true, v, l);
    float k = 1.0f / (float)(1 << l), x = uv[0] * k, y = uv[1] * k;
    sv_patch_take_args a = {.src = was.px,
                            .width_px = was.width_px,
                            .height_px = was.height_px,
                            .stride = was.stride,
                            .x = from[0] * k,
                            .y = from[1] * k,
                            .a = {1, 0, 0, 1},
                            .out = t->patch,
                            .has_slopes = true};
    t->k->patch_take(&a);
    float corr = a.is_inside ? sv_track_align(t, &now, &x, &y) : -1.0f;
    if (corr > COARSE_CORR) {
      uv[0] = x * (float)(1 << l);
      uv[1] = y * (float)(1 << l);
    }
  }
  return sv_track_align_affine(t, i_ref, v, uv, warp) >= FOLLOW_CORR &&
         sv_image_counts(&t->image[v], 1, (int)uv[0], (int)uv[1]);
}

void sv_track_follow(sv_tracker *t, const sv_pose *guess) {
  double depth = nominal_depth(t);
  t->n_found = 0;
  for (int i = 0; i < t->n_live; i++) {
    const sv_track_point *p = &t->point[t->live[i]];
    for (int v = 0; v < t->n_views && t->n_found < t->cap_found; v++) {
      if (p->now[v] < 0) continue;
      const sv_track_obs *o = &t->obs[p->now[v]];
      sv_track_candidate c = {t->live[i], v, {o->uv_px[0], o->uv_px[1]}, o->sigma_px, {0}};
      expect(t, p, v, guess, depth, c.uv_px);
      memcpy(c.warp, p->warp[v], sizeof c.warp);
      if (sv_track_follow_patch(t, p->i_ref, v, o->uv_px, c.uv_px, c.warp)) t->found[t->n_found++] = c;
    }
  }
}

// --- depth ---------------------------------------------------------------------------------------

// Adds the ray of an observation to the normal equations of the point nearest to all rays; its
// direction in the world is left in d, the camera's place in c.
static void add_ray(const sv_tracker *t, const sv_track_obs *o, double a[6], double b[3], double c[3],
                    double d[3]) {
  const sv_bundle_camera *cam = &t->cam[o->i_view];
  const sv_pose rig = sv_track_pose_at(t, o->i_exposure, o->i_view, o->uv_px);
  sv_pose cw = sv_pose_mul(&cam->cam_from_rig, &rig);
  double ray[3];
  sv_pose_centre(c, &cw);
  sv_track_ray(cam, o->uv_px, ray);
  double len = sv_norm3(ray);
  for (int i = 0; i < 3; i++) d[i] = (cw.r[i] * ray[0] + cw.r[3 + i] * ray[1] + cw.r[6 + i] * ray[2]) / len;
  double m[6] = {1 - d[0] * d[0], -d[0] * d[1], -d[0] * d[2], 1 - d[1] * d[1], -d[1] * d[2], 1 - d[2] * d[2]};
  for (int i = 0; i < 6; i++) a[i] += m[i];
  b[0] += m[0] * c[0] + m[1] * c[1] + m[2] * c[2];
  b[1] += m[1] * c[0] + m[3] * c[1] + m[4] * c[2];
  b[2] += m[2] * c[0] + m[4] * c[1] + m[5] * c[2];
}

static bool solve3(const double a[6], const double b[3], double x[3]) {
  double c00 = a[3] * a[5] - a[4] * a[4], c01 = a[2] * a[4] - a[1] * a[5], c02 = a[1] * a[4] - a[2] * a[3];
  double c11 = a[0] * a[5] - a[2] * a[2], c12 = a[1] * a[2] - a[0] * a[4], c22 = a[0] * a[3] - a[1] * a[1];
  double det = a[0] * c00 + a[1] * c01 + a[2] * c02;
  if (!(fabs(det) > 1e-12)) return false;
  x[0] = (c00 * b[0] + c01 * b[1] + c02 * b[2]) / det;
  x[1] = (c01 * b[0] + c11 * b[1] + c12 * b[2]) / det;
  x[2] = (c02 * b[0] + c12 * b[1] + c22 * b[2]) / det;
  return true;
}

bool sv_track_triangulate(sv_tracker *t, sv_track_point *p) {
  double a[6] = {0}, b[3] = {0}, c[3], d[3], d0[3] = {0}, x[3], parallax = 0;
  for (int32_t i = p->first_obs; i >= 0; i = t->obs[i].next) {
    const sv_track_obs *o = &t->obs[i];
    if (o->sigma_px <= 0 || !t->is_placed[o->i_exposure]) continue;
    add_ray(t, o, a, b, c, d);
    if (i == p->first_obs) memcpy(d0, d, sizeof d0);
    double seen = sv_angle_between(d0, d) * t->cam[o->i_view].fx / (double)o->sigma_px;
    if (sv_norm3(d0) > 0 && seen > parallax) parallax = seen;
  }
  if (!(parallax > PARALLAX_PX) || !solve3(a, b, x)) return false;
  for (int32_t i = p->first_obs; i >= 0; i = t->obs[i].next) {
    const sv_track_obs *o = &t->obs[i];
    double uv[2], limit = WRONG_PX * (double)o->sigma_px;
    if (o->sigma_px <= 0 || !t->is_placed[o->i_exposure]) continue;
    const sv_pose rig = sv_track_pose_at(t, o->i_exposure, o->i_view, o->uv_px);
    if (!sv_track_see(&t->cam[o->i_view], &rig, x, uv)) return false;
    double ex = uv[0] - (double)o->uv_px[0], ey = uv[1] - (double)o->uv_px[1];
    if (ex * ex + ey * ey > limit * limit) return false;
  }
  memcpy(p->x, x, sizeof x);
  return true;
}

// --- birth ---------------------------------------------------------------------------------------

static double base_of(const sv_tracker *t, int a, int b) {
  double ca[3], cb[3], d[3];
  sv_pose_centre(ca, &t->cam[a].cam_from_rig);
  sv_pose_centre(cb, &t->cam[b].cam_from_rig);
  sv_sub3(d, ca, cb);
  return sv_norm3(d);
}

static void times(const float a[4], float k, float out[4]) {
  for (int i = 0; i < 4; i++) out[i] = k * a[i];
}

bool sv_track_take_ref(sv_tracker *t, bool is_now, int i_ref, int v, const float uv[2], int level) {
  sv_track_plane p = sv_track_level(t, is_now, v, level);
  float k = 1.0f / (float)(1 << level);
  sv_patch_take_args a = {.src = p.px,
                          .width_px = p.width_px,
                          .height_px = p.height_px,
                          .stride = p.stride,
                          .x = uv[0] * k,
                          .y = uv[1] * k,
                          .a = {1, 0, 0, 1},
                          .out = &t->ref[i_ref].patch,
                          .has_slopes = true};
  t->k->patch_take(&a);
  if (a.is_inside) sv_track_prepare_ref(&t->ref[i_ref]);
  return a.is_inside;
}

static int32_t new_point(sv_tracker *t, int v, const float uv[2]) {
  if ((t->n_points == t->cap_points && t->n_free_points == 0) || t->n_obs + SV_TRACK_CAP_VIEWS > t->cap_obs ||
      t->n_free_refs == 0) {
    t->n_full++;
    return -1;
  }
  int32_t i = t->n_free_points ? t->free_point[--t->n_free_points] : t->n_points++;
  sv_track_point *p = &t->point[i];
  memset(p, 0, sizeof *p);
  p->first_obs = p->last_obs = -1;
  for (int k = 0; k < SV_TRACK_CAP_VIEWS; k++) p->now[k] = -1;
  p->is_live = true;
  p->i_ref = t->free_ref[--t->n_free_refs];
  t->ref[p->i_ref].is_usable = false;
  const sv_image_u8 *im = &t->image[v];
  memcpy(p->rgb, im->px + (size_t)uv[1] * (size_t)im->stride_bytes + 3 * (size_t)uv[0], 3);
  t->live[t->n_live++] = i;
  return i;
}

// Whether a corner already taken in this exposure is near. Taken ones have a score below 0.
static bool is_crowded(const sv_tracker *t, int cell, int n_x, int n_y) {
  const sv_corner *c = &t->corner[cell];
  int cx = cell % n_x, cy = cell / n_x;
  for (int y = sv_maxi(cy - 1, 0); y <= sv_mini(cy + 1, n_y - 1); y++)
    for (int x = sv_maxi(cx - 1, 0); x <= sv_mini(cx + 1, n_x - 1); x++) {
      const sv_corner *o = &t->corner[y * n_x + x];
      int dx = o->x - c->x, dy = o->y - c->y;
      if (o->score < 0 && dx * dx + dy * dy < APART_PX * APART_PX) return true;
    }
  return false;
}

typedef struct {
  sv_track_match in[SV_TRACK_CAP_VIEWS];
  bool has[SV_TRACK_CAP_VIEWS];
  float min_focal_px; // smallest focal length among the matches
} view_matches;

// Matches of a corner in the other sub-views. Matching backwards must return to the corner.
static view_matches match_views(sv_tracker *t, int v, const float uv[2]) {
  view_matches m = {.min_focal_px = (float)t->cam[v].fx};
  for (int b = 0; b < t->n_views; b++) {
    double base = base_of(t, v, b), near_m = NEAR_BASE * base, far_m = FAR_BASE * base;
    sv_track_match *there = &m.in[b], back;
    if (b == v || !(base > 0)) continue;
    sv_track_corner from = {v, {uv[0], uv[1]}, near_m, far_m};
    if (!sv_track_stereo(t, &from, b, there)) continue;
    sv_track_corner to = {b, {there->uv_px[0], there->uv_px[1]}, near_m, far_m};
    if (!sv_track_stereo(t, &to, v, &back)) continue;
    float dx = back.uv_px[0] - uv[0], dy = back.uv_px[1] - uv[1];
    m.has[b] = dx * dx + dy * dy < BACK_PX * BACK_PX * back.step_px * back.step_px;
    if (m.has[b]) m.min_focal_px = sv_minf(m.min_focal_px, (float)t->cam[b].fx);
  }
  return m;
}

// Adds a view's observation of a point: aligned with the reference, near the prediction.
static void add_view(sv_tracker *t, int32_t i_point, int b, const float uv[2], const float warp[4]) {
  sv_track_point *p = &t->point[i_point];
  float at[2] = {uv[0], uv[1]}, w[4] = {warp[0], warp[1], warp[2], warp[3]}, space;
  if (sv_track_align_affine(t, p->i_ref, b, at, w) < MATCH_CORR) return;
  float dx = at[0] - uv[0], dy = at[1] - uv[1];
  space = sv_maxf(1.0f, sv_track_spacing(w));
  if (dx * dx + dy * dy > MATCH_PX * MATCH_PX * space * space) return;
  memcpy(p->warp[b], w, sizeof w);
  (void)sv_track_add_obs(t, i_point, t->n_exposures - 1, b, at, space);
}

// Makes a corner a point, with its matches and, if they determine it, its depth. False: no room.
static bool bear(sv_tracker *t, int v, const float uv[2]) {
  view_matches m = match_views(t, v, uv);
  int level = 0;
  while (level + 1 < t->n_levels[v] && (float)t->cam[v].fx > 1.42f * m.min_focal_px * (float)(1 << level))
    level++;
  int32_t i = new_point(t, v, uv);
  if (i < 0) return false;
  sv_track_point *p = &t->point[i];
  // a coarse patch may cross the border
  while (!sv_track_take_ref(t, true, p->i_ref, v, uv, level) && level > 0) level--;
  float space = (float)(1 << level), own[4] = {space, 0, 0, space};
  memcpy(p->warp[v], own, sizeof own);
  (void)sv_track_add_obs(t, i, t->n_exposures - 1, v, uv, space);
  for (int b = 0; b < t->n_views; b++) {
    float warp[4];
    if (!m.has[b]) continue;
    times(m.in[b].b_from_a, space, warp);
    add_view(t, i, b, m.in[b].uv_px, warp);
  }
  p->has_depth = p->first_obs != p->last_obs && sv_track_triangulate(t, p);
  if (p->has_depth || p->first_obs == p->last_obs) return true;
  // Contradicting matches: keep only the corner itself.
  for (int32_t k = t->obs[p->first_obs].next; k >= 0; k = t->obs[k].next) t->obs[k].sigma_px = 0;
  for (int b = 0; b < t->n_views; b++)
    if (b != v) p->now[b] = -1;
  return true;
}

void sv_track_new_points(sv_tracker *t) {
  for (int v = 0; v < t->n_views; v++) {
    int n = sv_track_detect(t, v), n_now = 0;
    int n_x = (t->width_px[v] + SV_CORNER_CELL - 1) / SV_CORNER_CELL,
        n_y = (t->height_px[v] + SV_CORNER_CELL - 1) / SV_CORNER_CELL;
    for (int i = 0; i < t->n_live; i++) n_now += t->point[t->live[i]].now[v] >= 0;
    for (int i = 0; i < n && n_now < t->cfg.n_features; i++) {
      sv_corner *c = &t->corner[t->order[i]];
      if (is_crowded(t, t->order[i], n_x, n_y)) continue;
      float uv[2] = {(float)c->x + 0.5f, (float)c->y + 0.5f};
      if (!bear(t, v, uv)) return;
      c->score = -1;
      n_now++;
    }
  }
}

// Searches view b for a point tracked in view a at depth z.
static void rematch_view(sv_tracker *t, int32_t i_point, int a, int b, double z) {
  const sv_track_point *p = &t->point[i_point];
  const float *from = t->obs[p->now[a]].uv_px, *w = p->warp[a];
  float warp[4];
  double seen[2];
  sv_track_match m;
  const sv_pose rig = sv_track_pose_at(t, t->n_exposures - 1, a, from);
  if (!sv_track_see(&t->cam[b], &rig, p->x, seen)) return;
  if (!sv_track_stereo(t, &(sv_track_corner){a, {from[0], from[1]}, (1 - REMATCH) * z, (1 + REMATCH) * z}, b,
                       &m))
    return;
  double dx = (double)m.uv_px[0] - seen[0], dy = (double)m.uv_px[1] - seen[1],
         limit = WRONG_PX * (double)m.step_px;
  if (dx * dx + dy * dy > limit * limit) return;
  for (int i = 0; i < 2; i++)
    for (int k = 0; k < 2; k++) warp[2 * i + k] = m.b_from_a[2 * i] * w[k] + m.b_from_a[2 * i + 1] * w[2 + k];
  add_view(t, i_point, b, m.uv_px, warp);
}

void sv_track_rematch(sv_tracker *t) {
  int e = t->n_exposures - 1;
  for (int i = 0; i < t->n_live; i++) {
    sv_track_point *p = &t->point[t->live[i]];
    int a = -1;
    for (int v = 0; v < t->n_views && a < 0; v++)
      if (p->now[v] >= 0) a = v;
    if (!p->has_depth || a < 0) continue;
    double q[3];
    sv_pose_apply(q, &t->pose[e], p->x);
    sv_pose_apply(q, &t->cam[a].cam_from_rig, (const double[3]){q[0], q[1], q[2]});
    for (int b = 0; b < t->n_views; b++)
      if (p->now[b] < 0 && q[2] > 0) rematch_view(t, t->live[i], a, b, q[2]);
  }
}
