// SPDX-License-Identifier: Apache-2.0
#include "src/capture/exposures.h"

#include <string.h>

#include "src/base/mathx.h"
#include "src/base/rng.h"

#define ROWS_PER_TASK 16

static bool is_multiplexed(const sv_exposures_cfg *cfg) {
  return cfg->rig->forward == SV_FORWARD_MULTIPLEXED;
}

// Where a picture may turn out to be damaged after another one of its exposure was copied, new ones
// go beside the exposure that they replace, and take its place when all are there.
static bool has_spare(const sv_exposures_cfg *cfg) {
  bool is_coded = false;
  for (int i = 0; i < cfg->n_cameras; i++)
    is_coded |= sv_pixel(cfg->caps[i].format)->layout == SV_LAYOUT_CODED;
  return is_coded && cfg->n_cameras > 1;
}

// Room to make a frame smaller, and for what is undistorted afterwards.
static void carve_reduced(sv_exposures *e, const sv_exposures_cfg *cfg, sv_arena *a) {
  size_t bytes = 0, n = 0, width_px = 0;
  for (int i = 0; i < cfg->rig->n_sub_views; i++) {
    const sv_sub_view *v = &cfg->rig->sub_views[i];
    const size_t b = (size_t)v->model.width_px * (size_t)v->model.height_px * 3;
    if (!v->source_width_px) continue;
    width_px = sv_maxi((int)width_px, v->source_width_px);
    if (SV_AREA_SCRATCH_FLOATS(v->source_width_px) > n) n = SV_AREA_SCRATCH_FLOATS(v->source_width_px);
    if (!sv_model_is_straight(&v->model) && b > bytes) bytes = b;
  }
  e->reduced = bytes ? SV_TAKE(a, uint8_t, bytes) : NULL;
  e->n_area_floats = n;
  e->area_scratch = n ? SV_TAKE(a, float, n *(size_t)sv_maxi(cfg->n_threads, 1)) : NULL;
  if (!cfg->is_deep) return;
  e->n_deep_sums = width_px;
  e->deep_reduced = bytes ? SV_TAKE(a, uint16_t, bytes) : NULL;
  e->deep_sums = width_px ? SV_TAKE(a, uint32_t, width_px * (size_t)sv_maxi(cfg->n_threads, 1)) : NULL;
}

// Of a sensor whose noise is not known: 10,000 electrons at full scale, 3 of read noise.
#define USUAL_READ 1e-7
#define USUAL_SHOT 1e-4
#define MIN_READ   1e-9 // 16 bits

static void carve_shutters(sv_exposures *e, const sv_exposures_cfg *cfg, sv_arena *a) {
  if (!cfg->is_deep) return;
  e->first_ns = SV_TAKE(a, sv_ns, cfg->n_cameras);
  e->light = SV_TAKE(a, double, 1 + cfg->n_cameras);
  e->shutter = SV_TAKE(a, float, (size_t)(cfg->cap_exposures + 1) * (size_t)cfg->n_cameras);
  for (int i = 0; e->first_ns && i < cfg->n_cameras; i++) e->first_ns[i] = 0;
}

// The table of display values of all corrections, NULL where there are none.
static const uint8_t *carve_display(const sv_exposures_cfg *cfg, sv_arena *a) {
  const sv_rig *rig = cfg->rig;
  for (int i = 0; i < rig->n_sub_views && !cfg->is_deep; i++)
    if (sv_correction_is_needed(&rig->sub_views[i].photometric)) return sv_correction_display(a);
  return NULL;
}

