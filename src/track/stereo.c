// SPDX-License-Identifier: Apache-2.0
// Matching between the sub-views of one exposure: their relative pose is known, so the match of a
// corner lies on an epipolar line of the other image. Patches are compared at the resolution of the
// coarser of the two.
#include "src/base/mathx.h"
#include "src/track/tracker.h"

#define WIDE_PX     400   // larger images are searched at half their size
#define MIN_CORR    0.75f // minimum correlation of the best position along the line
#define UNIQUE      0.6f  // (1 - best) / (1 - second best), or
#define UNIQUE_BY   0.12f // best - second best
#define APART       3     // minimum samples between two separate maxima
#define OFF_LINE_PX 1.5f  // px of the level: a larger offset from the line is a wrong match

void sv_track_ray(const sv_bundle_camera *c, const float uv_px[2], double ray[3]) {
  ray[0] = ((double)uv_px[0] - c->cx) / c->fx;
  ray[1] = ((double)uv_px[1] - c->cy) / c->fy;
  ray[2] = 1;
}

static bool project(const sv_bundle_camera *c, const double x[3], double uv[2]) {
  if (!(x[2] > 1e-3)) return false;
  uv[0] = c->fx * x[0] / x[2] + c->cx;
  uv[1] = c->fy * x[1] / x[2] + c->cy;
  return true;
}

static int level_of(double ratio, int n_levels) { // nearest power of two
  int l = 0;
  while (l + 1 < n_levels && ratio > 1.4142135623730951) {
    l++;
    ratio *= 0.5;
  }
  return l;
}

typedef struct {
  int a, b, la, lb;
  const sv_bundle_camera *ca, *cb;
  sv_pose b_from_a;
  double uv_a[2], warp[4]; // pixels of a for one of b, full size
  double p0[2], p1[2];     // the line's ends in b, full size
} search;

// Projection into b of the point at a depth on a pixel's ray of a.
static bool transfer(const search *s, double u, double v, double z, double uv[2]) {
  const sv_bundle_camera *a = s->ca;
  double x[3] = {(u - a->cx) / a->fx * z, (v - a->cy) / a->fy * z, z};
  sv_pose_apply(x, &s->b_from_a, (const double[3]){x[0], x[1], x[2]});
  return project(s->cb, x, uv);
}

// Local map of a's picture to b's, for a surface across the ray at depth z; false where it folds.
static bool find_warp(search *s, double z) {
  double o[2], u[2], v[2];
  if (!transfer(s, s->uv_a[0], s->uv_a[1], z, o) || !transfer(s, s->uv_a[0] + 1, s->uv_a[1], z, u) ||
      !transfer(s, s->uv_a[0], s->uv_a[1] + 1, z, v))
    return false;
  double j[4] = {u[0] - o[0], v[0] - o[0], u[1] - o[1], v[1] - o[1]}, det = j[0] * j[3] - j[1] * j[2];
  if (!(det > 1e-4)) return false;
  s->warp[0] = j[3] / det;
  s->warp[1] = -j[1] / det;
  s->warp[2] = -j[2] / det;
  s->warp[3] = j[0] / det;
  return true;
}

static bool take(sv_tracker *t, const search *s, int la, int lb) {
  sv_track_plane p = sv_track_level(t, true, s->a, la);
  double k = (double)(1 << lb) / (double)(1 << la);
  sv_patch_take_args a = {.src = p.px,
                          .width_px = p.width_px,
                          .height_px = p.height_px,
                          .stride = p.stride,
                          .x = (float)(s->uv_a[0] / (1 << la)),
                          .y = (float)(s->uv_a[1] / (1 << la)),
                          .out = t->patch,
                          .has_slopes = true};
  for (int i = 0; i < 4; i++) a.a[i] = (float)(s->warp[i] * k);
  t->k->patch_take(&a);
  return a.is_inside;
}

