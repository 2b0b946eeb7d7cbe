// SPDX-License-Identifier: Apache-2.0
#include "src/capture/odometry.h"

#include <string.h>

#include "src/base/mathx.h"

#define MIN_POINTS  40 // of a trajectory that is trusted
#define MIN_LOCATED 2

bool sv_odometry_can(const sv_rig *rig, int n_exposures) {
  return rig->forward != SV_FORWARD_MULTIPLEXED && n_exposures > 1;
}

static sv_status carve_crops(sv_odometry *o, const sv_odometry_cfg *cfg, sv_arena *a, sv_err *err) {
  const sv_rig *rig = cfg->rig;
  o->crop = SV_TAKE(a, sv_odometry_crop, rig->n_sub_views);
  for (int i = 0; i < rig->n_sub_views; i++) {
    sv_lens_view view;
    if (o->crop) o->crop[i] = (sv_odometry_crop){.px = NULL};
    if (!sv_lens_view_make(&view, &rig->sub_views[i].model) || !view.is_fisheye) continue;
    const sv_camera_model *m = &view.model;
    const size_t n = (size_t)m->width_px * (size_t)m->height_px;
    sv_remap_tap *entries = SV_TAKE(a, sv_remap_tap, n);
    uint8_t *px = SV_TAKE(a, uint8_t, 3 * n), *mask = SV_TAKE(a, uint8_t, n);
    if (!o->crop || !mask || !cfg->pool) continue;
    sv_lens_view pinhole = {.model = *m};
    o->crop[i].px = px;
    o->crop[i].mask = mask;
    if (!sv_pinhole_for_model(m, SV_PINHOLE_CROP_TO_VALID, &pinhole.model) ||
        sv_remap_build(&o->crop[i].map, m, &pinhole.model, entries) < 0 ||
        (o->row_time &&
         sv_exposures_row_time(&rig->sub_views[i], cfg->pool->cfg.caps, &pinhole, &o->row_time[i]) < 0))
      return sv_fail(err, SV_E_RANGE,
                     "rig \"%s\", sub-view \"%s\": the lens leaves no rectangular view for odometry",
                     rig->name, rig->sub_views[i].name);
    o->model[i] = pinhole.model;
  }
  return SV_OK;
}

static void crop_image(const sv_odometry_crop *c, sv_image_u8 *im) {
  const sv_remap_job job = {
      im->px, (size_t)im->stride_bytes, 3, c->px, NULL, 0, c->map.height_px,
  };
  sv_remap_apply(&c->map, &job);
  for (int y = 0; im->mask && y < c->map.height_px; y++)
    for (int x = 0; x < c->map.width_px; x++)
      c->mask[(size_t)y * (size_t)c->map.width_px + (size_t)x] = sv_remap_counts(&c->map, im->mask, x, y);
  *im = (sv_image_u8){c->px, c->map.width_px,     c->map.height_px,
                      3,     3 * c->map.width_px, im->mask ? c->mask : NULL};
}

sv_status sv_odometry_init(sv_odometry *o, const sv_odometry_cfg *cfg, sv_arena *a, sv_err *err) {
  const sv_rig *rig = cfg->rig;
  const sv_exposures *pool = cfg->pool;
  sv_track_cfg c = sv_track_defaults();
  memset(o, 0, sizeof *o);
  sv_arena_part_begin(a, "odometry");
  o->model = SV_TAKE(a, sv_camera_model, rig->n_sub_views);
  o->image = SV_TAKE(a, sv_image_u8, rig->n_sub_views);
  o->a = SV_TAKE(a, sv_pose, cfg->cap_exposures);
  o->b = SV_TAKE(a, sv_pose, cfg->cap_exposures);
  for (int i = 0; o->model && pool && i < rig->n_sub_views; i++) o->model[i] = pool->sub[i].lens.model;
  if (cfg->is_rolling) o->row_time = SV_TAKE(a, sv_row_time, rig->n_sub_views);
  for (int i = 0; o->row_time && pool && i < rig->n_sub_views; i++) o->row_time[i] = pool->sub[i].row_time;
  // On a dry arena, any address: it is not looked at.
  c.row_time = cfg->is_rolling && !o->row_time ? &(sv_row_time){0} : o->row_time;
  sv_status cropped = carve_crops(o, cfg, a, err);
  if (cropped < 0) return cropped;
  c.rig = rig;
  c.model = o->model;
  c.cap_exposures = cfg->cap_exposures;
  c.seed = cfg->seed;
  c.heartbeats = cfg->heartbeats;
  o->imu = cfg->imu;
  o->is_on = true;
  if (a->base) {
    sv_status s = sv_tracker_init(&o->tracker, &c, cfg->k, a, err);
    if (s < 0) return s;
    o->work = SV_TAKE(a, float, o->tracker.cap_points);
    return a->status;
  }
  SV_TAKE(a, uint8_t, sv_tracker_bytes(&c));
  SV_TAKE(a, float, sv_tracker_cap_points(&c));
  return SV_OK;
}

typedef struct {
  sv_odometry *odometry;
  const sv_exposures *pool;
} pictures;

// The pictures of an exposure, until the next call.
static const sv_image_u8 *get_pictures(void *self, int e) {
  const pictures *p = self;
  sv_odometry *o = p->odometry;
  sv_view view;
  for (int i = 0; i < p->pool->cfg.rig->n_sub_views; i++) {
    sv_exposures_get(p->pool, e, i, &o->image[i], &view);
    if (o->crop[i].px) crop_image(&o->crop[i], &o->image[i]);
  }
  return o->image;
}

