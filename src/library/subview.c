// SPDX-License-Identifier: Apache-2.0
// The life of an instance: exposures in, steps, renderings and files out.
#include "include/subview/subview.h"

#include <string.h>

#include "src/base/mathx.h"
#include "src/format/axes.h"
#include "src/format/splat_file.h"
#include "src/library/instance.h"
#include "src/metric/metric.h"
#include "src/train/seed.h"
#include "src/train/stereo.h"
#include "src/train/driver.h"
#include "src/train/supersample.h"

// --- exposures in --------------------------------------------------------------------------------

static sv_frame frame_of(const subview *s, int i, const subview_frame *f) {
  const sv_camera_caps *caps = &s->caps[i];
  sv_frame out = {.i_camera = i,
                  .width_px = caps->width_px,
                  .height_px = caps->height_px,
                  .format = caps->format,
                  .data = f->data,
                  .chroma = f->chroma,
                  .chroma_stride_bytes = f->chroma_stride_bytes,
                  .stride_bytes = f->stride_bytes};
  if (!out.stride_bytes) out.stride_bytes = (int)sv_pixel_row_bytes(caps->format, caps->width_px);
  out.data_bytes = caps->frame_bytes;
  return out;
}

static sv_view view_at(const subview *s, int i_exposure, int i_camera, sv_image_u8 *image) {
  sv_view v;
  sv_exposures_get(&s->exposures, i_exposure, i_camera, image, &v);
  return v;
}

// Trains on exposure e from now on. Views of exposure e are e n, e n + 1, ...
static sv_status train_on(subview *s, int e, bool is_replacing, sv_err *err) {
  const int n = s->rig.n_sub_views;
  for (int i = 0; i < n; i++) {
    sv_image_u8 image;
    const sv_view v = view_at(s, e, i, &image);
    s->views[e * n + i] = v;
    if (is_replacing) {
      sv_train_replace_view(&s->trainer, e * n + i, &v, &image);
      continue;
    }
    sv_status r = sv_train_add_view(&s->trainer, &v, &image, err);
    if (r < 0) return r;
  }
  return SV_OK;
}

// s->frames and the exposure into the pool.
static sv_status push(subview *s, sv_exposure *x, sv_err *err) {
  const int e = s->exposures.i_next;
  const bool is_full = s->exposures.n == s->exposures.cfg.cap_exposures;
  x->id = s->n_pushed;
  sv_status r = sv_exposures_add(&s->exposures, x, s->frames, &s->kernels, &s->pool, err);
  if (r < 0) return r;
  s->n_pushed++;
  return s->is_started ? train_on(s, e, is_full, err) : SV_OK;
}

subview_status subview_push_exposure(subview *s, const subview_frame *frames,
                                     const subview_pose *rig_from_world, subview_error *error) {
  sv_exposure x = {.rig_from_world = pose_in(rig_from_world), .has_pose = rig_from_world != NULL};
  if (sv_rotation_error(x.rig_from_world.r) > 1e-3)
    return sv_fail(err_of(error), SV_E_ARG, "the matrix of the rig's pose is not a rotation");
  for (int i = 0; i < s->rig.n_sub_views; i++) {
    if (!frames[i].data) return sv_fail(err_of(error), SV_E_ARG, "the frame of camera %d has no data", i);
    s->frames[i] = frame_of(s, i, &frames[i]);
    x.present[i / 64] |= 1ull << (i % 64);
  }
  return push(s, &x, err_of(error));
}

int subview_n_exposures(const subview *s) { return s->exposures.n; }

static sv_status give_back(const subview_source *source, const sv_frame *f) {
  const subview_source_frame out = {.i_camera = f->i_camera,
                                    .sequence = f->sequence,
                                    .camera_ns = f->camera_ns,
                                    .arrival_ns = f->arrival_ns,
                                    .exposure_ns = f->exposure_ns,
                                    .frame = {f->data, f->stride_bytes, f->chroma, f->chroma_stride_bytes},
                                    .is_damaged = f->is_error,
                                    .i_buffer = f->i_buffer};
  return source->requeue(source->self, &out);
}

static sv_status drain_returns(subview *s, const subview_source *source) {
  sv_frame f;
  sv_status r = SV_OK;
  while (sv_sync_pop_return(&s->sync, &f) == SV_OK) {
    const sv_status t = give_back(source, &f);
    if (t < 0) r = t;
  }
  return r;
}

