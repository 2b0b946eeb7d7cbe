// SPDX-License-Identifier: Apache-2.0
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/mathx.h"
#include "src/base/str.h"
#include "tools/pictures/animation.h"
#include "tools/train/evaluate.h"
#include "tools/lab/model_formats.h"
#include "tools/pictures/film.h"
#include "tools/pictures/movie.h"
#include "tools/pictures/orbit.h"
#include "tools/common/report.h"

#define FILM_FPS        12
#define ROUND_MS        6000 // that an orbit takes in its animation
#define FRAME_MS        33   // at least
#define DEPTH_ALPHA_MIN 0.5f // a pixel that is mostly background has no depth

typedef struct {
  const lab_options *o;
  lab_session session;
  lab_model model;
  lab_views views; // of the split, or those that tell the orbit's circle; none without --data
  lab_orbit orbit;
  lab_settings settings;
  lab_viewer viewer;
  lab_report list;
  lab_animation *animation; // NULL: none
  lab_video video;
  lab_film_kind film;
  uint8_t *rgb, *frame; // of the view that is rendered; of the film
  uint16_t *z;
  float *depth;
  double depth_unit; // scene units of one step of a depth PNG
} run;

static double round_up_125(double x) { // to 1, 2 or 5 times a power of ten
  double p = 1;
  while (p > x) p /= 10;
  while (p * 10 <= x) p *= 10;
  return x <= p ? p : x <= 2 * p ? 2 * p : x <= 5 * p ? 5 * p : 10 * p;
}

static void list_view(run *r, const sv_view *v, const char *name) {
  lab_report *j = &r->list;
  float pose[12];
  for (int i = 0; i < 3; i++) {
    for (int k = 0; k < 3; k++) pose[4 * i + k] = v->r[3 * i + k];
    pose[4 * i + 3] = v->t[i];
  }
  lab_report_item_begin(j);
  lab_report_text(j, "name", name);
  lab_report_int(j, "w", v->width_px);
  lab_report_int(j, "h", v->height_px);
  lab_report_nums(j, "fx_fy_cx_cy", (float[]){v->fx, v->fy, v->cx, v->cy}, 4);
  lab_report_nums(j, "cam_from_world_3x4", pose, 12);
  lab_report_item_end(j);
}

static sv_status write_depth(run *r, const sv_view *v, const char *name, sv_err *err) {
  char path[SV_CAP_PATH], file[SV_CAP_PATH];
  size_t w = (size_t)v->width_px, h = (size_t)v->height_px, stride = (size_t)r->viewer.r.rgb.stride;
  sv_render_expected_depth(&r->viewer.r, DEPTH_ALPHA_MIN, r->depth);
  for (size_t y = 0; y < h; y++)
    for (size_t x = 0; x < w; x++) {
      double z = (double)r->depth[y * stride + x] / r->depth_unit;
      r->z[y * w + x] = (uint16_t)(z <= 0 ? 0 : z >= 65535 ? 65535 : z + 0.5);
    }
  snprintf(file, sizeof file, "%.900s_depth.png", name);
  sv_status s = sv_path_join(path, sizeof path, r->o->out, file, err);
  sv_bitmap b = {
      .width_px = v->width_px, .height_px = v->height_px, .n_channels = 1, .bits = 16, .u16 = r->z};
  return s == SV_OK ? sv_bitmap_write_png(path, &b, err) : s;
}

static sv_status draw(run *r, const sv_view *v, const char *name, sv_err *err) {
  const bool has_depth = r->o->has_depth || r->film == LAB_FILM_DEPTH;
  const sv_render_options o = lab_render_options(&r->settings, r->model.g.sh_degree, has_depth);
  const lab_motion motion = lab_model_motion(&r->model);
  sv_status s = lab_motion_at(&motion, &r->session, &r->model.g, v->time, err);
  if (s < 0) return s;
  s = sv_render(&r->viewer.r, &r->model.g, v, &o);
  if (s < 0) return sv_fail(err, s, "view %s cannot be rendered: %s", name, sv_status_text(s));
  lab_to_bytes(&r->viewer.r.rgb, r->rgb);
  return SV_OK;
}