static sv_status carve(sv_exposures *e, const sv_exposures_cfg *cfg, sv_arena *a, sv_err *err) {
  const sv_rig *rig = cfg->rig;
  e->exposure = SV_TAKE(a, sv_exposure, cfg->cap_exposures);
  if (is_multiplexed(cfg)) {
    sv_measurements_cfg cc = {rig, cfg->caps, cfg->n_cameras, cfg->cap_exposures};
    return sv_measurements_init(&e->measurements, &cc, a, err);
  }
  e->sub = SV_TAKE(a, sv_sub_view_store, rig->n_sub_views);
  const uint8_t *display = carve_display(cfg, a);
  size_t at = 0;
  for (int i = 0; i < rig->n_sub_views; i++) {
    const sv_camera_model *m = &rig->sub_views[i].model;
    sv_lens_view lens;
    if (!sv_lens_view_make(&lens, m))
      return sv_fail(err, SV_E_RANGE, "rig \"%s\", sub-view \"%s\": no view fits this lens (%s, fx %g px)",
                     rig->name, rig->sub_views[i].name, sv_model_name(m->kind), m->p[0]);
    const bool is_dark = sv_lens_view_has_dark(&lens);
    sv_remap_tap *entries =
        lens.is_remapped ? SV_TAKE(a, sv_remap_tap, (size_t)m->width_px * (size_t)m->height_px) : NULL;
    const size_t px = (size_t)m->width_px * (size_t)m->height_px, bytes = (px * 3 + 63) & ~(size_t)63;
    sv_correction correction = {0};
    if (!cfg->is_deep) sv_correction_carve(&correction, &rig->sub_views[i], display, px, a);
    const bool is_held = cfg->hold_out > 0;
    uint8_t *mask = rig->sub_views[i].mask || is_dark || is_held ? SV_TAKE(a, uint8_t, px) : NULL;
    uint8_t *held = is_held ? SV_TAKE(a, uint8_t, px) : NULL;
    if (e->sub) {
      sv_sub_view_store *s = &e->sub[i];
      *s = (sv_sub_view_store){.at = at, .bytes = bytes, .mask = mask, .held = held};
      s->map.entries = entries;
      s->lens = lens;
      s->correction = correction;
    }
    at += bytes;
    if (e->sub) e->sub[i].deep_at = at;
    if (cfg->is_deep) at += (px * 6 + 63) & ~(size_t)63;
  }
  e->exposure_bytes = at;
  e->place = SV_TAKE(a, int, cfg->cap_exposures + 1);
  for (int i = 0; e->place && i <= cfg->cap_exposures; i++) e->place[i] = i;
  e->px = SV_TAKE(a, uint8_t, (size_t)(cfg->cap_exposures + has_spare(cfg)) * at);
  carve_reduced(e, cfg, a);
  carve_shutters(e, cfg, a);
  if (cfg->is_blur_dropped) {
    int w = 0, h = 0;
    for (int i = 0; i < rig->n_sub_views; i++) {
      w = sv_maxi(w, rig->sub_views[i].model.width_px);
      h = sv_maxi(h, rig->sub_views[i].model.height_px);
    }
    sv_sharpness_carve(&e->sharpness, w, h, sv_maxi(cfg->n_threads, 1), a);
  }
  sv_convert_cfg cc = {cfg->caps, cfg->n_cameras, sv_maxi(cfg->n_threads, 1), cfg->decoder, cfg->is_deep};
  sv_status s = sv_convert_init(&e->convert, &cc, a, err);
  if (s < 0) return s;
  return a->status < 0
             ? sv_fail(err, a->status, "no room for %d exposures of %zu bytes", cfg->cap_exposures, at)
             : SV_OK;
}

// Blocks scattered evenly, others in each sub-view.
static bool is_held_block(int x, int y, int i_sub, float share) {
  sv_rng rng = sv_rng_make(((uint64_t)i_sub << 40) + ((uint64_t)y << 20) + (uint64_t)x, 0);
  return sv_rng_f(&rng) < share;
}

// The mask of a sub-view as its view sees it: a pixel counts where all that it is interpolated from
// do, and where the lens sees anything.
static void undistort_mask(sv_sub_view_store *s, const sv_sub_view *v, float hold_out, int i_sub) {
  const int w = s->lens.model.width_px, src_w = v->model.width_px;
  for (int y = 0; s->mask && y < s->lens.model.height_px; y++)
    for (int x = 0; x < w; x++) {
      const size_t at = (size_t)y * (size_t)w + (size_t)x;
      const bool counts = s->map.entries ? sv_remap_counts(&s->map, v->mask, x, y)
                                         : !v->mask || v->mask[(size_t)y * (size_t)src_w + (size_t)x] != 0;
      s->mask[at] = counts && sv_lens_view_is_lit(&s->lens, x + 0.5, y + 0.5);
      if (!s->held) continue;
      s->held[at] = s->mask[at] && is_held_block(x / SV_HELD_PX, y / SV_HELD_PX, i_sub, hold_out);
      s->mask[at] &= !s->held[at];
    }
}

