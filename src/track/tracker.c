// SPDX-License-Identifier: Apache-2.0
#include "src/track/tracker.h"

#include <string.h>

#include "src/base/mathx.h"

#define N_FEATURES  250
#define MIN_SIDE_PX 30 // minimum side of a pyramid's coarsest level
// capacity for detections per feature and view: known points come on top of corners
#define FOUND_PER   2
#define MIN_MATCHES 10  // minimum matches that locate a rig
#define MIN_SHARE   0.3 // minimum share of the re-detected points

// Chance alone brings up to 14 matches to agree. After a gap, where the rig may be anywhere, fewer
// than these locate nothing.
#define MIN_AFTER_GAP 16

#define LIMIT_PX     2.0
#define N_SAMPLES    60
#define WINDOW       8 // newest exposures, adjusted as they arrive
#define WINDOW_HELD  4 // older exposures held fixed
#define WINDOW_ITER  4
#define ROLLING_ITER 12 // the same with rolling shutters, whose motion changes with the poses
#define FINAL_ITER   12
#define FINAL_ROUNDS 3
#define CAP_TRIES    5 // exposures a point is tracked without finding its depth
// below this distance from exposure 0 the rig is stationary (way_from_start)
#define STILL_PX    0.6
#define STILL_LEAST 8 // minimum observations for that

sv_track_cfg sv_track_defaults(void) { return (sv_track_cfg){.n_features = N_FEATURES, .seed = 1}; }

// --- memory --------------------------------------------------------------------------------------

static const sv_camera_model *model_of(const sv_track_cfg *c, int i_sub) {
  return c->model ? &c->model[i_sub] : &c->rig->sub_views[i_sub].model;
}

// The sub-views in use: the first, then always the one farthest from those chosen.
static void choose_views(sv_tracker *t) {
  const sv_track_cfg *c = &t->cfg;
  t->n_views = 0;
  while (t->n_views < SV_TRACK_CAP_VIEWS && t->n_views < c->rig->n_sub_views) {
    int best = 0;
    double far = -1;
    for (int i = 0; i < c->rig->n_sub_views; i++) {
      double a[3], b[3], d[3], near = 1e30;
      bool is_chosen = false;
      sv_pose_centre(a, &c->rig->sub_views[i].cam_from_rig);
      for (int k = 0; k < t->n_views; k++) {
        sv_pose_centre(b, &c->rig->sub_views[t->sub_view[k]].cam_from_rig);
        sv_sub3(d, a, b);
        if (sv_norm3(d) < near) near = sv_norm3(d);
        is_chosen |= t->sub_view[k] == i;
      }
      if (!is_chosen && near > far) {
        best = i;
        far = near;
      }
    }
    t->sub_view[t->n_views++] = best;
  }
  for (int v = 0; v < t->n_views; v++) {
    const sv_camera_model *m = model_of(c, t->sub_view[v]);
    const sv_pose *place = &c->rig->sub_views[t->sub_view[v]].cam_from_rig;
    t->cam[v] = (sv_bundle_camera){*place, m->p[0], m->p[1], m->p[2], m->p[3]};
    t->width_px[v] = m->width_px;
    t->height_px[v] = m->height_px;
    for (t->n_levels[v] = 1; t->n_levels[v] < SV_TRACK_LEVELS; t->n_levels[v]++)
      if ((sv_mini(m->width_px, m->height_px) >> t->n_levels[v]) < MIN_SIDE_PX) break;
  }
}