// AGAIN: no exposure is complete.
static sv_status keep_exposure(subview *s, const subview_source *source, subview_error *error) {
  sv_exposure x;
  subview_pose pose;
  sv_status r = sv_sync_pop_exposure(&s->sync, &x, s->frames);
  if (r != SV_OK) return r;
  x.has_pose = source->rig_pose && source->rig_pose(source->self, x.time_ns, &pose) == SV_OK;
  if (x.has_pose) x.rig_from_world = pose_in(&pose);
  r = push(s, &x, err_of(error));
  for (int i = 0; i < s->rig.n_sub_views; i++) {
    const sv_status t = give_back(source, &s->frames[i]);
    if (t < 0 && r >= 0) r = explain(error, t, "a frame could not be given back to its camera");
  }
  return r;
}

static sv_status take_frame(subview *s, const subview_source *source, const subview_source_frame *in,
                            subview_error *error) {
  if (in->i_camera < 0 || in->i_camera >= s->rig.n_sub_views)
    return sv_fail(err_of(error), SV_E_ARG, "a frame of camera %d, expected 0 to %d", in->i_camera,
                   s->rig.n_sub_views - 1);
  sv_frame f = frame_of(s, in->i_camera, &in->frame);
  f.sequence = in->sequence;
  f.camera_ns = in->camera_ns;
  f.arrival_ns = in->arrival_ns;
  f.exposure_ns = in->exposure_ns;
  f.is_error = in->is_damaged || !in->frame.data;
  f.i_buffer = in->i_buffer;
  const sv_status r = sv_sync_push(&s->sync, &f);
  if (r < 0) return explain(error, r, "a frame could not be taken");
  return explain(error, drain_returns(s, source), "a frame could not be given back to its camera");
}

subview_status subview_capture(subview *s, const subview_source *source, subview_error *error) {
  subview_source_frame in;
  const uint32_t before = s->n_pushed;
  for (;;) {
    memset(&in, 0, sizeof in);
    sv_status r = source->dequeue(source->self, &in);
    if (r == SV_AGAIN) return s->n_pushed > before ? SV_OK : SV_AGAIN;
    if (r == SV_END) {
      while (sv_sync_flush(&s->sync) == SV_E_FULL) (void)drain_returns(s, source);
      r = explain(error, drain_returns(s, source), "a frame could not be given back to its camera");
      return r < 0 ? r : SV_END;
    }
    if (r < 0) return explain(error, r, "the source failed");
    if ((r = take_frame(s, source, &in, error)) < 0) return r;
    while ((r = keep_exposure(s, source, error)) == SV_OK) {
    }
    if (r < 0) return r;
    if ((r = drain_returns(s, source)) < 0) return explain(error, r, "a frame could not be given back");
  }
}

subview_ledger subview_capture_ledger(const subview *s) {
  const sv_ledger l = sv_sync_ledger_sum(&s->sync);
  return (subview_ledger){l.captured, l.delivered, l.pending, sv_ledger_dropped(&l)};
}

// --- training ------------------------------------------------------------------------------------

subview_status subview_start(subview *s, subview_error *error) {
  sv_err *err = err_of(error);
  sv_trainer *t = &s->trainer;
  const int n_views = s->exposures.n * s->rig.n_sub_views;
  int n_points = 0;
  if (s->is_started) return sv_fail(err, SV_E_ARG, "training has started already; expected a new instance");
  if (n_views < 1) return sv_fail(err, SV_E_NOT_FOUND, "there is no exposure to train on");
  sv_status r = SV_OK;
  for (int e = 0; e < s->exposures.n && r >= 0; e++) r = train_on(s, e, false, err);
  if (r < 0) return r;
  if (!s->has_bounds) s->bounds = sv_bounds_of_views(s->views, n_views);
  sv_init_cfg init = sv_stereo_init(&s->bounds, t->cfg.seed);
  sv_stereo_cloud cloud = {.point = s->points, .cap = t->g.n};
  r = sv_stereo_points(t, &s->bounds, &s->scratch, &cloud);
  n_points = cloud.n;
  if (r == SV_AGAIN) { // views do not overlap
    init = (sv_init_cfg){.kind = s->has_bounds ? SV_INIT_SPHERE : SV_INIT_POINTS,
                         .radius = s->bounds.radius,
                         .opacity = 0.1f,
                         .scale_factor = 1.0f,
                         .seed = t->cfg.seed};
    memcpy(init.centre, s->bounds.centre, sizeof init.centre);
    n_points = s->has_bounds ? 0 : t->g.n;
    if (n_points) sv_seed_points(t, &s->bounds, t->cfg.seed, s->points, n_points);
  }
  if (r >= 0) r = sv_train_start(t, &init, s->points, n_points, &s->scratch);
  if (r < 0) return explain(error, r, "no starting Gaussians");
  sv_train_set_scene(t, s->bounds.centre, s->bounds.radius);
  s->is_started = true;
  return SV_OK;
}