static sv_status draw_eyes(run *r, const sv_view *v, const char *name, sv_err *err) {
  sv_view eyes[2];
  const size_t row = 3 * (size_t)v->width_px;
  sv_status s = SV_OK;
  lab_film_eyes(v, r->orbit.scene.distance, eyes);
  for (size_t i = 0; i < 2 && s == SV_OK; i++) {
    s = draw(r, &eyes[i], name, err);
    for (size_t y = 0; y < (size_t)v->height_px; y++)
      memcpy(r->frame + row * (2 * y + i), r->rgb + row * y, row);
  }
  return s;
}

static void draw_depth(run *r, const sv_view *v) {
  const float d = r->orbit.scene.distance, reach = r->settings.radius;
  const float near_far[2] = {d > 2 * reach ? d - reach : 0.5f * d, d + 2 * reach};
  sv_render_expected_depth(&r->viewer.r, DEPTH_ALPHA_MIN, r->depth);
  lab_film_depth(r->depth, (const int[2]){v->width_px, v->height_px}, (size_t)r->viewer.r.rgb.stride,
                 near_far, r->frame);
}

// The picture of a view in r->frame or, of a film in color, in r->rgb; the film gets it.
static sv_status film_view(run *r, const sv_view *v, const char *name, sv_err *err) {
  sv_status s = r->film == LAB_FILM_STEREO ? draw_eyes(r, v, name, err) : draw(r, v, name, err);
  if (s != SV_OK) return s;
  if (r->film == LAB_FILM_DEPTH) draw_depth(r, v);
  const uint8_t *frame = r->film == LAB_FILM_COLOR ? r->rgb : r->frame;
  if (r->animation && (s = lab_animation_add(r->animation, frame, err)) != SV_OK) return s;
  return r->video.pid ? lab_video_add(&r->video, frame, err) : SV_OK;
}

static sv_status render_view(run *r, const sv_view *v, const char *name, sv_err *err) {
  char path[SV_CAP_PATH], file[SV_CAP_PATH];
  sv_status s = film_view(r, v, name, err);
  if (s != SV_OK || lab_is_film(r->o->out)) return s;
  snprintf(file, sizeof file, "%.900s.png", name);
  if ((s = sv_path_join(path, sizeof path, r->o->out, file, err)) != SV_OK) return s;
  sv_bitmap b = {
      .width_px = v->width_px, .height_px = v->height_px, .n_channels = 3, .bits = 8, .u8 = r->rgb};
  if ((s = sv_bitmap_write_png(path, &b, err)) != SV_OK) return s;
  list_view(r, v, name);
  return r->o->has_depth ? write_depth(r, v, name, err) : SV_OK;
}

static void view_name(const run *r, int i, char *out, size_t cap) {
  if (r->o->frames > 0) {
    snprintf(out, cap, "frame_%04d", i);
    return;
  }
  if (r->o->orbit > 0) {
    snprintf(out, cap, "orbit_%04d", i);
    return;
  }
  lab_view_name(&r->views, i, out, cap);
}

static sv_status open_views(run *r, sv_err *err) {
  lab_source src = {.folder = r->o->data,
                    .transforms = r->settings.transforms,
                    .told_by = r->settings.told_by,
                    .refined = r->settings.refined,
                    .split = r->o->orbit > 0 ? "train"
                             : r->o->split   ? r->o->split
                                             : "test",
                    .scale = r->settings.scale};
  if (sv_str_eq(src.split, "test_near")) src.n_exposures = r->settings.n_exposures;
  sv_status s = lab_views_open(&r->views, &src, &r->session.pool, err);
  if (s != SV_OK) return s;
  lab_turn_back(&r->model, &r->session, r->o->model, r->o->up, &r->views);
  r->orbit = lab_orbit_of_views(&r->views, r->o->orbit > 0 ? r->o->width_px : 0);
  return SV_OK;
}