static void carve_lists(sv_tracker *t, sv_arena *a) {
  size_t n_found = (size_t)t->cap_found;
  t->point = SV_TAKE(a, sv_track_point, t->cap_points);
  t->live = SV_TAKE(a, int32_t, t->cap_points);
  t->free_point = SV_TAKE(a, int32_t, t->cap_points);
  t->obs = SV_TAKE(a, sv_track_obs, t->cap_obs);
  t->found = SV_TAKE(a, sv_track_candidate, n_found);
  t->match = SV_TAKE(a, sv_pose_match, n_found);
  t->match_of = SV_TAKE(a, int32_t, n_found);
  t->work = SV_TAKE(a, float, n_found);
  t->pose = SV_TAKE(a, sv_pose, t->cfg.cap_exposures);
  if (t->cfg.row_time) {
    t->time_s = SV_TAKE(a, double, t->cfg.cap_exposures);
    t->motion = sv_arena_take(a, (size_t)t->cfg.cap_exposures, sizeof *t->motion);
  }
  t->is_placed = SV_TAKE(a, bool, t->cfg.cap_exposures);
  t->has_way = SV_TAKE(a, bool, t->cfg.cap_exposures);
  t->bundle_point = SV_TAKE(a, int32_t, t->cap_points);
  t->bundle_obs = SV_TAKE(a, int32_t, t->cap_obs);
  t->key_before = SV_TAKE(a, sv_pose, SV_TRACK_CAP_BUNDLE);
  t->patch = SV_TAKE(a, sv_patch, 2);
  t->ref = SV_TAKE(a, sv_track_ref, t->cap_refs + 1);
  t->free_ref = SV_TAKE(a, int32_t, t->cap_refs);
  for (int i = 0; t->free_ref && i < t->cap_refs; i++) t->free_ref[t->n_free_refs++] = i;
  t->place_x = SV_TAKE(a, float, SV_TRACK_CAP_PLACES);
  t->place_y = SV_TAKE(a, float, SV_TRACK_CAP_PLACES);
  t->sums = sv_arena_take(a, SV_TRACK_CAP_PLACES, sizeof *t->sums);
}

int sv_tracker_cap_points(const sv_track_cfg *cfg) {
  return cfg->n_features * sv_mini(cfg->rig->n_sub_views, SV_TRACK_CAP_VIEWS) * (2 + cfg->cap_exposures / 4);
}

static sv_status carve(sv_tracker *t, const sv_track_cfg *cfg, sv_arena *a) {
  memset(t, 0, sizeof *t);
  t->cfg = *cfg;
  choose_views(t);
  int n = cfg->cap_exposures, per = cfg->n_features * t->n_views, cells = 1, stride = 32;
  t->cap_points = sv_tracker_cap_points(cfg);
  t->cap_obs = sv_mini(n, 100000) * per * FOUND_PER;
  t->cap_found = per * FOUND_PER;
  t->cap_refs = per + per / 2; // points of this exposure, and those of the last that are not yet
                               // dropped
  for (int v = 0; v < t->n_views; v++) {
    int w = t->width_px[v], h = t->height_px[v];
    cells = sv_maxi(cells, (w / SV_CORNER_CELL + 1) * (h / SV_CORNER_CELL + 1));
    stride = sv_maxi(stride, sv_plane_pad(w));
    for (int s = 0; s < 2; s++)
      for (int l = 0; l < t->n_levels[v]; l++)
        t->pyramid[s][v].level[l] = SV_TAKE(a, float, sv_plane_floats(w >> l, h >> l));
  }
  t->corner = SV_TAKE(a, sv_corner, cells);
  t->order = SV_TAKE(a, int32_t, cells);
  t->scratch = SV_TAKE(a, float, SV_CORNER_SCRATCH_FLOATS(stride));
  carve_lists(t, a);
  sv_bundle_cfg bc = {.cap_poses = sv_mini(n, SV_TRACK_CAP_BUNDLE),
                      .cap_cameras = t->n_views,
                      .cap_points = t->cap_points,
                      .cap_obs = t->cap_obs,
                      .has_extrinsics = cfg->has_extrinsics};
  sv_status s = sv_bundle_init(&t->bundle, &bc, a);
  t->i_last = t->i_before = -1;
  t->still_px = -1;
  return s < 0 ? s : a->status;
}

size_t sv_tracker_bytes(const sv_track_cfg *cfg) {
  sv_tracker t;
  sv_arena dry = sv_arena_dry();
  return carve(&t, cfg, &dry) < 0 ? 0 : dry.used_bytes;
}

