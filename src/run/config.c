// SPDX-License-Identifier: Apache-2.0
#include "src/run/config.h"

#include "src/base/mathx.h"
#include "src/capture/measurements.h"
#include "src/train/driver.h"
#include "src/run/moving.h"

bool sv_app_is_trained_on(const sv_app_cfg *c, int i_sub) {
  uint64_t any = 0;
  for (size_t i = 0; i < sizeof c->sub_view_mask / sizeof *c->sub_view_mask; i++) any |= c->sub_view_mask[i];
  return !any || (c->sub_view_mask[i_sub / 64] >> (i_sub % 64) & 1);
}

int sv_app_n_trained_sub_views(const sv_app_cfg *c) {
  int n = 0;
  for (int i = 0; i < c->rig->n_sub_views; i++) n += sv_app_is_trained_on(c, i);
  return n;
}

static bool is_multiplexed(const sv_app_cfg *c) { return c->rig->forward == SV_FORWARD_MULTIPLEXED; }

// Sensors instead of views, by regions.
static void plan_measurements(const sv_app_cfg *c, sv_train_cfg *t) {
  t->cap_views = 0;
  t->cap_measurements = c->n_exposures * sv_measurements_n_sensors(c->rig, c->n_cameras);
  t->cap_regions = 0;
  if (t->region_px < 1) return; // the trainer says so
  t->cap_width_px = t->cap_height_px = t->region_px;
  t->cap_pixels = sv_plane_floats(t->region_px, t->region_px);
  t->cap_lenses = c->n_exposures * c->rig->n_sub_views;
  for (int i = 0; i < c->rig->n_sub_views; i++) {
    const sv_footprint *f = &c->rig->sub_views[i].footprint;
    t->cap_lens_width_px = sv_maxi(t->cap_lens_width_px, f->width_px);
    t->cap_lens_height_px = sv_maxi(t->cap_lens_height_px, f->height_px);
  }
  t->cap_lens_px = (size_t)t->cap_lens_width_px * (size_t)t->cap_lens_height_px;
  for (int i = 0; i < c->n_cameras; i++)
    if (sv_measurements_has_lens(c->rig, i))
      t->cap_regions +=
          c->n_exposures * sv_train_n_regions(c->caps[i].width_px, c->caps[i].height_px, t->region_px);
}

sv_prior_cfg sv_app_prior_cfg(const sv_app_cfg *c, int n_views) {
  sv_prior_cfg p = {0};
  if (c->prior) sv_prior_set_method(&p, c->prior, n_views);
  return p;
}

int sv_appearance_mode_by_name(const char *name) {
  static const char *const names[] = {"auto", "off", "cameras", "exposures"};
  for (int i = 0; i < 4; i++)
    if (sv_str_eq(name, names[i])) return i;
  return -1;
}

// All cameras are calibrated photometrically, and see with the exposure, gain and white balance
// that this holds for.
static bool is_calibrated(const sv_app_cfg *c) {
  if (c->is_deep) return false; // deep pictures are not corrected
  for (int i = 0; i < c->n_cameras; i++)
    if (!c->caps[i].is_light_shared) return false;
  for (int i = 0; i < c->rig->n_sub_views; i++)
    if (sv_app_is_trained_on(c, i) && !c->rig->sub_views[i].photometric.is_known) return false;
  return true;
}

// Sensors whose lens images overlap have but one camera's color.
static void plan_appearance(const sv_app_cfg *c, sv_train_cfg *t) {
  bool is_known = true, is_locked = true;
  for (int i = 0; i < c->n_cameras; i++) {
    is_known &= c->caps[i].is_color_known;
    is_locked &= c->caps[i].is_light_locked || (c->is_deep && c->caps[i].is_exposure_told);
  }
  sv_appearance_mode mode = c->appearance;
  if (mode == SV_APPEARANCE_AUTO)
    mode = !is_locked && !c->is_continuous  ? SV_APPEARANCE_EXPOSURES
           : !is_known && !is_calibrated(c) ? SV_APPEARANCE_CAMERAS
                                            : SV_APPEARANCE_OFF;
  if (mode == SV_APPEARANCE_OFF || is_multiplexed(c)) return;
  t->appearance.n_cameras = c->n_cameras;
  t->appearance.n_exposures = mode == SV_APPEARANCE_EXPOSURES ? c->n_exposures : 0;
}

// Only where sub-views that are trained on are read line by line.
static bool is_rolling(const sv_app_cfg *c) {
  if (c->is_shutter_ignored || c->is_dynamic || is_multiplexed(c)) return false;
  for (int i = 0; i < c->rig->n_sub_views; i++)
    if (sv_app_is_trained_on(c, i) && c->rig->sub_views[i].shutter.readout_s > 0) return true;
  return false;
}

sv_train_cfg sv_app_train_cfg(const sv_app_cfg *c, int n_threads) {
  sv_train_cfg t = c->train;
  t.cap_views = c->n_exposures * sv_app_n_trained_sub_views(c);
  t.n_threads = n_threads;
  t.cap_width_px = t.cap_height_px = 1;
  t.cap_pixels = 0;
  if (c->steps) t.expected_steps = (int)c->steps;
  if (is_multiplexed(c)) plan_measurements(c, &t);
  sv_focal_range focal = {0};
  int largest_px = 0;
  for (int i = 0; i < c->rig->n_sub_views; i++) {
    const sv_camera_model *m = &c->rig->sub_views[i].model;
    size_t px = sv_plane_floats(m->width_px, m->height_px);
    t.cap_width_px = sv_maxi(t.cap_width_px, m->width_px);
    t.cap_height_px = sv_maxi(t.cap_height_px, m->height_px);
    if (px > t.cap_pixels) t.cap_pixels = px;
    if (!sv_app_is_trained_on(c, i)) continue;
    sv_focal_range_add(&focal, (float)m->p[0]);
    largest_px = sv_maxi(largest_px, m->width_px * m->height_px);
  }
  if (sv_focal_range_needs_antialiasing(&focal)) t.is_antialiased = true;
  const sv_sampling sampling = {.n_exposures = c->n_exposures,
                                .is_moving = c->is_dynamic,
                                .n_sub_views = sv_app_n_trained_sub_views(c),
                                .largest_px = largest_px,
                                .is_multiplexed = is_multiplexed(c)};
  sv_driver_set_objective(&t, &sampling, c->optimizer);
  if (c->is_continuous) t.hidden_every = 0; // earlier exposures may have seen it
  const sv_prior_cfg prior = sv_app_prior_cfg(c, t.cap_views);
  sv_prior_prepare(&prior, &t);
  if (c->is_refining) {
    t.poses = sv_train_poses_defaults();
    t.poses.cap_poses = c->n_exposures;
  }
  plan_appearance(c, &t);
  t.is_deep = c->is_deep;
  t.is_rolling = is_rolling(c);
  if (c->is_dynamic) sv_app_plan_moving(c, &t);
  return t;
}