static sv_status prepare(run *r, sv_err *err) {
  sv_status s = lab_model_read(&r->model, r->o->model, err);
  if (s == SV_OK) s = lab_settings_for(&r->settings, r->o, &r->model, err);
  if (s == SV_OK && r->o->data) s = open_views(r, err);
  if (s != SV_OK) return s;
  if (!r->o->data) {
    if (r->o->up) sv_copy(r->model.up, sizeof r->model.up, r->o->up);
    r->orbit = lab_orbit_of_model(&r->model, &r->settings, r->o->width_px);
  }
  const lab_scene *scene = &r->orbit.scene;
  // Depth may reach well behind the scene before it is cut off.
  r->depth_unit = round_up_125(((double)scene->distance + 4 * (double)r->settings.radius) / 65535);
  const int w = sv_maxi(r->orbit.lens.width_px, r->views.cap_width_px),
            h = sv_maxi(r->orbit.lens.height_px, r->views.cap_height_px);
  if (h > SV_BITMAP_CAP_SIDE_PX)
    return sv_fail(err, SV_E_RANGE, "--width %ld: the images would be %d pixels high", r->o->width_px, h);
  size_t n = sv_plane_floats(w, h); // padded, so at least as much as is needed
  if (n < r->views.cap_floats) n = r->views.cap_floats;
  if ((s = lab_viewer_start(
           &r->viewer, &r->session,
           (sv_renderer_cfg){
               .cap_gaussians = r->model.g.n, .cap_width_px = w, .cap_height_px = h, .cap_pixels = n},
           err)) != SV_OK)
    return s;
  r->rgb = malloc(3 * n);
  r->z = malloc(n * sizeof *r->z);
  r->depth = malloc(n * sizeof *r->depth);
  r->frame = malloc(6 * n);
  if (!r->rgb || !r->z || !r->depth || !r->frame) return sv_fail(err, SV_E_NOMEM, "no memory for an image");
  return lab_is_film(r->o->out) ? SV_OK : lab_session_folder(&r->session, r->o->out, err);
}

static bool is_film(const run *r) { return r->o->frames > 0; }
static int n_pictures(const run *r) {
  return (int)(is_film(r) ? r->o->frames : r->o->orbit > 0 ? r->o->orbit : r->views.n);
}

// Frames that follow one another become an animation beside the images, or, where --out names one,
// instead of them.
static sv_status start_film(run *r, sv_err *err) {
  const bool is_alone = lab_is_film(r->o->out), is_orbit = r->o->orbit > 0;
  const sv_view *v = is_orbit || !r->views.n ? &r->orbit.lens : &r->views.frames[0].view;
  const int size[2] = {r->film == LAB_FILM_STEREO ? 2 * v->width_px : v->width_px, v->height_px};
  const int ms = sv_maxi(FRAME_MS, is_film(r) ? 1000 / FILM_FPS : is_orbit ? ROUND_MS / (int)r->o->orbit : 0);
  if (!is_film(r) && !is_orbit) return SV_OK;
  if (is_alone && !sv_str_eq(sv_path_extension(r->o->out), ".webp"))
    return lab_video_begin(&r->video, r->o->out, size, 1000.0 / ms, err);
  sv_status s = lab_animation_is_built()
                    ? lab_animation_begin(&r->animation, size[0], size[1], ms, err)
                    : sv_fail(err, SV_E_UNSUPPORTED, "built without libwebp (Debian: libwebp-dev)");
  if (s == SV_OK || is_alone) return s;
  lab_say(&r->session, "no animated WebP: %s", err->text);
  return SV_OK;
}