void sv_exposures_hold(sv_exposures *e, bool is_kept) {
  for (int i = 0; i < e->cfg.rig->n_sub_views; i++) {
    sv_sub_view_store *s = &e->sub[i];
    const size_t n = (size_t)s->lens.model.width_px * (size_t)s->lens.model.height_px;
    for (size_t at = 0; s->held && at < n; at++)
      if (s->held[at]) s->mask[at] = !is_kept;
  }
}

sv_status sv_exposures_row_time(const sv_sub_view *v, const sv_camera_caps *caps, const sv_lens_view *view,
                                sv_row_time *out) {
  const sv_camera_model *m = &view->model;
  // else the image is all that its sensor delivers
  const bool is_shared = v->footprint.width_px > 0;
  const sv_row_time_cfg cfg = {.shutter = v->shutter,
                               .lens = &v->model,
                               .fisheye = view->is_fisheye ? &view->fisheye : NULL,
                               .x0_px = v->footprint.x0_px,
                               .y0_px = v->footprint.y0_px,
                               .sensor_width_px = is_shared ? caps[v->i_camera].width_px : v->model.width_px,
                               .sensor_height_px =
                                   is_shared ? caps[v->i_camera].height_px : v->model.height_px,
                               .half_x = sv_maxd(m->p[2], m->width_px - m->p[2]) / m->p[0],
                               .half_y = sv_maxd(m->p[3], m->height_px - m->p[3]) / m->p[1]};
  return sv_row_time_make(out, &cfg);
}

sv_status sv_exposures_init(sv_exposures *e, const sv_exposures_cfg *cfg, sv_arena *arena, sv_err *err) {
  if (cfg->cap_exposures < 1 || cfg->rig->n_sub_views < 1)
    return sv_fail(err, SV_E_ARG, "%d exposures of %d sub-views, expected at least one of each",
                   cfg->cap_exposures, cfg->rig->n_sub_views);
  memset(e, 0, sizeof *e);
  e->cfg = *cfg;
  e->white = cfg->is_deep ? 0 : 1;
  sv_spacing_cells *cells = cfg->spacing.is_by_motion ? SV_TAKE(arena, sv_spacing_cells, 2) : NULL;
  sv_spacing_init(&e->spacing, &cfg->spacing, cells);
  sv_status s = carve(e, cfg, arena, err);
  for (int i = 0; s >= 0 && e->sub && i < cfg->rig->n_sub_views; i++) {
    sv_sub_view_store *v = &e->sub[i];
    if (v->map.entries)
      s = sv_remap_build(&v->map, &cfg->rig->sub_views[i].model, &v->lens.model, v->map.entries);
    if (s < 0)
      return sv_fail(err, s, "rig \"%s\", sub-view \"%s\": no undistortion table for %dx%d pixels",
                     cfg->rig->name, cfg->rig->sub_views[i].name, v->lens.model.width_px,
                     v->lens.model.height_px);
    if (v->correction.light && sv_correction_fill(&v->correction, &cfg->rig->sub_views[i], &v->map) < 0)
      return sv_fail(err, SV_E_RANGE, "rig \"%s\", sub-view \"%s\": its color matrix has no inverse",
                     cfg->rig->name, cfg->rig->sub_views[i].name);
    undistort_mask(v, &cfg->rig->sub_views[i], cfg->hold_out, i);
    if (sv_exposures_row_time(&cfg->rig->sub_views[i], cfg->caps, &v->lens, &v->row_time) < 0)
      return sv_fail(err, SV_E_RANGE,
                     "rig \"%s\", sub-view \"%s\": the lens sees too little of its own image", cfg->rig->name,
                     cfg->rig->sub_views[i].name);
  }
  return s;
}

typedef struct {
  const sv_exposures *e;
  const sv_kernels *k;
  const uint8_t *src; // RGB8: the sub-view's part of the frame, or what that was made smaller to
  size_t stride_bytes;
  uint8_t *dst;
  int i_sub;
  const uint16_t *deep; // first of the camera's deep planes, and the first of the picture's
  uint16_t *deep_dst;
  size_t deep_plane, deep_width;
  uint8_t *picture; // in the pool, where dst may be on the way to it
} copy_job;

// Rows that are there, as the reference camera would show them.
static void correct_rows(const copy_job *j, int y0, int y1) {
  const sv_sub_view_store *s = &j->e->sub[j->i_sub];
  if (!s->correction.light || j->dst != j->picture) return;
  j->k->correct(&(sv_correct_args){.px = j->dst,
                                   .stride_bytes = (size_t)s->lens.model.width_px * 3,
                                   .width_px = s->lens.model.width_px,
                                   .light = s->correction.light,
                                   .inverse_falloff = s->correction.inverse_falloff,
                                   .display = s->correction.display,
                                   .row0 = y0,
                                   .row1 = y1});
}

