// SPDX-License-Identifier: Apache-2.0
// From the tracker's lists to a bundle and back.
#include <math.h>
#include <string.h>

#include "src/base/mathx.h"
#include "src/track/tracker.h"

#define HUBER_PX    1.0
#define WRONG_PX    3.5                  // standard deviations; such an observation is given up
#define MOVING      2.5                  // times the usual squared residual: a point that moves
#define SIGMA_ROT   (0.05 * SV_PI / 180) // what a good calibration leaves of doubt
#define SIGMA_TRANS 0.002                // of the rig's largest distance between two cameras

static double size_of_rig(const sv_tracker *t) {
  double largest = 1e-3, a[3], b[3], d[3];
  for (int i = 0; i < t->n_views; i++)
    for (int k = 0; k < i; k++) {
      sv_pose_centre(a, &t->cam[i].cam_from_rig);
      sv_pose_centre(b, &t->cam[k].cam_from_rig);
      sv_sub3(d, a, b);
      if (sv_norm3(d) > largest) largest = sv_norm3(d);
    }
  return largest;
}

// Where an exposure is in a part, -1: it is not.
static int place_in(const sv_track_part *part, int e) {
  const int way = e - part->first;
  return way >= 0 && way % part->step == 0 && way / part->step < part->n ? way / part->step : -1;
}

// Observations of a point within the part into the bundle. Returns how many.
static int gather(sv_tracker *t, const sv_track_point *p, const sv_track_part *part, int at) {
  sv_bundle *b = &t->bundle;
  int count = 0;
  for (int32_t i = p->first_obs; i >= 0; i = t->obs[i].next) {
    const sv_track_obs *o = &t->obs[i];
    const int i_pose = place_in(part, o->i_exposure);
    if (i_pose < 0 || o->sigma_px <= 0 || !t->is_placed[o->i_exposure]) continue;
    b->obs[at + count] = (sv_bundle_obs){(int16_t)i_pose,
                                         o->i_view,
                                         {o->uv_px[0], o->uv_px[1]},
                                         1.0f / o->sigma_px,
                                         (float)sv_track_row_s(t, o->i_view, o->uv_px)};
    t->bundle_obs[at + count++] = i;
  }
  return count;
}

static void fill(sv_tracker *t, const sv_track_part *part) {
  sv_bundle *b = &t->bundle;
  int n_obs = 0;
  bool has_fixed = false;
  b->n_poses = part->n;
  b->n_cameras = t->n_views;
  b->n_points = 0;
  for (int i = 0; i < part->n; i++) {
    const int e = part->first + i * part->step;
    b->pose[i] = t->pose[e];
    if (t->cfg.row_time) sv_track_beside(t, part->first, part->n, i, b->beside[i], b->slope[i]);
    b->is_fixed[i] = i < part->n_fixed || !t->is_placed[e] || (part->key_step > 0 && e % part->key_step == 0);
    // the world's place
    if (!has_fixed && t->is_placed[e]) has_fixed = b->is_fixed[i] = true;
  }
  for (int i = 0; i < t->n_views; i++) {
    b->camera[i] = t->cam[i];
    b->calibrated[i] = t->cfg.rig->sub_views[t->sub_view[i]].cam_from_rig;
  }
  for (int i = 0; i < t->n_points; i++) {
    const sv_track_point *p = &t->point[i];
    if (!p->has_depth || (p->last_obs >= 0 && t->obs[p->last_obs].i_exposure < part->first)) continue;
    int found = gather(t, p, part, n_obs);
    if (found < 2) continue;
    memcpy(b->point[b->n_points], p->x, sizeof p->x);
    t->bundle_point[b->n_points] = i;
    b->first[b->n_points++] = n_obs;
    n_obs += found;
  }
  b->first[b->n_points] = n_obs;
}

static void give_up(sv_tracker *t, int32_t i_obs) {
  sv_track_obs *o = &t->obs[i_obs];
  sv_track_point *p = &t->point[o->i_point];
  o->sigma_px = 0;
  for (int v = 0; v < t->n_views; v++)
    if (p->now[v] == i_obs) p->now[v] = -1;
}