sv_status sv_tracker_init(sv_tracker *t, const sv_track_cfg *cfg, const sv_kernels *k, sv_arena *arena,
                          sv_err *err) {
  if (cfg->cap_exposures < 1 || cfg->cap_exposures > 30000 || cfg->rig->n_sub_views < 1 ||
      cfg->n_features < 16 || cfg->n_features > 4000)
    return sv_fail(
        err, SV_E_ARG,
        "tracking %d exposures of %d sub-views with %d features each: expected 1 to 30000, at least "
        "1, and 16 to 4000",
        cfg->cap_exposures, cfg->rig->n_sub_views, cfg->n_features);
  for (int i = 0; i < cfg->rig->n_sub_views; i++)
    if (model_of(cfg, i)->kind != SV_MODEL_PINHOLE)
      return sv_fail(err, SV_E_ARG, "tracking needs undistorted images, but sub-view %d is a %s", i,
                     sv_model_name(model_of(cfg, i)->kind));
  sv_status s = carve(t, cfg, arena);
  t->k = k;
  return s < 0 ? sv_fail(err, s, "no room to track %d exposures with %d features a sub-view",
                         cfg->cap_exposures, cfg->n_features)
               : SV_OK;
}

// --- one exposure --------------------------------------------------------------------------------

// The 30th percentile of the motions in t->work: objects may move although the rig is stationary.
// -1: too few.
static double way_of(sv_tracker *t, int n) {
  return n < STILL_LEAST ? -1 : (double)sv_track_rank(t->work, n, n * 3 / 10);
}

// Image motion since exposure 0, over the points seen in both.
static double way_from_start(sv_tracker *t) {
  int n = 0;
  for (int i = 0; i < t->n_found; i++) {
    const sv_track_candidate *c = &t->found[i];
    const sv_track_point *p = &t->point[c->i_point];
    if (!p->has_uv0[c->i_view]) continue;
    float dx = c->uv_px[0] - p->uv0_px[c->i_view][0], dy = c->uv_px[1] - p->uv0_px[c->i_view][1];
    t->work[n++] = sqrtf(dx * dx + dy * dy);
  }
  return way_of(t, n);
}

// The same of an exposure that was placed by points found later: they would have been seen from the
// world's origin, where the rig was in exposure 0.
static double way_from_origin(sv_tracker *t) {
  const sv_pose origin = sv_pose_identity();
  int n = 0;
  for (int i = 0; i < t->n_found; i++) {
    const sv_track_candidate *c = &t->found[i];
    const sv_track_point *p = &t->point[c->i_point];
    double uv[2];
    if (!p->has_depth || c->sigma_px <= 0 || !sv_track_see(&t->cam[c->i_view], &origin, p->x, uv)) continue;
    float dx = c->uv_px[0] - (float)uv[0], dy = c->uv_px[1] - (float)uv[1];
    t->work[n++] = sqrtf(dx * dx + dy * dy);
  }
  return way_of(t, n);
}

int sv_track_place(sv_tracker *t, int e, sv_pose *pose) {
  sv_pose_problem p = {.cameras = t->cam,
                       .matches = t->match,
                       .limit_px = LIMIT_PX,
                       .n_samples = N_SAMPLES,
                       .rng = sv_rng_make(t->cfg.seed, (uint64_t)e + 1),
                       .solver = t->cfg.solver.absolute ? &t->cfg.solver : NULL};
  if (t->cfg.row_time) { // as it went on to where it is expected
    t->pose[e] = *pose;
    sv_track_find_motion(t, e, 1);
    memcpy(p.motion, t->motion[e], sizeof p.motion);
  }
  for (int i = 0; i < t->n_found; i++) {
    const sv_track_candidate *c = &t->found[i];
    const sv_track_point *x = &t->point[c->i_point];
    if (!x->has_depth) continue;
    t->match_of[p.n] = i;
    t->match[p.n++] = (sv_pose_match){.x = {x->x[0], x->x[1], x->x[2]},
                                      .i_camera = c->i_view,
                                      .uv_px = {c->uv_px[0], c->uv_px[1]},
                                      .sigma_px = c->sigma_px,
                                      .row_s = (float)sv_track_row_s(t, c->i_view, c->uv_px)};
  }
  int n_in = sv_pose_find(&p, pose);
  for (int i = 0; i < p.n; i++) // outliers are dropped
    if (!t->match[i].is_inlier) t->found[t->match_of[i]].sigma_px = 0;
  const bool is_after_gap = t->i_last + 1 < e;
  return n_in >= (is_after_gap ? MIN_AFTER_GAP : MIN_MATCHES) && n_in >= MIN_SHARE * p.n ? n_in : 0;
}

