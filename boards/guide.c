// SPDX-License-Identifier: Apache-2.0
#include "boards/guide.h"

#include "src/base/mathx.h"
#include "src/capture/meter.h"

#define PERIOD_NS (200 * SV_NS_PER_MS) // between two exposures whose compressed frames are decoded

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

sv_status guide_init(capture_guide *g, const board_source *src, double arc_deg, sv_arena *arena,
                     sv_err *err) {
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
  return sv_convert_init(&g->convert, &cc, arena, err);
}

static bool meter(capture_guide *g, const sv_frame *f, const sv_kernels *k, sv_meter *out) {
  sv_image_u8 image;
  sv_err err;
  const sv_pool pool = sv_pool_serial();
  if (sv_pixel(f->format)->layout != SV_LAYOUT_CODED) return sv_meter_frame(f, out);
  return sv_convert_frame(&g->convert, f, k, &pool, &image, &err) >= 0 && sv_meter_image(&image, out);
}

void guide_exposure(capture_guide *g, const sv_exposure_slot *slot, const sv_kernels *k) {
  const sv_exposure *e = &slot->exposure;
  sv_meter_sum all = {{0}, 0};
  for (int i = 0; e->time_ns >= g->next_ns && i < g->src->source.n_cameras; i++) {
    sv_meter m;
    if (slot->frames[i].i_camera < 0 || slot->frames[i].is_error) continue;
    if (meter(g, &slot->frames[i], k, &m)) sv_meter_sum_add(&all, &m);
  }
  sv_convert_forget(&g->convert);
  if (e->time_ns >= g->next_ns) g->next_ns = e->time_ns + PERIOD_NS;
  const sv_guidance_shot shot = sv_meter_shot(&all, &g->recent, e->has_pose ? &e->rig_from_world : NULL);
  sv_guidance_keep(&g->guidance, &shot);
  sv_guidance_look(&g->guidance, &shot);
}
