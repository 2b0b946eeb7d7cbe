// SPDX-License-Identifier: Apache-2.0
// A rig at the size that its cameras deliver, and at the size that is trained on.
#include <string.h>

#include "boards/board_main.h"

static bool is_reduced(const sv_reduction *r) { return r->k > 1 || r->width_px > 0; }

// The simulator's rig is its own: what is changed is a copy.
static sv_status copy_rig(board_source *s, sv_arena *arena, sv_err *err) {
  if (s->rig == &s->rig_read) return SV_OK;
  const sv_rig *from = s->rig;
  sv_sub_view *views = SV_TAKE(arena, sv_sub_view, from->n_sub_views);
  if (!views) return sv_fail(err, SV_E_NOMEM, "no room for a rig");
  memcpy(views, from->sub_views, (size_t)from->n_sub_views * sizeof *views);
  s->rig_read = *from;
  s->rig_read.sub_views = views;
  s->rig_read.cap_sub_views = from->n_sub_views;
  s->rig = &s->rig_read;
  return SV_OK;
}

static void tell(board_source *s, const sv_sub_view *was, const sv_sub_view *v, sv_size_fit how) {
  if (how == SV_FIT_SAME || s->note[0]) return;
  sv_fmt(s->note, sizeof s->note, "the rig was calibrated at %dx%d pixels and is used at %dx%d%s",
         was->model.width_px, was->model.height_px, v->model.width_px, v->model.height_px,
         how == SV_FIT_REPORTED
             ? ""
             : "; both are taken to show the same field, as nothing else is reported (\"sensor\" in "
               "rig.json)");
}

// The mask of what the sub-view was, as map takes it to what it is now.
static sv_status move_mask(sv_sub_view *v, const sv_sub_view *was, const sv_image_map *map, sv_arena *arena,
                           sv_err *err) {
  const int w = v->model.width_px, h = v->model.height_px;
  uint8_t *mask = SV_TAKE(arena, uint8_t, (size_t)w * (size_t)h);
  if (!mask) return sv_fail(err, SV_E_NOMEM, "no room for a mask of %dx%d pixels", w, h);
  sv_mask_map(&(sv_mask_image){v->mask, was->model.width_px, was->model.height_px}, map,
              &(sv_mask_image){NULL, w, h}, mask);
  v->mask = mask;
  return SV_OK;
}

sv_status sizes_reduce(sv_sub_view *v, const sv_reduction *r, sv_arena *arena, sv_err *err) {
  const sv_sub_view was = *v;
  sv_image_map map;
  const sv_status s = sv_sub_view_reduce(v, r, &map, err);
  return s < 0 || !v->mask ? s : move_mask(v, &was, &map, arena, err);
}

static sv_status fit_one(board_source *s, sv_sub_view *v, const source_cfg *cfg, sv_arena *arena,
                         sv_err *err) {
  const sv_camera_caps *c = &s->caps[v->i_camera];
  const sv_image_mode frame = {c->width_px, c->height_px, c->area};
  const sv_sub_view was = *v;
  sv_image_map fitted, reduced = {{1, 1}, {0, 0}};
  sv_size_fit how;
  sv_status r = sv_sub_view_fit(v, &frame, &how, &fitted, err);
  if (r < 0) return r;
  tell(s, &was, v, how);
  if (is_reduced(&cfg->reduction)) r = sv_sub_view_reduce(v, &cfg->reduction, &reduced, err);
  if (r < 0 || !v->mask || (how == SV_FIT_SAME && !v->source_width_px)) return r;
  const sv_image_map map = sv_image_map_then(&fitted, &reduced);
  return move_mask(v, &was, &map, arena, err);
}

sv_status sizes_fit(board_source *s, const source_cfg *cfg, sv_arena *arena, sv_err *err) {
  if (is_reduced(&cfg->reduction) && s->rig->forward == SV_FORWARD_MULTIPLEXED)
    return sv_fail(
        err, SV_E_UNSUPPORTED,
        "--scale and --size are not for multiplexed sensors, whose sums of light are trained as they are");
  if (s->kind == SOURCE_SIM && !is_reduced(&cfg->reduction)) return SV_OK; // it renders its own rig
  sv_status r = copy_rig(s, arena, err);
  for (int i = 0; r >= 0 && i < s->rig->n_sub_views; i++)
    r = fit_one(s, &s->rig_read.sub_views[i], cfg, arena, err);
  return r;
}

// --- readout times -------------------------------------------------------------------------------

sv_status shutters_read(board_source *s, sv_arena *arena, sv_err *err) {
  sv_status r = copy_rig(s, arena, err);
  for (int i = 0; r >= 0 && i < s->rig->n_sub_views; i++) {
    sv_sub_view *v = &s->rig_read.sub_views[i];
    const sv_ns ns = s->caps[v->i_camera].readout_ns;
    if (v->shutter.readout_s > 0) continue;
    if (ns <= 0)
      r = sv_fail(
          err, SV_E_NOT_FOUND,
          "--shutter rolling: camera %d does not report how long it reads a frame; write \"readout_ms\" into "
          "rig.json, or measure it with 'subview-calibrate shutter'",
          v->i_camera);
    else v->shutter.readout_s = sv_ns_to_s(ns);
  }
  return r;
}