static void take_found(sv_tracker *t) {
  int n = 0, e = t->n_exposures - 1;
  for (int i = 0; i < t->n_live; i++)
    for (int v = 0; v < t->n_views; v++) t->point[t->live[i]].now[v] = -1;
  for (int i = 0; i < t->n_found; i++) {
    const sv_track_candidate *c = &t->found[i];
    if (c->sigma_px <= 0) continue;
    memcpy(t->point[c->i_point].warp[c->i_view], c->warp, sizeof c->warp);
    (void)sv_track_add_obs(t, c->i_point, e, c->i_view, c->uv_px, c->sigma_px);
  }
  for (int i = 0; i < t->n_live; i++) {
    sv_track_point *p = &t->point[t->live[i]];
    p->is_live = false;
    for (int v = 0; v < t->n_views; v++) p->is_live |= p->now[v] >= 0;
    if (p->is_live && !p->has_depth) {
      p->has_depth = sv_track_triangulate(t, p);
      // A point tracked this long without a position is an occlusion edge, or it moves.
      p->is_live = p->has_depth || ++p->n_tries < CAP_TRIES;
    }
    if (!p->is_live) {
      t->free_ref[t->n_free_refs++] = p->i_ref;
      p->i_ref = -1;
      if (!p->has_depth) t->free_point[t->n_free_points++] = t->live[i];
      continue;
    }
    t->live[n++] = t->live[i];
  }
  t->n_live = n;
}

static sv_pose predicted(const sv_tracker *t) { // as it went on last time
  int e = t->n_exposures - 1;
  if (t->i_last != e - 1 || t->i_before != e - 2 || t->i_before < 0) return t->pose[t->i_last];
  sv_pose back = sv_pose_inv(&t->pose[t->i_before]), step = sv_pose_mul(&t->pose[t->i_last], &back);
  return sv_pose_mul(&step, &t->pose[t->i_last]);
}

static bool find_again(sv_tracker *t, sv_pose *pose) {
  sv_pose guess = predicted(t);
  sv_track_follow(t, &guess);
  double way = way_from_start(t);
  *pose = guess;
  int n = sv_track_place(t, t->n_exposures - 1, pose);
  if (n == 0 && t->i_before >= 0) { // it did not go on like that: from where it was
    guess = t->pose[t->i_last];
    sv_track_follow(t, &guess);
    double again = way_from_start(t);
    if (way < 0 || (again >= 0 && again < way)) way = again;
    *pose = guess;
    n = sv_track_place(t, t->n_exposures - 1, pose);
  }
  if (way < 0 && n > 0) way = way_from_origin(t);
  t->has_way[t->n_exposures - 1] = way >= 0;
  if (way > t->still_px) t->still_px = way;
  return n > 0;
}

static sv_status check_pictures(const sv_tracker *t, const sv_image_u8 *image) {
  if (t->n_exposures == t->cfg.cap_exposures) return SV_E_FULL;
  for (int v = 0; v < t->n_views; v++) {
    const sv_image_u8 *im = &image[t->sub_view[v]];
    if (im->width_px != t->width_px[v] || im->height_px != t->height_px[v] || im->n_channels != 3)
      return SV_E_RANGE;
  }
  return SV_OK;
}

