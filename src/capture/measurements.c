// SPDX-License-Identifier: Apache-2.0
#include "src/capture/measurements.h"

#include <string.h>

#include "src/base/mathx.h"

#define ROWS_PER_TASK 16

// A sub-view that names no place has its sensor to itself.
static sv_footprint footprint_of(const sv_sub_view *v) {
  sv_footprint f = v->footprint;
  if (!f.width_px) {
    f.width_px = v->model.width_px;
    f.height_px = v->model.height_px;
  }
  return f;
}

bool sv_measurements_has_lens(const sv_rig *rig, int i_camera) {
  for (int i = 0; i < rig->n_sub_views; i++)
    if (rig->sub_views[i].i_camera == i_camera) return true;
  return false;
}

int sv_measurements_n_sensors(const sv_rig *rig, int n_cameras) {
  int n = 0;
  for (int c = 0; c < n_cameras; c++) n += sv_measurements_has_lens(rig, c);
  return n;
}

// --- start ---------------------------------------------------------------------------------------

static void carve(sv_measurements *c, const sv_measurements_cfg *cfg, sv_arena *a) {
  int n = sv_measurements_n_sensors(cfg->rig, cfg->n_cameras), i = 0, i_lens = 0, widest = 0;
  c->n_sensors = n;
  c->sensor = SV_TAKE(a, sv_sensor, n);
  c->exposure_values = 0;
  for (int cam = 0; cam < cfg->n_cameras; cam++) {
    if (!sv_measurements_has_lens(cfg->rig, cam)) continue;
    sv_sensor s = {.i_camera = cam,
                   .width_px = cfg->caps[cam].width_px,
                   .height_px = cfg->caps[cam].height_px,
                   .i_lens = i_lens,
                   .at = c->exposure_values};
    for (int v = 0; v < cfg->rig->n_sub_views; v++) s.n_lenses += cfg->rig->sub_views[v].i_camera == cam;
    i_lens += s.n_lenses;
    widest = sv_maxi(widest, s.width_px);
    c->exposure_values += 3 * (size_t)s.width_px * (size_t)s.height_px;
    if (c->sensor) c->sensor[i++] = s;
  }
  c->lens = SV_TAKE(a, sv_lens, (size_t)cfg->cap_exposures * (size_t)cfg->rig->n_sub_views);
  c->px = SV_TAKE(a, uint16_t, (size_t)cfg->cap_exposures * c->exposure_values);
  c->row = SV_TAKE(a, float, widest);
}

// The lenses of all sensors as they are in one exposure.
static void place(const sv_measurements *c, sv_lens *lens, const sv_exposure *exposure) {
  const sv_rig *rig = c->cfg.rig;
  for (int s = 0; s < c->n_sensors; s++)
    for (int i = 0; i < rig->n_sub_views; i++) {
      const sv_sub_view *v = &rig->sub_views[i];
      const sv_camera_model *m = &v->model;
      if (v->i_camera != c->sensor[s].i_camera) continue;
      sv_pose cam_from_world = sv_pose_mul(&v->cam_from_rig, &exposure->rig_from_world);
      lens->view = sv_view_make(m->width_px, m->height_px, m->p, &cam_from_world);
      lens->view.i_exposure = (int)exposure->id;
      lens->view.i_sub_view = i;
      lens->footprint = footprint_of(v);
      lens++;
    }
}

static sv_status check_lens(const sv_rig *rig, const sv_sub_view *v, sv_err *err) {
  if (!sv_model_is_straight(&v->model))
    return sv_fail(
        err, SV_E_UNSUPPORTED,
        "rig \"%s\", sub-view \"%s\": lens images that add up on a sensor cannot be undistorted; a "
        "pinhole model was expected",
        rig->name, v->name);
  return SV_OK;
}

// Slot 0 stands for all of them here: footprints do not move.
static sv_status measure(sv_measurements *c, sv_err *err) {
  const sv_rig *rig = c->cfg.rig;
  const sv_exposure still = {.rig_from_world = sv_pose_identity()};
  sv_status s = SV_OK;
  for (int i = 0; s >= 0 && i < rig->n_sub_views; i++) {
    if (rig->sub_views[i].i_camera >= c->cfg.n_cameras)
      return sv_fail(err, SV_E_RANGE, "rig \"%s\", sub-view \"%s\": camera %d, the source has %d", rig->name,
                     rig->sub_views[i].name, rig->sub_views[i].i_camera, c->cfg.n_cameras);
    s = check_lens(rig, &rig->sub_views[i], err);
  }
  if (s < 0) return s;
  place(c, c->lens, &still);
  for (int i = 0; s >= 0 && i < c->n_sensors; i++) {
    sv_sensor *sensor = &c->sensor[i];
    sv_multiplexed model;
    const uint16_t *px;
    sv_err why;
    sensor->max_overlap = 1; // until the footprints are known to be on the sensor
    sv_measurements_get(c, 0, i, &model, &px);
    s = sv_multiplexed_check(&model, &why);
    if (s >= 0) {
      model.max_overlap = sensor->max_overlap = sv_multiplexed_max_overlap(
          model.lenses, model.n_lenses, sensor->width_px, sensor->height_px, c->row);
      s = sv_multiplexed_check(&model, &why);
    }
    if (s < 0) s = sv_fail(err, s, "rig \"%s\", camera %d: %s", rig->name, sensor->i_camera, why.text);
  }
  return s;
}

