// SPDX-License-Identifier: Apache-2.0
#include "boards/guide.h"

#include "src/base/mathx.h"
#include "src/capture/meter.h"

#define PERIOD_NS  (200 * SV_NS_PER_MS) // between two exposures that are looked at
#define SIDE_PX    640                  // odometry's pictures are made smaller than that
#define CAP_PLACED 400                  // exposures that odometry looks at
#define MIN_POINTS 20                   // from which on they tell where the scene is

sv_guidance_cfg guide_cfg(const board_source *s, double arc_deg) {
  sv_guidance_cfg c = {.rig = s->rig, .arc_deg = arc_deg};
  if (s->has_bounds) c.bounds = s->bounds;
  if (s->kind != SOURCE_SIM || s->u.sim.cfg.has_unknown_poses) return c;
  c.up[2] = 1; // platform/sim/sim.h
  if (arc_deg > 0) return c;
  // Round its arc's middle; a rig that stands asks for one direction.
  const double arc = s->u.sim.cfg.arc_deg, middle = SV_SIM_ARC_MIDDLE_DEG * SV_PI / 180;
  c.arc_deg = sv_maxd(arc, 1);
  c.middle[0] = sv_cos(middle);
  c.middle[1] = sv_sin(middle);
  return c;
}

// The rig with pictures of at most SIDE_PX a side.
static sv_status small_rig(sv_rig *out, const sv_rig *rig, sv_arena *arena, sv_err *err) {
  sv_status s = SV_OK;
  *out = *rig;
  out->sub_views = SV_TAKE(arena, sv_sub_view, rig->n_sub_views);
  if (!out->sub_views) return sv_fail(err, SV_E_NOMEM, "no room for a rig");
  for (int i = 0; s >= 0 && i < rig->n_sub_views; i++) {
    sv_sub_view *v = &out->sub_views[i];
    *v = rig->sub_views[i];
    const int side = sv_maxi(v->model.width_px, v->model.height_px);
    const sv_reduction r = {.k = (side + SIDE_PX - 1) / SIDE_PX};
    if (r.k > 1) s = sizes_reduce(v, &r, arena, err);
  }
  return s;
}

static sv_status init_odometry(capture_guide *g, const sv_kernels *k, sv_arena *arena, sv_err *err) {
  const board_source *src = g->src;
  if (!src->rig || source_tells_poses(src) || !sv_odometry_can(src->rig, CAP_PLACED)) return SV_OK;
  sv_status s = small_rig(&g->rig, src->rig, arena, err);
  const sv_exposures_cfg ec = {.rig = &g->rig,
                               .cap_exposures = 1,
                               .caps = src->caps,
                               .n_cameras = src->source.n_cameras,
                               .n_threads = 1,
                               .decoder = &src->decoder};
  const sv_odometry_cfg oc = {.rig = &g->rig,
                              .cap_exposures = CAP_PLACED,
                              .pool = &g->pool,
                              .k = k,
                              .seed = 1,
                              .is_rolling = sv_rig_is_rolling(&g->rig)};
  if (s >= 0) s = sv_exposures_init(&g->pool, &ec, arena, err);
  if (s >= 0) s = sv_odometry_init(&g->odometry, &oc, arena, err);
  if (s != SV_E_RANGE) return s;
  g->odometry.is_on = false; // a lens that odometry cannot see through is recorded all the same
  return SV_OK;
}

sv_status guide_init(capture_guide *g, const board_source *src, double arc_deg, const sv_kernels *k,
                     sv_arena *arena, sv_err *err) {
  static sv_camera_caps coded[SV_CAP_SUB_VIEWS]; // all others are read as they are
  const int n = src->source.n_cameras;
  const sv_guidance_cfg cfg = guide_cfg(src, arc_deg);
  *g = (capture_guide){.src = src};
  sv_guidance_init(&g->guidance, &cfg);
  for (int i = 0; i < n; i++) {
    coded[i] = src->caps[i];
    if (sv_pixel(coded[i].format)->layout != SV_LAYOUT_CODED) coded[i].format = SV_PIX_RGB8;
  }
  const sv_convert_cfg cc = {coded, n, 1, &src->decoder};
  const sv_status s = sv_convert_init(&g->convert, &cc, arena, err);
  return s < 0 ? s : init_odometry(g, k, arena, err);
}

static bool meter(capture_guide *g, const sv_frame *f, const sv_kernels *k, sv_meter *out) {
  sv_image_u8 image;
  sv_err err;
  const sv_pool pool = sv_pool_serial();
  if (sv_pixel(f->format)->layout != SV_LAYOUT_CODED) return sv_meter_frame(f, out);
  return sv_convert_frame(&g->convert, f, k, &pool, &image, &err) >= 0 && sv_meter_image(&image, out);
}

// Where odometry sees the rig; NULL: nowhere. A picture that cannot be decoded costs its exposure.
static const sv_pose *find_pose(capture_guide *g, const sv_exposure_slot *slot, const sv_kernels *k) {
  sv_odometry *o = &g->odometry;
  const int i = o->tracker.n_exposures;
  const sv_pool serial = sv_pool_serial();
  sv_err err;
  if (!o->is_on || i == CAP_PLACED) return NULL;
  g->pool.i_next = 0;
  if (sv_exposures_add(&g->pool, &slot->exposure, slot->frames, k, &serial, &err) != SV_OK) return NULL;
  if (sv_odometry_add(o, &g->pool, 0) < 0) return NULL;
  const int n = sv_odometry_cloud(o, g->cloud, GUIDE_CAP_CLOUD);
  const sv_bounds ball = sv_odometry_bounds(o);
  if (n >= MIN_POINTS) sv_guidance_set_scene(&g->guidance, &ball, g->cloud, n);
  return o->tracker.is_placed[i] ? &o->tracker.pose[i] : NULL;
}

void guide_exposure(capture_guide *g, const sv_exposure_slot *slot, const sv_kernels *k) {
  const sv_exposure *e = &slot->exposure;
  const bool is_due = e->time_ns >= g->next_ns;
  const sv_pose *pose = e->has_pose ? &e->rig_from_world : is_due ? find_pose(g, slot, k) : NULL;
  sv_meter_sum all = {{0}, 0};
  for (int i = 0; is_due && i < g->src->source.n_cameras; i++) {
    sv_meter m;
    if (slot->frames[i].i_camera < 0 || slot->frames[i].is_error) continue;
    if (meter(g, &slot->frames[i], k, &m)) sv_meter_sum_add(&all, &m);
  }
  sv_convert_forget(&g->convert);
  if (is_due) g->next_ns = e->time_ns + PERIOD_NS;
  const sv_guidance_shot shot = sv_meter_shot(&all, &g->recent, pose);
  sv_guidance_keep(&g->guidance, &shot);
  sv_guidance_look(&g->guidance, &shot);
}