// A first exposure in which there is nothing to hold on to.
static void forget_all(sv_tracker *t) {
  t->is_placed[t->n_exposures - 1] = false;
  t->n_live = t->n_points = t->n_obs = t->n_free_points = 0;
  t->n_free_refs = 0;
  for (int i = 0; i < t->cap_refs; i++) t->free_ref[t->n_free_refs++] = i;
}

sv_status sv_tracker_add(sv_tracker *t, const sv_image_u8 *image) {
  sv_status s = check_pictures(t, image);
  if (s < 0) return s;
  int e = t->n_exposures++;
  sv_track_build(t, image);
  t->pose[e] = sv_pose_identity();
  t->is_placed[e] = true;
  t->has_way[e] = e == 0;
  if (t->i_last < 0) {
    sv_track_new_points(t);
    if (t->n_live < MIN_MATCHES) forget_all(t);
  } else {
    t->pose[e] = t->pose[t->i_last];
    t->is_placed[e] = find_again(t, &t->pose[e]);
    if (t->is_placed[e]) {
      sv_track_find_motion(t, e, 1);
      take_found(t);
      sv_track_rematch(t);
      sv_track_new_points(t);
      int n = sv_mini(e + 1, WINDOW + WINDOW_HELD);
      (void)sv_track_adjust(t, &(sv_track_part){e + 1 - n, n, 1, n - WINDOW > 1 ? n - WINDOW : 1, 0},
                            t->cfg.row_time ? ROLLING_ITER : WINDOW_ITER, false);
    }
  }
  if (!t->is_placed[e]) {
    t->i_now = 1 - t->i_now; // the pyramids of the exposure placed last stay
    return SV_AGAIN;
  }
  t->i_before = t->i_last;
  t->i_last = e;
  return SV_OK;
}

// --- the end -------------------------------------------------------------------------------------

static double path_length(const sv_tracker *t) {
  double sum = 0, was[3] = {0}, c[3], d[3];
  bool has = false;
  for (int i = 0; i < t->n_exposures; i++) {
    if (!t->is_placed[i]) continue;
    sv_pose_centre(c, &t->pose[i]);
    sv_sub3(d, c, was);
    if (has) sum += sv_norm3(d);
    has = true;
    memcpy(was, c, sizeof was);
  }
  return sum;
}

// Of more exposures than are adjusted together, every so many-th: those, the keys, are adjusted
// together first, and close the loops. 0: all are. The motion of rolling shutters comes from the
// exposures beside each, so that there they are adjusted in parts alone.
static int key_step(const sv_tracker *t) {
  const int n = t->n_exposures, cap = SV_TRACK_CAP_BUNDLE;
  return n > cap && !t->cfg.row_time ? (n + cap - 1) / cap : 0;
}

// What the adjustment of the key before an exposure did to the world: the world as it is now from
// the one before.
static sv_pose correction(const sv_tracker *t, int e, int step) {
  int i_key = e / step;
  while (i_key > 0 && !t->is_placed[i_key * step]) i_key--;
  const sv_pose back = sv_pose_inv(&t->pose[i_key * step]);
  return sv_pose_mul(&back, &t->key_before[i_key]);
}

static void adjust_keys(sv_tracker *t, const sv_track_part *keys) {
  const int step = keys->step;
  for (int i = 0; i < keys->n; i++) t->key_before[i] = t->pose[i * step];
  (void)sv_track_adjust(t, keys, FINAL_ITER, false);
  // Exposures between keys, and the points that no two keys see, go with the key before them.
  for (int e = 0; e < t->n_exposures; e++) {
    const sv_pose now = correction(t, e, step), was = sv_pose_inv(&now);
    if (e % step != 0) t->pose[e] = sv_pose_mul(&t->pose[e], &was);
  }
  for (int i = 0, at = 0; i < t->n_points; i++) {
    sv_track_point *p = &t->point[i];
    const bool is_adjusted = at < t->bundle.n_points && t->bundle_point[at] == i;
    if (is_adjusted) at++;
    if (is_adjusted || !p->has_depth) continue;
    const sv_pose now = correction(t, t->obs[p->first_obs].i_exposure, step);
    sv_pose_apply(p->x, &now, (const double[3]){p->x[0], p->x[1], p->x[2]});
  }
}