// Rows of one sub-view: made smaller.
static void reduce_task(void *arg, int i_task, int i_thread) {
  const copy_job *j = arg;
  const sv_sub_view *v = &j->e->cfg.rig->sub_views[j->i_sub];
  sv_area_args a = {.src = j->src,
                    .src_stride_bytes = j->stride_bytes,
                    .src_width_px = v->source_width_px,
                    .src_height_px = v->source_height_px,
                    .dst = j->dst,
                    .dst_stride_bytes = (size_t)v->model.width_px * 3,
                    .dst_width_px = v->model.width_px,
                    .dst_height_px = v->model.height_px,
                    .row0 = i_task * ROWS_PER_TASK,
                    .row1 = sv_mini((i_task + 1) * ROWS_PER_TASK, v->model.height_px),
                    .scratch = j->e->area_scratch + (size_t)i_thread * j->e->n_area_floats};
  j->k->area(&a);
  correct_rows(j, a.row0, a.row1);
}

// Rows of one sub-view: a plain copy of its footprint, or through the undistortion table.
static void copy_task(void *arg, int i_task, int i_thread) {
  const copy_job *j = arg;
  const sv_sub_view *sv = &j->e->cfg.rig->sub_views[j->i_sub];
  const sv_sub_view_store *s = &j->e->sub[j->i_sub];
  int w = s->lens.model.width_px, y0 = i_task * ROWS_PER_TASK,
      y1 = sv_mini(y0 + ROWS_PER_TASK, s->lens.model.height_px);
  const size_t stride = j->stride_bytes;
  const uint8_t *src = j->src;
  (void)i_thread;
  if (!s->map.entries) {
    for (int y = y0; y < y1; y++)
      memcpy(j->dst + (size_t)y * (size_t)w * 3, src + (size_t)y * stride, (size_t)w * 3);
    correct_rows(j, y0, y1);
    return;
  }
  sv_remap_args a = {.src = src,
                     .src_width_px = sv->model.width_px,
                     .src_height_px = sv->model.height_px,
                     .src_stride_bytes = stride,
                     .table = s->map.entries,
                     .dst = j->dst,
                     .dst_width_px = w,
                     .dst_stride_bytes = (size_t)w * 3,
                     .row0 = y0,
                     .row1 = y1};
  j->k->remap(&a);
  correct_rows(j, y0, y1);
}

static int n_tasks(int n_rows) { return (n_rows + ROWS_PER_TASK - 1) / ROWS_PER_TASK; }

// One sub-view out of its sensor's picture, into the pool.
static void put_sub_view(const copy_job *job, const sv_image_u8 *image, const sv_pool *pool) {
  const sv_sub_view *v = &job->e->cfg.rig->sub_views[job->i_sub];
  const sv_sub_view_store *s = &job->e->sub[job->i_sub];
  copy_job j = *job;
  j.stride_bytes = (size_t)image->stride_bytes;
  j.src = image->px + (size_t)v->footprint.y0_px * j.stride_bytes + (size_t)v->footprint.x0_px * 3;
  if (v->source_width_px) {
    if (s->map.entries) j.dst = job->e->reduced;
    sv_pool_run(pool, reduce_task, &j, n_tasks(v->model.height_px));
    if (!s->map.entries) return;
    j.src = j.dst;
    j.stride_bytes = (size_t)v->model.width_px * 3;
    j.dst = job->dst;
  }
  sv_pool_run(pool, copy_task, &j, n_tasks(s->lens.model.height_px));
}

// A place between four pixels of a plane, as kernels/remap/remap.h has it.
static uint16_t value_at(const copy_job *j, const uint16_t *plane, const sv_camera_model *m,
                         const sv_remap_tap *t) {
  const size_t w = j->deep_width, x1 = (size_t)sv_mini(t->x + 1, m->width_px - 1),
               y1 = (size_t)sv_mini(t->y + 1, m->height_px - 1);
  if (t->x == SV_REMAP_NONE) return 0;
  const uint16_t *top = plane + (size_t)t->y * w, *low = plane + y1 * w;
  const uint32_t fx = t->fx, fy = t->fy, above = (256 - fx) * top[t->x] + fx * top[x1],
                 below = (256 - fx) * low[t->x] + fx * low[x1];
  return (uint16_t)(((uint64_t)(256 - fy) * above + (uint64_t)fy * below + 32768) >> 16);
}