subview_status subview_step_at(subview *s, float progress, subview_step_stats *stats, subview_error *error) {
  sv_step_stats out;
  if (!s->is_started) return sv_fail(err_of(error), SV_E_ARG, "a step before subview_start");
  const sv_status r = sv_train_step(&s->trainer, sv_clampf(progress, 0.0f, 1.0f), &out);
  if (r < 0) return explain(error, r, "the training step failed");
  if (stats)
    *stats = (subview_step_stats){.step = s->trainer.step,
                                  .loss = out.loss,
                                  .i_exposure = out.i_view / s->rig.n_sub_views,
                                  .i_camera = out.i_view % s->rig.n_sub_views};
  return SV_OK;
}

subview_status subview_step(subview *s, subview_step_stats *stats, subview_error *error) {
  if (s->trainer.step >= (uint32_t)s->n_steps) return SV_END;
  return subview_step_at(s, (float)s->trainer.step / (float)s->n_steps, stats, error);
}

// --- results -------------------------------------------------------------------------------------

// *out: the view as a camera would measure it, until the next rendering.
static sv_status measure(subview *s, const sv_view *view, const sv_planes **out) {
  sv_trainer *t = &s->trainer;
  const sv_render_options o = sv_train_render_options(t, 1.0f, false);
  return sv_train_measure(t, view, &o, sv_train_is_supersampled(t, 1, 1.0f), out);
}

subview_status subview_view_of(const subview *s, int i_exposure, int i_camera, subview_view *out) {
  sv_image_u8 image;
  if (i_exposure < 0 || i_exposure >= s->exposures.n || i_camera < 0 || i_camera >= s->rig.n_sub_views)
    return SV_E_RANGE;
  const sv_view v = view_at(s, i_exposure, i_camera, &image);
  *out = (subview_view){.width_px = v.width_px,
                        .height_px = v.height_px,
                        .fx = (double)v.fx,
                        .fy = (double)v.fy,
                        .cx = (double)v.cx,
                        .cy = (double)v.cy};
  for (int k = 0; k < 9; k++) out->cam_from_world.r[k] = (double)v.r[k];
  for (int k = 0; k < 3; k++) out->cam_from_world.t[k] = (double)v.t[k];
  return SV_OK;
}

subview_status subview_render(subview *s, const subview_view *view, uint8_t *rgb, int stride_bytes,
                              subview_error *error) {
  const sv_planes *p;
  const sv_pose pose = pose_in(&view->cam_from_world);
  const size_t stride = stride_bytes ? (size_t)stride_bytes : 3 * (size_t)view->width_px;
  if (!s->is_started) return sv_fail(err_of(error), SV_E_ARG, "nothing to render before subview_start");
  if (view->width_px < 1 || view->height_px < 1 || !(view->fx > 0 && view->fy > 0))
    return sv_fail(err_of(error), SV_E_ARG, "a view of %dx%d pixels with focal lengths of %g and %g px",
                   view->width_px, view->height_px, view->fx, view->fy);
  const sv_view v = sv_view_make(view->width_px, view->height_px,
                                 (const double[]){view->fx, view->fy, view->cx, view->cy}, &pose);
  const sv_status r = measure(s, &v, &p);
  if (r < 0) return explain(error, r, "the view could not be rendered (render_width_px, render_height_px)");
  for (int y = 0; y < v.height_px; y++)
    for (int x = 0; x < v.width_px; x++)
      for (int k = 0; k < 3; k++)
        rgb[(size_t)y * stride + 3 * (size_t)x + (size_t)k] =
            (uint8_t)(sv_clampf(p->c[k][(size_t)y * (size_t)p->stride + (size_t)x], 0.0f, 1.0f) * 255.0f +
                      0.5f);
  return SV_OK;
}