sv_status sv_measurements_init(sv_measurements *c, const sv_measurements_cfg *cfg, sv_arena *arena,
                               sv_err *err) {
  memset(c, 0, sizeof *c);
  c->cfg = *cfg;
  carve(c, cfg, arena);
  if (arena->status < 0)
    return sv_fail(err, arena->status, "no room for %d exposures of %zu bytes", cfg->cap_exposures,
                   2 * c->exposure_values);
  return c->sensor ? measure(c, err) : SV_OK;
}

// --- exposures -----------------------------------------------------------------------------------

typedef struct {
  const sv_sensor *sensor;
  const sv_frame *frame;
  uint16_t *dst;
} copy_job;

static void copy_task(void *arg, int i_task, int i_thread) {
  const copy_job *j = arg;
  size_t n = 3 * (size_t)j->sensor->width_px;
  int y1 = sv_mini((i_task + 1) * ROWS_PER_TASK, j->sensor->height_px);
  (void)i_thread;
  for (int y = i_task * ROWS_PER_TASK; y < y1; y++) {
    const uint8_t *src = j->frame->data + (size_t)y * (size_t)j->frame->stride_bytes;
    uint16_t *dst = j->dst + (size_t)y * n;
    if (j->frame->format == SV_PIX_RGB16)
      for (size_t i = 0; i < n; i++) dst[i] = (uint16_t)(src[2 * i] | src[2 * i + 1] << 8);
    else
      for (size_t i = 0; i < n; i++) dst[i] = (uint16_t)(257 * src[i]);
  }
}

static sv_status check_frame(const sv_sensor *s, const sv_frame *f, sv_err *err) {
  if (f->format != SV_PIX_RGB16 && f->format != SV_PIX_RGB8)
    return sv_fail(err, SV_E_UNSUPPORTED,
                   "camera %d delivers pixel format %d; a shared sensor is trained on RGB16 or RGB8 frames",
                   s->i_camera, (int)f->format);
  if (f->width_px != s->width_px || f->height_px != s->height_px)
    return sv_fail(err, SV_E_RANGE, "camera %d delivers %dx%d pixels, its sensor has %dx%d", s->i_camera,
                   f->width_px, f->height_px, s->width_px, s->height_px);
  return SV_OK;
}

sv_status sv_measurements_put(sv_measurements *c, int i_slot, const sv_exposure *exposure,
                              const sv_frame *frame, const sv_pool *pool, sv_err *err) {
  for (int i = 0; i < c->n_sensors; i++) {
    sv_status s = check_frame(&c->sensor[i], &frame[c->sensor[i].i_camera], err);
    if (s < 0) return s;
  }
  for (int i = 0; i < c->n_sensors; i++) {
    const sv_sensor *s = &c->sensor[i];
    copy_job j = {s, &frame[s->i_camera], c->px + (size_t)i_slot * c->exposure_values + s->at};
    sv_pool_run(pool, copy_task, &j, (s->height_px + ROWS_PER_TASK - 1) / ROWS_PER_TASK);
  }
  place(c, c->lens + (size_t)i_slot * (size_t)c->cfg.rig->n_sub_views, exposure);
  return SV_OK;
}

void sv_measurements_get(const sv_measurements *c, int i_slot, int i_sensor, sv_multiplexed *model,
                         const uint16_t **px) {
  const sv_sensor *s = &c->sensor[i_sensor];
  *px = c->px + (size_t)i_slot * c->exposure_values + s->at;
  *model = (sv_multiplexed){.width_px = s->width_px,
                            .height_px = s->height_px,
                            .n_lenses = s->n_lenses,
                            .lenses = c->lens + (size_t)i_slot * (size_t)c->cfg.rig->n_sub_views + s->i_lens,
                            .max_overlap = s->max_overlap,
                            .is_linear = true}; // light adds up on a sensor
}