static void copy_deep_task(void *arg, int i_task, int i_thread) {
  const copy_job *j = arg;
  const sv_sub_view *v = &j->e->cfg.rig->sub_views[j->i_sub];
  const sv_sub_view_store *s = &j->e->sub[j->i_sub];
  const size_t w = (size_t)s->lens.model.width_px, n = w * (size_t)s->lens.model.height_px;
  (void)i_thread;
  for (int c = 0; c < 3; c++)
    for (int y = i_task * ROWS_PER_TASK; y < sv_mini((i_task + 1) * ROWS_PER_TASK, s->lens.model.height_px);
         y++) {
      uint16_t *out = j->deep_dst + (size_t)c * n + (size_t)y * w;
      const uint16_t *plane = j->deep + (size_t)c * j->deep_plane;
      if (!s->map.entries) memcpy(out, plane + (size_t)y * j->deep_width, w * sizeof *out);
      for (size_t x = 0; s->map.entries && x < w; x++)
        out[x] = value_at(j, plane, &v->model, &s->map.entries[(size_t)y * w + x]);
    }
}

// Rows of one sub-view's deep picture: made smaller.
static void reduce_deep_task(void *arg, int i_task, int i_thread) {
  const copy_job *j = arg;
  const sv_sub_view *v = &j->e->cfg.rig->sub_views[j->i_sub];
  sv_deep_reduce(&(sv_deep_reduction){.src = j->deep,
                                      .src_plane = j->deep_plane,
                                      .src_stride = j->deep_width,
                                      .src_width_px = v->source_width_px,
                                      .src_height_px = v->source_height_px,
                                      .dst = j->deep_dst,
                                      .dst_width_px = v->model.width_px,
                                      .dst_height_px = v->model.height_px,
                                      .row0 = i_task * ROWS_PER_TASK,
                                      .row1 = sv_mini((i_task + 1) * ROWS_PER_TASK, v->model.height_px),
                                      .scratch = j->e->deep_sums + (size_t)i_thread * j->e->n_deep_sums});
}

// Undistorted ones have their camera's whole frame; others a part of it.
static void put_deep(const copy_job *job, const sv_frame *f, uint16_t *dst, const sv_pool *pool) {
  const sv_sub_view *v = &job->e->cfg.rig->sub_views[job->i_sub];
  copy_job j = *job;
  j.deep_width = (size_t)f->width_px;
  j.deep_plane = j.deep_width * (size_t)f->height_px;
  j.deep =
      job->e->convert.deep.linear + (size_t)v->footprint.y0_px * j.deep_width + (size_t)v->footprint.x0_px;
  j.deep_dst = dst;
  if (v->source_width_px) {
    const bool is_undistorted = job->e->sub[job->i_sub].map.entries != NULL;
    if (is_undistorted) j.deep_dst = job->e->deep_reduced;
    sv_pool_run(pool, reduce_deep_task, &j, n_tasks(v->model.height_px));
    if (!is_undistorted) return;
    j.deep = j.deep_dst;
    j.deep_width = (size_t)v->model.width_px;
    j.deep_plane = j.deep_width * (size_t)v->model.height_px;
    j.deep_dst = dst;
  }
  sv_pool_run(pool, copy_deep_task, &j, n_tasks(job->e->sub[job->i_sub].lens.model.height_px));
}

// Whether a camera differs from the first in its exposure time alone, if at all: sources give one
// that is more sensitive a shorter one (lock=shared).
static bool is_like_first(const sv_exposures *e, int i_camera) {
  return e->cfg.caps[0].is_light_shared && e->cfg.caps[i_camera].is_light_shared;
}

// A camera's frame as RGB8, and with is_deep in 16 bits.
static sv_status convert(sv_exposures *e, int place, const sv_frame *f, const sv_compute *with,
                         sv_image_u8 *image, sv_err *err) {
  if (!e->cfg.is_deep) return sv_convert_frame(&e->convert, f, with->k, with->pool, image, err);
  sv_ns *first = &e->first_ns[is_like_first(e, f->i_camera) ? 0 : f->i_camera];
  float *shutter = &e->shutter[place * e->cfg.n_cameras + f->i_camera];
  if (*first == 0) *first = f->exposure_ns;
  *shutter = f->exposure_ns > 0 && *first > 0 ? (float)((double)f->exposure_ns / (double)*first) : 1;
  if (e->white == 0) {
    sv_status s = sv_convert_deep(&e->convert, f, 1, with, image, err);
    if (s < 0) return s;
    e->white = sv_deep_white(e->convert.deep.linear, 3 * (size_t)f->width_px * (size_t)f->height_px);
  }
  return sv_convert_deep(&e->convert, f, 1 / (*shutter * e->white), with, image, err);
}