sv_status sv_odometry_add(sv_odometry *o, const sv_exposures *pool, int e) {
  if (o->tracker.n_exposures == 0) o->start_ns = pool->exposure[e].time_ns;
  sv_tracker_set_time(&o->tracker, sv_ns_to_s(pool->exposure[e].time_ns - o->start_ns));
  return sv_tracker_add(&o->tracker, get_pictures(&(pictures){o, pool}, e));
}

// The mean of the accelerations at all exposures, in the world.
static bool up_of_imu(const sv_odometry *o, const sv_exposures *pool, double up[3]) {
  double a[3], sum[3] = {0};
  for (int e = 0; o->imu && e < o->tracker.n_exposures; e++) {
    const double *r = o->tracker.pose[e].r;
    if (!o->tracker.is_placed[e] || !sv_imu_at(o->imu, pool->exposure[e].time_ns, a)) continue;
    for (int k = 0; k < 3; k++) sum[k] += r[k] * a[0] + r[3 + k] * a[1] + r[6 + k] * a[2];
  }
  const double n = sv_norm3(sum);
  for (int k = 0; k < 3; k++) up[k] = n > 0 ? sum[k] / n : 0;
  return n > 0;
}

void sv_odometry_finish(sv_odometry *o, sv_exposures *pool) {
  sv_track_summary *s = &o->summary;
  sv_tracker_finish(&o->tracker, &(sv_track_pictures){&(pictures){o, pool}, get_pictures}, s);
  // Of a rig that stands, exposures that show something else are left out, not taken from the same
  // place.
  const bool is_whole = s->is_still && s->n_placed == s->n_exposures;
  o->is_tracked = !is_whole && s->n_placed >= MIN_LOCATED && s->n_points >= MIN_POINTS;
  if (!o->is_tracked) return;
  double up[3];
  if (up_of_imu(o, pool, up) || sv_track_up(&o->tracker, up)) sv_track_turn_upright(&o->tracker, up);
  for (int e = 0; e < s->n_exposures; e++) {
    pool->exposure[e].rig_from_world = o->tracker.pose[e];
    pool->exposure[e].has_pose = o->tracker.is_placed[e];
    pool->exposure[e].has_motion = o->tracker.motion && o->tracker.is_placed[e];
    if (pool->exposure[e].has_motion)
      memcpy(pool->exposure[e].motion, o->tracker.motion[e], sizeof o->tracker.motion[e]);
  }
}

sv_bounds sv_odometry_bounds(sv_odometry *o) {
  const sv_tracker *t = &o->tracker;
  sv_bounds b = {{0, 0, 0}, 0};
  int n = 0;
  for (int k = 0; k < 3; k++) {
    n = 0;
    for (int i = 0; i < t->n_points; i++)
      if (t->point[i].has_depth) o->work[n++] = (float)t->point[i].x[k];
    b.centre[k] = sv_track_rank(o->work, n, n / 2);
  }
  n = 0;
  for (int i = 0; i < t->n_points; i++) {
    if (!t->point[i].has_depth) continue;
    double d[3], c[3] = {(double)b.centre[0], (double)b.centre[1], (double)b.centre[2]};
    sv_sub3(d, t->point[i].x, c);
    o->work[n++] = (float)sv_norm3(d);
  }
  b.radius = 1.2f * sv_track_rank(o->work, n, n * 9 / 10);
  return b;
}

int sv_odometry_cloud(const sv_odometry *o, sv_point *point, int n) {
  const sv_tracker *t = &o->tracker;
  int n_all = 0, i_all = 0, n_out = 0;
  for (int i = 0; i < t->n_points; i++) n_all += t->point[i].has_depth;
  for (int i = 0; i < t->n_points && n_out < n; i++) {
    const sv_track_point *p = &t->point[i];
    if (!p->has_depth) continue;
    // Evenly over the list when not all fit: it is in the order in which they were found.
    bool is_taken = n_all <= n || (int64_t)(i_all + 1) * n / n_all > (int64_t)i_all * n / n_all;
    i_all++;
    if (!is_taken) continue;
    for (int k = 0; k < 3; k++) {
      point[n_out].mean[k] = (float)p->x[k];
      point[n_out].rgb[k] = (float)p->rgb[k] / 255.0f;
    }
    n_out++;
  }
  return n_out;
}

sv_similarity sv_odometry_from(sv_odometry *o, const sv_exposures *pool,
                               void (*pose_at)(void *self, sv_ns time_ns, sv_pose *rig_from_world),
                               void *self) {
  int n = 0;
  for (int e = 0; e < pool->n; e++) {
    if (!pool->exposure[e].has_pose) continue;
    pose_at(self, pool->exposure[e].time_ns, &o->a[n]);
    o->b[n++] = pool->exposure[e].rig_from_world;
  }
  if (n == 0) return (sv_similarity){.s = 1, .r = {1, 0, 0, 0, 1, 0, 0, 0, 1}};
  return sv_align_trajectories(o->a, o->b, n, true);
}

sv_view sv_odometry_view(const sv_similarity *q, const sv_view *v) {
  sv_pose p;
  for (int i = 0; i < 9; i++) p.r[i] = (double)v->r[i];
  for (int i = 0; i < 3; i++) p.t[i] = (double)v->t[i];
  p = sv_similarity_apply(q, &p);
  sv_view out = *v;
  for (int i = 0; i < 9; i++) out.r[i] = (float)p.r[i];
  for (int i = 0; i < 3; i++) out.t[i] = (float)p.t[i];
  return out;
}