static double image_psnr(const sv_planes *p, const sv_image_u8 *image) {
  double sum = 0;
  for (int y = 0; y < image->height_px; y++)
    for (int x = 0; x < image->width_px; x++)
      for (int k = 0; k < 3; k++) {
        const double a = (double)sv_clampf(p->c[k][(size_t)y * (size_t)p->stride + (size_t)x], 0.0f, 1.0f);
        const double d = a - image->px[y * image->stride_bytes + 3 * x + k] / 255.0;
        sum += d * d;
      }
  return sv_psnr_of_mse(sum / (3.0 * image->width_px * image->height_px));
}

subview_status subview_psnr(subview *s, double *psnr_db, subview_error *error) {
  const int n = s->rig.n_sub_views;
  double sum = 0;
  if (!s->is_started) return sv_fail(err_of(error), SV_E_ARG, "there is no model before subview_start");
  for (int i = 0; i < s->exposures.n * n; i++) {
    sv_image_u8 image;
    const sv_planes *p;
    const sv_view v = view_at(s, i / n, i % n, &image);
    const sv_status r = measure(s, &v, &p);
    if (r < 0) return explain(error, r, "a training view could not be rendered");
    sum += image_psnr(p, &image);
  }
  *psnr_db = sum / (s->exposures.n * n);
  return SV_OK;
}

int subview_n_gaussians(const subview *s) { return s->trainer.g.n; }

subview_status subview_get_gaussian(const subview *s, int i, subview_gaussian *out) {
  sv_gaussian g;
  if (i < 0 || i >= s->trainer.g.n) return SV_E_RANGE;
  sv_gaussians_get(&s->trainer.g, i, &g);
  memcpy(out, &g, sizeof g);
  return SV_OK;
}

static sv_status write_sink(void *self, const void *data, size_t bytes, sv_err *err) {
  const subview_sink *sink = self;
  const sv_status r = sink->write(sink->self, data, bytes);
  return r < 0 ? sv_fail(err, r, "the caller's sink did not take %zu bytes", bytes) : SV_OK;
}

static sv_status save_ply(subview *s, sv_sink sink, sv_err *err) {
  const int n = s->exposures.n * s->rig.n_sub_views;
  float up[3] = {0};
  for (int i = 0; i < n; i++)
    for (int k = 0; k < 3; k++) up[k] -= s->views[i].r[3 + k];
  sv_model_notes notes = sv_driver_notes(&s->trainer);
  notes.up = sv_up_name(up);
  notes.unit = (sv_unit){.is_metric = s->rig.n_sub_views > 1, .scale_sigma = (float)s->rig.scale_sigma};
  return sv_model_write_ply(&s->trainer.g, &notes, sink, &s->ply, err);
}

// The writer's buffer serves as one for 128 Gaussians.
static sv_status save_splat(subview *s, sv_sink sink, sv_err *err) {
  const int n_at_once = (int)(sizeof s->ply.buffer / SV_SPLAT_BYTES);
  sv_status r = SV_OK;
  for (int i = 0; i < s->trainer.g.n && r >= 0; i += n_at_once) {
    const int n = sv_mini(n_at_once, s->trainer.g.n - i);
    for (int k = 0; k < n; k++) {
      sv_gaussian g;
      sv_gaussians_get(&s->trainer.g, i + k, &g);
      sv_splat_encode(&g, s->ply.buffer + k * SV_SPLAT_BYTES);
    }
    r = sink.write(sink.self, s->ply.buffer, (size_t)n * SV_SPLAT_BYTES, err);
  }
  return r;
}

subview_status subview_save(subview *s, subview_file file, subview_sink sink, subview_error *error) {
  if (!s->is_started) return sv_fail(err_of(error), SV_E_ARG, "there is no model before subview_start");
  const sv_sink out = {.self = &sink, .write = write_sink};
  if (file == SUBVIEW_FILE_PLY) return save_ply(s, out, err_of(error));
  if (file == SUBVIEW_FILE_SPLAT) return save_splat(s, out, err_of(error));
  return sv_fail(err_of(error), SV_E_ARG, "unknown file format %d", (int)file);
}

uint64_t subview_digest(const subview *s) { return sv_train_digest(&s->trainer); }