// Exposure time of camera i's frame over that of the first camera, where it alone differs. Else 1.
static double exposure_of(const sv_exposures *e, int i, const sv_frame *frame) {
  if (!is_like_first(e, i) || frame[i].exposure_ns <= 0 || frame[0].exposure_ns <= 0) return 1;
  return (double)frame[i].exposure_ns / (double)frame[0].exposure_ns;
}

static sv_status check_frame(const sv_exposures *e, int i_sub, const sv_frame *f, sv_err *err) {
  const sv_sub_view *sv = &e->cfg.rig->sub_views[i_sub];
  int w = sv->footprint.x0_px + (sv->source_width_px ? sv->source_width_px : sv->model.width_px);
  int h = sv->footprint.y0_px + (sv->source_height_px ? sv->source_height_px : sv->model.height_px);
  bool is_shared = sv->footprint.width_px > 0 || sv->source_width_px > 0;
  if (is_shared ? (f->width_px < w || f->height_px < h) : (f->width_px != w || f->height_px != h))
    return sv_fail(err, SV_E_RANGE,
                   "camera %d delivers %dx%d pixels, sub-view \"%s\" of the rig expects %dx%d", sv->i_camera,
                   f->width_px, f->height_px, sv->name, w, h);
  return SV_OK;
}

static sv_status put_pictures(sv_exposures *e, int place, const sv_frame *frame, const sv_kernels *k,
                              const sv_pool *pool, sv_err *err) {
  const sv_rig *rig = e->cfg.rig;
  for (int i = 0; i < rig->n_sub_views; i++) {
    sv_status s = check_frame(e, i, &frame[rig->sub_views[i].i_camera], err);
    if (s < 0) return s;
  }
  // Camera by camera: the converter holds one picture at a time.
  for (int c = 0; c < e->cfg.n_cameras; c++) {
    sv_image_u8 image = {0};
    for (int i = 0; i < rig->n_sub_views; i++) {
      if (rig->sub_views[i].i_camera != c) continue;
      if (!image.px) {
        sv_status s = convert(e, place, &frame[c], &(sv_compute){k, pool}, &image, err);
        if (s < 0) return s;
      }
      uint8_t *block = e->px + (size_t)place * e->exposure_bytes;
      sv_correction_expose(&e->sub[i].correction, &rig->sub_views[i], exposure_of(e, c, frame));
      copy_job j = {.e = e, .k = k, .i_sub = i, .dst = block + e->sub[i].at};
      j.picture = j.dst;
      put_sub_view(&j, &image, pool);
      if (e->cfg.is_deep) put_deep(&j, &frame[c], (uint16_t *)(void *)(block + e->sub[i].deep_at), pool);
    }
  }
  return SV_OK;
}

static sv_image_u8 image_at(const sv_exposures *e, int place, int i_sub) {
  const sv_sub_view_store *s = &e->sub[i_sub];
  const int w = s->lens.model.width_px, h = s->lens.model.height_px;
  return (sv_image_u8){e->px + (size_t)place * e->exposure_bytes + s->at, w, h, 3, w * 3, s->mask};
}

static bool is_blurred(sv_exposures *e, int place, const sv_compute *c) {
  sv_sharpness_sums sums = {0};
  for (int i = 0; i < e->cfg.rig->n_sub_views; i++) {
    const sv_image_u8 im = image_at(e, place, i);
    sv_sharpness_add(&e->sharpness, &im, c, &sums);
  }
  return sv_sharpness_is_blurred(&e->sharpness, &sums);
}