// All exposures at once; or the keys, and then as many as fit, each part held by the keys and by
// the end of the last.
static void adjust_all(sv_tracker *t, sv_track_summary *out) {
  const int n = t->n_exposures, cap = SV_TRACK_CAP_BUNDLE, held = cap / 6, step = key_step(t);
  const sv_track_part keys = {0, step ? (n + step - 1) / step : 0, step, 1, 0};
  for (int round = 0; round < FINAL_ROUNDS; round++) {
    double sum = 0, n_obs = 0;
    if (step) adjust_keys(t, &keys);
    for (int at = 0; at == 0 || at + held < n; at += cap - held) {
      const sv_track_part part = {at, sv_mini(cap, n - at), 1, at ? held : 1, step};
      sv_bundle_result r = sv_track_adjust(t, &part, FINAL_ITER, t->cfg.has_extrinsics && n <= cap);
      sum += r.n_obs * r.rms_px * r.rms_px;
      n_obs += r.n_obs;
    }
    out->rms_px = n_obs > 0 ? sqrt(sum / n_obs) : 0;
  }
  // The scale is one: what the part knows that knows it best. Held poses would seem to know it
  // exactly.
  out->scale_sigma = step && t->n_views > 1 ? sv_track_scale_sigma(t, &keys) : -1;
  for (int at = 0; t->n_views > 1 && (at == 0 || at + held < n); at += cap - held) {
    double sigma = sv_track_scale_sigma(t, &(sv_track_part){at, sv_mini(cap, n - at), 1, 1, 0});
    if (sigma >= 0 && (out->scale_sigma < 0 || sigma < out->scale_sigma)) out->scale_sigma = sigma;
  }
  // Points that were followed without depth may have one now, for the cloud.
  for (int i = 0; i < t->n_points; i++)
    if (!t->point[i].has_depth && t->point[i].first_obs != t->point[i].last_obs)
      t->point[i].has_depth = sv_track_triangulate(t, &t->point[i]);
}

// One pose for all that tell a way; the points follow, and what moved before the rig is given up.
static void stand_still(sv_tracker *t, sv_track_summary *out) {
  int n = sv_mini(t->n_exposures, SV_TRACK_CAP_BUNDLE);
  for (int i = 0; i < t->n_exposures; i++) {
    t->pose[i] = sv_pose_identity();
    t->is_placed[i] = t->has_way[i];
  }
  for (int round = 0; round < FINAL_ROUNDS; round++)
    out->rms_px = sv_track_adjust(t, &(sv_track_part){0, n, 1, n, 0}, FINAL_ITER, false).rms_px;
}

void sv_tracker_finish(sv_tracker *t, const sv_track_pictures *again, sv_track_summary *out) {
  memset(out, 0, sizeof *out);
  out->n_exposures = t->n_exposures;
  out->still_px = t->still_px;
  out->is_still = t->i_last >= 0 && t->is_placed[0] && t->still_px >= 0 && t->still_px < STILL_PX;
  out->scale_sigma = -1;
  if (out->is_still) stand_still(t, out);
  else if (t->i_last >= 0) {
    if (again) out->n_seen_again = sv_track_close_loops(t, again);
    adjust_all(t, out);
  }
  sv_track_find_motion(t, 0, t->n_exposures);
  for (int i = 0; i < t->n_exposures; i++) out->n_placed += t->is_placed[i];
  for (int i = 0; i < t->n_points; i++) out->n_points += t->point[i].has_depth;
  out->path_m = path_length(t);
}