// Correlations along the line, one sample a pixel of the level. Returns the best place in
// t->place_x, y; -1 when none is distinct.
static int best_on_line(sv_tracker *t, const search *s) {
  sv_track_plane p = sv_track_level(t, true, s->b, s->lb);
  double inv = 1.0 / (1 << s->lb), dx = (s->p1[0] - s->p0[0]) * inv, dy = (s->p1[1] - s->p0[1]) * inv;
  double length = sqrt(dx * dx + dy * dy);
  int n_steps = sv_mini((int)length + 2, 4 * SV_TRACK_CAP_PLACES), n = 0, best = -1;
  for (int i = 0; i < n_steps && n < SV_TRACK_CAP_PLACES; i++) {
    double f = n_steps > 1 ? (double)i / (n_steps - 1) : 0;
    float x = (float)(s->p0[0] * inv + f * dx), y = (float)(s->p0[1] * inv + f * dy);
    if (!(x >= SV_PATCH_REACH && x < (float)(p.width_px - SV_PATCH_REACH - 1) && y >= SV_PATCH_REACH &&
          y < (float)(p.height_px - SV_PATCH_REACH - 1)))
      continue;
    t->place_x[n] = x;
    t->place_y[n++] = y;
  }
  sv_patch_sums_args a = {.src = p.px,
                          .stride = p.stride,
                          .patch = t->patch,
                          .x = t->place_x,
                          .y = t->place_y,
                          .n = n,
                          .out = t->sums};
  t->k->patch_sums(&a);
  double pp = 0;
  for (int i = 0; i < SV_PATCH_PIXELS; i++) pp += (double)t->patch->v[0][i] * (double)t->patch->v[0][i];
  for (int i = 0; i < n; i++) { // the correlation overwrites the first sum
    double var = (double)t->sums[i][1] - (double)t->sums[i][0] * (double)t->sums[i][0] / SV_PATCH_PIXELS;
    t->sums[i][0] = var > 1e-6 && pp > 1e-6 ? (float)((double)t->sums[i][2] / sqrt(var * pp)) : -1.0f;
    if (best < 0 || t->sums[i][0] > t->sums[best][0]) best = i;
  }
  if (best < 0 || t->sums[best][0] < MIN_CORR) return -1;
  float second = -1, top = t->sums[best][0];
  for (int i = 0; i < n; i++)
    if ((i < best - APART || i > best + APART) && t->sums[i][0] > second) second = t->sums[i][0];
  return (1 - top) < UNIQUE * (1 - second) || top - second > UNIQUE_BY ? best : -1;
}

// The line of depths from near to far in b. Near is moved out until b sees it.
static bool find_line(search *s, double near_m, double far_m) {
  if (!transfer(s, s->uv_a[0], s->uv_a[1], far_m, s->p0)) return false;
  for (int i = 0; i < 12; i++, near_m *= 1.4) {
    if (near_m >= far_m) return false;
    if (transfer(s, s->uv_a[0], s->uv_a[1], near_m, s->p1)) return true;
  }
  return false;
}

static float off_line(const search *s, const float uv[2]) {
  double dx = s->p1[0] - s->p0[0], dy = s->p1[1] - s->p0[1], n = sqrt(dx * dx + dy * dy);
  double ex = (double)uv[0] - s->p0[0], ey = (double)uv[1] - s->p0[1];
  return (float)(n > 1e-6 ? fabs(ex * dy - ey * dx) / n : sqrt(ex * ex + ey * ey));
}

bool sv_track_stereo(sv_tracker *t, const sv_track_corner *c, int b, sv_track_match *out) {
  const int a = c->i_view;
  search s = {.a = a, .b = b, .ca = &t->cam[a], .cb = &t->cam[b], .uv_a = {c->uv_px[0], c->uv_px[1]}};
  sv_pose inv = sv_pose_inv(&s.ca->cam_from_rig);
  s.b_from_a = sv_pose_mul(&s.cb->cam_from_rig, &inv);
  int half = t->width_px[a] > WIDE_PX ? 2 : 1;
  double f = (s.ca->fx < s.cb->fx ? s.ca->fx : s.cb->fx) / half;
  s.la = level_of(s.ca->fx / f, t->n_levels[a]);
  s.lb = level_of(s.cb->fx / f, t->n_levels[b]);
  double middle = 2 / (1 / c->near_m + 1 / c->far_m);
  if (!find_line(&s, c->near_m, c->far_m) || !find_warp(&s, middle) || !take(t, &s, s.la, s.lb)) return false;
  int i = best_on_line(t, &s);
  if (i < 0) return false;
  float x = t->place_x[i], y = t->place_y[i], corr = -1;
  for (;;) {
    sv_track_plane p = sv_track_level(t, true, b, s.lb);
    corr = sv_track_align(t, &p, &x, &y);
    if (corr < MIN_CORR) return false;
    if (s.la == 0 || s.lb == 0) break;
    s.la--;
    s.lb--;
    x *= 2;
    y *= 2;
    if (!take(t, &s, s.la, s.lb)) return false;
  }
  out->uv_px[0] = x * (float)(1 << s.lb);
  out->uv_px[1] = y * (float)(1 << s.lb);
  out->step_px = (float)(1 << s.lb);
  double det = s.warp[0] * s.warp[3] - s.warp[1] * s.warp[2];
  out->b_from_a[0] = (float)(s.warp[3] / det);
  out->b_from_a[1] = (float)(-s.warp[1] / det);
  out->b_from_a[2] = (float)(-s.warp[2] / det);
  out->b_from_a[3] = (float)(s.warp[0] / det);
  return corr >= MIN_CORR && off_line(&s, out->uv_px) < OFF_LINE_PX * out->step_px;
}