sv_status sv_exposures_add(sv_exposures *e, const sv_exposure *exposure, const sv_frame *frame,
                           const sv_kernels *k, const sv_pool *pool, sv_err *err) {
  const int slot = e->i_next, with = has_spare(&e->cfg) ? e->cfg.cap_exposures : slot;
  e->reason = SV_DROP_NOT_DUE;
  const sv_spacing_exposure judged = {exposure->time_ns, frame[0].exposure_ns};
  if (!sv_spacing_is_due(&e->spacing, &judged)) return SV_DROPPED;
  sv_status s = is_multiplexed(&e->cfg)
                    ? sv_measurements_put(&e->measurements, slot, exposure, frame, pool, err)
                    : put_pictures(e, e->place[with], frame, k, pool, err);
  sv_convert_forget(&e->convert);
  if (s < 0) return s;
  if (!is_multiplexed(&e->cfg)) {
    const sv_image_u8 first = image_at(e, e->place[with], 0);
    if (!sv_spacing_has_moved(&e->spacing, &first, &judged)) return SV_DROPPED;
    e->reason = SV_DROP_BLURRED;
    if (e->cfg.is_blur_dropped && is_blurred(e, e->place[with], &(sv_compute){k, pool})) return SV_DROPPED;
    const int place = e->place[with];
    e->place[with] = e->place[slot];
    e->place[slot] = place;
  }
  sv_spacing_keep(&e->spacing, &judged);
  e->exposure[slot] = *exposure;
  e->i_next = (slot + 1) % e->cfg.cap_exposures;
  if (e->n < e->cfg.cap_exposures) e->n++;
  else e->n_replaced++;
  return SV_OK;
}

void sv_exposures_get(const sv_exposures *e, int i, int i_sub, sv_image_u8 *image, sv_view *view) {
  const sv_sub_view_store *s = &e->sub[i_sub];
  *image = image_at(e, e->place[i], i_sub);
  sv_pose cam_from_world =
      sv_pose_mul(&e->cfg.rig->sub_views[i_sub].cam_from_rig, &e->exposure[i].rig_from_world);
  *view = sv_view_make(image->width_px, image->height_px, s->lens.model.p, &cam_from_world);
  view->i_exposure = (int)e->exposure[i].id;
  view->i_sub_view = i_sub;
  view->fisheye = s->lens.is_fisheye ? &s->lens.fisheye : NULL;
}

void sv_exposures_deep(const sv_exposures *e, int i, int i_sub, sv_image_deep *out) {
  const sv_sub_view *v = &e->cfg.rig->sub_views[i_sub];
  const sv_sub_view_store *s = &e->sub[i_sub];
  const bool is_known = v->noise.read > 0 || v->noise.shot > 0;
  const uint8_t *block = e->px + (size_t)e->place[i] * e->exposure_bytes;
  // The mean of several pixels has so much of their noise.
  const double share = v->source_width_px ? (double)v->model.width_px * v->model.height_px /
                                                ((double)v->source_width_px * v->source_height_px)
                                          : 1;
  *out = (sv_image_deep){.px = (const uint16_t *)(const void *)(block + s->deep_at),
                         .width_px = s->lens.model.width_px,
                         .height_px = s->lens.model.height_px,
                         .exposure = e->shutter[e->place[i] * e->cfg.n_cameras + v->i_camera],
                         .white = e->white,
                         .photometric = v->photometric.is_known ? &v->photometric : NULL,
                         .read = (float)sv_maxd(share * (is_known ? v->noise.read : USUAL_READ), MIN_READ),
                         .shot = (float)(share * (is_known ? v->noise.shot : USUAL_SHOT))};
}

void sv_exposures_note_light(sv_exposures *e) {
  if (!e->light) return;
  e->light[0] = (double)e->white;
  for (int c = 0; c < e->cfg.n_cameras; c++) e->light[1 + c] = sv_ns_to_s(e->first_ns[c]);
}

void sv_exposures_take_light(sv_exposures *e) {
  if (!e->light) return;
  e->white = (float)e->light[0];
  for (int c = 0; c < e->cfg.n_cameras; c++) {
    const int i = is_like_first(e, c) ? 0 : c;
    const double was_s = sv_ns_to_s(e->first_ns[i]), is_s = e->light[1 + i];
    for (int place = 0; place <= e->cfg.cap_exposures && was_s > 0 && is_s > 0 && was_s != is_s; place++)
      e->shutter[place * e->cfg.n_cameras + c] *= (float)(was_s / is_s);
  }
  for (int c = 0; c < e->cfg.n_cameras; c++)
    if (e->light[1 + c] > 0) e->first_ns[c] = (sv_ns)(1e9 * e->light[1 + c] + 0.5);
}
