// SPDX-License-Identifier: Apache-2.0
// Places that are seen again: a rig that comes back to where it was finds the points that it had
// lost there, and the adjustment of all exposures takes the drift out of what lies between. Where
// the rig came back is known from the poses that odometry gives, as its drift is small against the
// distance of what is seen; whether it did is told by the points.
#include <math.h>
#include <string.h>

#include "src/base/mathx.h"
#include "src/port/heartbeat.h"
#include "src/track/tracker.h"

#define LEAST_BETWEEN 4 // exposures between two that may show the same place anew
// Two exposures that look at a place from directions further apart do not find its points by
// their patches.
#define APART_RAD  0.4
#define CAP_PASSES 3 // earlier exposures that one is compared with

// Median depth of the points that an exposure sees, from its rig; 0 when it sees none.
static double depth_of(sv_tracker *t, int e) {
  int n = 0;
  for (int i = 0; i < t->n_points && n < t->cap_found; i++) {
    const sv_track_point *p = &t->point[i];
    bool is_seen = false;
    double q[3];
    for (int32_t k = p->first_obs; p->has_depth && k >= 0 && !is_seen; k = t->obs[k].next)
      is_seen = t->obs[k].i_exposure == e && t->obs[k].sigma_px > 0;
    if (!is_seen) continue;
    sv_pose_apply(q, &t->pose[e], p->x);
    t->work[n++] = (float)q[2];
  }
  return (double)sv_track_rank(t->work, n, n / 2);
}

// How differently two exposures see what lies at a depth: the larger of their rotation and of the
// angle between their directions, in radians.
static double apart(const sv_pose *a, const sv_pose *b, double depth) {
  const sv_pose inv = sv_pose_inv(b), m = sv_pose_mul(a, &inv);
  double turn[3];
  sv_rodrigues_inv(turn, m.r);
  const double by_way = sv_norm3(m.t) / depth, by_turn = sv_norm3(turn);
  return by_way > by_turn ? by_way : by_turn;
}

// Where the rig was nearest to exposure e on each of its earlier passes, nearest first.
static int find_passes(sv_tracker *t, int e, int pass[CAP_PASSES]) {
  const double depth = depth_of(t, e);
  double how_far[CAP_PASSES], was = INFINITY, at = INFINITY;
  int n = 0, i_at = -1;
  if (!(depth > 0)) return 0;
  for (int i = 0; i <= e - LEAST_BETWEEN; i++) {
    if (!t->is_placed[i]) continue;
    const double now = apart(&t->pose[e], &t->pose[i], depth);
    const bool is_nearest = i_at >= 0 && at < was && at <= now; // of those beside it
    if (is_nearest && at < APART_RAD && (n < CAP_PASSES || at < how_far[n - 1])) {
      int k = n < CAP_PASSES ? n++ : n - 1;
      for (; k > 0 && how_far[k - 1] > at; k--) {
        how_far[k] = how_far[k - 1];
        pass[k] = pass[k - 1];
      }
      how_far[k] = at;
      pass[k] = i_at;
    }
    was = at;
    at = now;
    i_at = i;
  }
  return n;
}

// Pixels of a view at exposure e for a pixel of the same view at exposure `from`, on a surface
// across the ray at a point. False where it does not see that.
static bool find_warp(const sv_tracker *t, const sv_track_obs *o, const double x[3], int e, float uv[2],
                      float warp[4]) {
  const sv_bundle_camera *c = &t->cam[o->i_view];
  const sv_pose cam = sv_pose_mul(&c->cam_from_rig, &t->pose[o->i_exposure]), back = sv_pose_inv(&cam);
  double q[3], see[3][2];
  sv_pose_apply(q, &cam, x);
  if (!(q[2] > 1e-3)) return false;
  for (int k = 0; k < 3; k++) {
    const double step[3] = {k == 1 ? q[2] / c->fx : 0, k == 2 ? q[2] / c->fy : 0, 0};
    double y[3];
    sv_pose_apply(y, &back, (const double[3]){q[0] + step[0], q[1] + step[1], q[2]});
    if (!sv_track_see(c, &t->pose[e], y, see[k])) return false;
  }
  for (int k = 0; k < 2; k++) {
    uv[k] = (float)see[0][k];
    warp[2 * k] = (float)(see[1][k] - see[0][k]);
    warp[2 * k + 1] = (float)(see[2][k] - see[0][k]);
  }
  return true;
}

// Finds a point that exposure i saw, whose pyramids are the last ones, in those of now, e.
static bool find_point(sv_tracker *t, const sv_track_obs *o, int e, sv_track_candidate *c) {
  const sv_track_point *p = &t->point[o->i_point];
  const int i_ref = t->cap_refs; // the one that no live point has
  int level = 0;
  while (level + 1 < t->n_levels[o->i_view] && o->sigma_px > 1.42f * (float)(1 << level)) level++;
  if (!find_warp(t, o, p->x, e, c->uv_px, c->warp)) return false;
  if (!sv_track_take_ref(t, false, i_ref, o->i_view, o->uv_px, level)) return false;
  for (int k = 0; k < 4; k++) c->warp[k] *= (float)(1 << level);
  if (!sv_track_follow_patch(t, i_ref, o->i_view, o->uv_px, c->uv_px, c->warp)) return false;
  c->i_point = o->i_point;
  c->i_view = o->i_view;
  c->sigma_px = sv_maxf(1.0f, sv_track_spacing(c->warp));
  return true;
}

// Points that exposure i saw and that were lost before e, in e. Those that agree on where the rig
// is become observations. Returns how many.
static int look_again(sv_tracker *t, int i, int e) {
  int n = 0;
  t->n_found = 0;
  for (int k = 0; k < t->n_points; k++) {
    const sv_track_point *p = &t->point[k];
    if (!p->has_depth || p->last_obs < 0 || t->obs[p->last_obs].i_exposure >= e) continue;
    for (int32_t at = p->first_obs; at >= 0 && t->n_found < t->cap_found; at = t->obs[at].next) {
      const sv_track_obs *o = &t->obs[at];
      if (o->i_exposure == i && o->sigma_px > 0 && find_point(t, o, e, &t->found[t->n_found])) t->n_found++;
    }
  }
  sv_pose pose = t->pose[e];
  if (sv_track_place(t, e, &pose) == 0) return 0;
  for (int k = 0; k < t->n_found; k++) {
    const sv_track_candidate *c = &t->found[k];
    if (c->sigma_px > 0) n += sv_track_add_obs(t, c->i_point, e, c->i_view, c->uv_px, c->sigma_px) >= 0;
  }
  return n;
}

int sv_track_close_loops(sv_tracker *t, const sv_track_pictures *pictures) {
  int n = 0;
  for (int e = LEAST_BETWEEN; e < t->n_exposures; e++) {
    int pass[CAP_PASSES], n_passes = t->is_placed[e] ? find_passes(t, e, pass) : 0;
    sv_beat(t->cfg.heartbeats, SV_BEAT_MAIN);
    for (int k = 0; k < n_passes; k++) {
      sv_track_build(t, pictures->get(pictures->self, pass[k]));
      sv_track_build(t, pictures->get(pictures->self, e));
      n += look_again(t, pass[k], e);
    }
  }
  return n;
}