// What is written from all the pictures.
static sv_status finish(run *r, int n, sv_err *err) {
  char path[SV_CAP_PATH];
  sv_status s = SV_OK;
  if (lab_is_film(r->o->out)) {
    s = r->animation ? lab_animation_write(r->animation, r->o->out, err) : lab_video_end(&r->video, err);
    if (s == SV_OK) lab_say(&r->session, "%s: %d frames", r->o->out, n);
    return s;
  }
  s = sv_path_join(path, sizeof path, r->o->out, "views.json", err);
  if (s == SV_OK) s = lab_report_save(&r->list, path, err);
  if (s != SV_OK) return s;
  if (r->o->has_depth)
    lab_say(
        &r->session,
        "%d views in %s; one step of a depth PNG is %g scene units along the optical axis; 0 means no depth",
        n, r->o->out, r->depth_unit);
  else lab_say(&r->session, "%d views in %s", n, r->o->out);
  if (r->animation) {
    s = sv_path_join(path, sizeof path, r->o->out, is_film(r) ? "movie.webp" : "orbit.webp", err);
    if (s == SV_OK) s = lab_animation_write(r->animation, path, err);
    if (s != SV_OK) return s;
    lab_say(&r->session, "animation: %s", path);
  }
  return is_film(r) ? lab_movie_make(&r->session, r->o->out, n, FILM_FPS, err) : SV_OK;
}

static sv_status render_all(run *r, sv_err *err) {
  char name[SV_CAP_PATH];
  sv_console *c = &r->session.console;
  sv_status s = prepare(r, err);
  if (s != SV_OK) return s;
  if (is_film(r) && !r->model.deform.kind && !r->model.sequence)
    return sv_fail(err, SV_E_NOT_FOUND,
                   "%s: is static (no motion.bin beside it); --frames needs a moving model", r->o->model);
  int n = n_pictures(r);
  if ((s = start_film(r, err)) != SV_OK) return s;
  lab_report_begin(&r->list);
  if (r->o->has_depth) lab_report_num(&r->list, "depth_unit_scale_factor", r->depth_unit);
  lab_report_array(&r->list, "views");
  for (int i = 0; i < n; i++) {
    sv_view v = r->views.n ? r->views.frames[r->o->orbit > 0 || is_film(r) ? 0 : i].view : r->orbit.lens;
    if (c->is_stop_requested(c->self))
      return sv_fail(err, SV_E_INTERRUPTED, "stopped by request at view %d of %d", i, n);
    if (r->o->orbit > 0 && (s = lab_orbit_view(&r->orbit, (double)i / n, &v, err)) != SV_OK) return s;
    if (is_film(r)) v.time = (float)i / (float)(n - 1);
    view_name(r, i, name, sizeof name);
    if ((s = render_view(r, &v, name, err)) != SV_OK) return s;
    snprintf(name, sizeof name, "rendered %d of %d views", i + 1, n);
    c->log(c->self, SV_LOG_LIVE, name);
  }
  lab_report_array_end(&r->list);
  lab_report_end(&r->list);
  return finish(r, n, err);
}

int lab_cmd_render(const lab_options *o) {
  sv_err err = {0};
  run r = {.o = o, .film = lab_film_kind_of(o->film)};
  int code = LAB_EXIT_OK;
  sv_status s = lab_session_start(&r.session, o->threads, o->is_quiet, &err);
  if (s == SV_OK) s = sv_linux_catch_signals(&err);
  if (s == SV_OK) s = render_all(&r, &err);
  if (s != SV_OK) code = lab_failed(&r.session, &err);
  lab_session_stop(&r.session);
  lab_report_free(&r.list);
  lab_animation_free(r.animation);
  lab_video_abandon(&r.video);
  free(r.rgb);
  free(r.frame);
  free(r.z);
  free(r.depth);
  lab_viewer_stop(&r.viewer);
  lab_views_free(&r.views);
  lab_model_free(&r.model);
  return code;
}