// Squared residual of an observation in units of its standard deviation; infinite behind the
// camera.
static double residual2(const sv_bundle *b, int i_point, int k) {
  double r[2], w = (double)b->obs[k].weight;
  if (!sv_bundle_residual(b, &b->obs[k], b->point[i_point], r, NULL)) return INFINITY;
  return w * w * (r[0] * r[0] + r[1] * r[1]);
}

// Mean over all observations that fit.
static double usual_residual2(const sv_bundle *b) {
  double sum = 0;
  int n = 0;
  for (int i = 0; i < b->n_points; i++)
    for (int k = b->first[i]; k < b->first[i + 1]; k++) {
      const double r2 = residual2(b, i, k);
      if (!(r2 < WRONG_PX * WRONG_PX)) continue;
      sum += r2;
      n++;
    }
  return n ? sum / n : 0;
}

// Mean squared residual of all observations of a point.
static double mean_residual2(const sv_bundle *b, int i) {
  const int n = b->first[i + 1] - b->first[i];
  double sum = 0;
  for (int k = b->first[i]; k < b->first[i + 1]; k++) {
    const double r2 = residual2(b, i, k);
    sum += r2 < WRONG_PX * WRONG_PX ? r2 : WRONG_PX * WRONG_PX;
  }
  return sum / n;
}

// A point that moves, or slides along an edge, fits the rig's motion worse than others do in all of
// its observations. Returns the mean squared residual above which a point is taken for such a one:
// as low as leaves enough others.
static double moving_limit(const sv_bundle *b, int n_enough) {
  double limit = MOVING * usual_residual2(b);
  for (int n_kept = 0; limit < WRONG_PX * WRONG_PX; limit *= 1.5, n_kept = 0) {
    for (int i = 0; i < b->n_points; i++) n_kept += mean_residual2(b, i) <= limit;
    if (n_kept >= n_enough) break;
  }
  return limit;
}

// Takes the results over; observations that do not fit are given up, those of points that move
// all, and points that keep fewer than two.
static void take_back(sv_tracker *t, const sv_track_part *part) {
  sv_bundle *b = &t->bundle;
  const double limit = moving_limit(b, t->cfg.n_features / 2);
  for (int i = 0; i < part->n; i++) t->pose[part->first + i * part->step] = b->pose[i];
  sv_track_find_motion(t, part->first, part->n * part->step);
  for (int i = 0; i < t->n_views; i++) t->cam[i].cam_from_rig = b->camera[i].cam_from_rig;
  for (int i = 0; i < b->n_points; i++) {
    sv_track_point *p = &t->point[t->bundle_point[i]];
    const bool is_off = mean_residual2(b, i) > limit;
    int n_good = 0;
    memcpy(p->x, b->point[i], sizeof p->x);
    for (int k = b->first[i]; k < b->first[i + 1]; k++) {
      const bool is_good = !is_off && residual2(b, i, k) < WRONG_PX * WRONG_PX;
      if (!is_good) give_up(t, t->bundle_obs[k]);
      n_good += is_good;
    }
    if (n_good < 2) p->has_depth = false;
  }
}

static sv_bundle_options options(const sv_tracker *t, int max_iterations, bool is_extrinsics) {
  return (sv_bundle_options){.max_iterations = max_iterations,
                             .huber_px = HUBER_PX,
                             .heartbeats = t->cfg.heartbeats,
                             .is_extrinsics = is_extrinsics,
                             .sigma_rot_rad = SIGMA_ROT,
                             .sigma_trans_m = SIGMA_TRANS * size_of_rig(t)};
}

sv_bundle_result sv_track_adjust(sv_tracker *t, const sv_track_part *part, int max_iterations,
                                 bool is_extrinsics) {
  sv_bundle_result r = {0};
  sv_bundle_options o = options(t, max_iterations, is_extrinsics);
  fill(t, part);
  if (t->bundle.n_points < 4 || sv_bundle_solve(&t->bundle, &o, &r) < 0) return r;
  take_back(t, part);
  return r;
}

double sv_track_scale_sigma(sv_tracker *t, const sv_track_part *part) {
  sv_bundle_options o = options(t, 0, false);
  fill(t, part);
  return sv_bundle_scale_sigma(&t->bundle, &o);
}
