// SPDX-License-Identifier: Apache-2.0
#include "tools/train/prior.h"

#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "src/base/str.h"
#include "src/prior/align.h"

// Difix3D+ calls at 3, 6, 8, 10, ... of 60 thousand steps.
#define FIRST_CALL  (3.0f / 60.0f)
#define SECOND_CALL (6.0f / 60.0f)
#define NEXT_CALL   (2.0f / 60.0f)
#define KEPT_CALLS  3 // pseudo-views of so many calls are trained on
// It draws a pseudo-view in three of ten steps, whose loss counts a fifth of the others'.
#define PSEUDO_EVERY  3
#define PSEUDO_WEIGHT 0.2f
// of cfg.novel_rad, and how much more at the end: a model learns to be seen from afar
#define TURN_START 0.5f
#define TURN_MORE  1.0f

// [METHOD,]external:CMD
static const char *command_of(const char *prior) {
  static const char key[] = "external:";
  const char *more = prior ? strchr(prior, ',') : NULL;
  if (!prior) return NULL;
  if (strncmp(prior, key, sizeof key - 1) == 0) return prior + sizeof key - 1;
  return more && strncmp(more + 1, key, sizeof key - 1) == 0 ? more + sizeof key : NULL;
}

// -1: no such method.
static int method_of(const char *prior) {
  const size_t n = prior ? strcspn(prior, ",") : 0;
  if (!prior || strncmp(prior, "external:", 9) == 0) return SV_PRIOR_NONE;
  for (int m = SV_PRIOR_NONE; m <= SV_PRIOR_SPARSEGS; m++) {
    const char *name = sv_prior_method_name((sv_prior_method)m);
    if (strlen(name) == n && strncmp(prior, name, n) == 0 && (!prior[n] || command_of(prior))) return m;
  }
  return -1;
}

int lab_prior_check(const lab_options *o) {
  const char *command = command_of(o->prior);
  const bool has_more =
      o->prior_views >= 0 || o->prior_calls >= 0 || o->prior_limit_s >= 0 || o->prior_weight >= 0;
  if (method_of(o->prior) < 0 || (command && !*command))
    return lab_usage("train",
                     "--prior must be none, fsgs, sparsegs, external:CMD or fsgs,external:CMD, not '%.80s'",
                     o->prior);
  if (has_more && !command)
    return lab_usage("train", "--prior-views, --prior-calls, --prior-weight and --prior-limit need --prior "
                              "external:CMD");
  if ((command || method_of(o->prior) > 0) && o->method && sv_str_eq(o->method, "4dgs"))
    return lab_usage("train", "--prior supports static scenes only, not --model 4dgs");
  return LAB_EXIT_OK;
}

void lab_prior_cfg(const lab_options *o, const lab_views *v, sv_prior_cfg *c) {
  const int n = o->prior_views > 0 ? (int)o->prior_views : LAB_PRIOR_VIEWS;
  if (command_of(o->prior)) {
    c->cap_pseudo = KEPT_CALLS * n;
    c->cap_depths = c->cap_pseudo + v->n;
    c->every = PSEUDO_EVERY;
  }
  const int every = c->every;
  sv_prior_set_method(c, (sv_prior_method)method_of(o->prior), v->n);
  if (every > 0) {
    c->every = every;
    c->warp_every = 0;
  } // mended views instead of warped ones
}

// --- what a call is given ------------------------------------------------------------------------

static sv_status write_png(const lab_prior *p, const char *what, int i, const sv_bitmap *b, sv_err *err) {
  char path[SV_CAP_PATH], name[64];
  snprintf(name, sizeof name, "%s_%03d.png", what, i);
  sv_status s = sv_path_join(path, sizeof path, p->folder, name, err);
  return s == SV_OK ? sv_bitmap_write_png(path, b, err) : s;
}

static sv_status write_picture(lab_prior *p, const char *what, int i, const sv_image_u8 *im, sv_err *err) {
  const sv_bitmap b = {im->width_px, im->height_px, im->n_channels, 8, p->rgba, NULL};
  for (int y = 0; y < im->height_px; y++)
    memcpy(p->rgba + (size_t)y * (size_t)(im->width_px * im->n_channels),
           im->px + (size_t)y * (size_t)im->stride_bytes, (size_t)(im->width_px * im->n_channels));
  return write_png(p, what, i, &b, err);
}

static uint8_t byte_of(float v) { return (uint8_t)(v <= 0.0f ? 0 : v >= 1.0f ? 255 : v * 255.0f + 0.5f); }

// The model as it is, its alpha and depth, and the nearest image that was taken.
static sv_status write_render(lab_prior *p, int i, const sv_view *v, float progress, sv_err *err) {
  sv_trainer *t = p->trainer;
  sv_status s = sv_prior_render(p->prior, v, progress);
  if (s < 0) return sv_fail(err, s, "a view for the prior cannot be rendered: %s", sv_status_text(s));
  const sv_planes *x = &t->render.rgb;
  for (int y = 0; y < x->height_px; y++)
    for (int col = 0; col < x->width_px; col++) {
      const size_t from = (size_t)y * (size_t)x->stride + (size_t)col;
      const size_t to = (size_t)y * (size_t)x->width_px + (size_t)col;
      for (int c = 0; c < 3; c++) p->rgba[4 * to + (size_t)c] = byte_of(x->c[c][from]);
      p->rgba[4 * to + 3] = byte_of(1.0f - t->render.trans[from]);
      p->units[to] = (uint16_t)fmin(65535, (double)p->prior->expected[from] / p->depth_unit + 0.5);
    }
  const sv_bitmap colour = {v->width_px, v->height_px, 4, 8, p->rgba, NULL},
                  depth = {v->width_px, v->height_px, 1, 16, NULL, p->units};
  s = write_png(p, "render", i, &colour, err);
  if (s == SV_OK) s = write_png(p, "depth", i, &depth, err);
  return s == SV_OK ? write_picture(p, "reference", i, &t->views[sv_prior_nearest(p->prior, v)].image, err)
                    : s;
}

// A view of the request, in the axes of transforms JSON (OpenGL's).
static void list_view(const lab_prior *p, FILE *f, int i, const sv_view *v, bool is_picture) {
  float eye[3];
  sv_view_centre(eye, v);
  fprintf(f, "%s  {\"file_path\": \"%s_%03d.png\", \"transform_matrix\": [", i ? ",\n" : "",
          is_picture ? "picture" : "render", i);
  for (int r = 0; r < 3; r++)
    fprintf(f, "[%.9g, %.9g, %.9g, %.9g], ", (double)v->r[r], -(double)v->r[3 + r], -(double)v->r[6 + r],
            (double)eye[r]);
  fprintf(f,
          "[0, 0, 0, 1]], \"fl_x\": %.9g, \"fl_y\": %.9g, \"cx\": %.9g, \"cy\": %.9g, \"w\": %d, \"h\": %d",
          (double)v->fx, (double)v->fy, (double)v->cx, (double)v->cy, v->width_px, v->height_px);
  const int nearest = is_picture ? i : sv_prior_nearest(p->prior, v);
  if (!is_picture)
    fprintf(f, ", \"depth_path\": \"depth_%03d.png\", \"reference_path\": \"reference_%03d.png\"", i, i);
  fprintf(f, ", \"training_view\": %d}", nearest);
}

static sv_status write_request(const lab_prior *p, const sv_view *views, int n, float progress, sv_err *err) {
  char path[SV_CAP_PATH];
  const bool is_picture = !views;
  sv_status s = sv_path_join(path, sizeof path, p->folder, "request.json", err);
  if (s != SV_OK) return s;
  FILE *f = sv_stream_open(path, err);
  if (!f) return SV_E_IO;
  fprintf(f,
          "{\"kind\": \"%s\", \"step\": %u, \"progress\": %.6g, \"camera_model\": \"PINHOLE\", "
          "\"depth_unit_scale_factor\": %.9g,\n \"frames\": [\n",
          is_picture ? "pictures" : "novel", p->trainer->step, (double)progress, p->depth_unit);
  for (int i = 0; i < n; i++)
    list_view(p, f, i, is_picture ? &p->trainer->views[i].view : &views[i], is_picture);
  fprintf(f, "\n]}\n");
  return sv_stream_save(f, err);
}

// OUT/prior/call_NN, without answers of an earlier run.
static sv_status make_folder(lab_prior *p, sv_err *err) {
  char name[64], path[SV_CAP_PATH], real[PATH_MAX];
  sv_names old;
  snprintf(name, sizeof name, "prior/call_%02d", p->n_calls);
  sv_status s = sv_path_join(path, sizeof path, p->o->out, name, err);
  if (s == SV_OK) s = sv_path_make_folder(path, err);
  if (s != SV_OK) return s;
  if (!realpath(path, real) || !sv_copy(p->folder, sizeof p->folder, real))
    return sv_fail(err, SV_E_RANGE, "%s: this path is too long", path);
  if ((s = sv_folder_list(p->folder, &old, err)) != SV_OK) return s;
  for (int i = 0; i < old.n && s == SV_OK; i++) {
    if (strncmp(old.names[i], "answer_", 7) != 0) continue;
    s = sv_path_join(path, sizeof path, p->folder, old.names[i], err);
    if (s == SV_OK && unlink(path) != 0) s = sv_fail(err, SV_E_IO, "%s: cannot be removed", path);
  }
  sv_names_free(&old);
  return s;
}

// --- calls ---------------------------------------------------------------------------------------

static sv_status run_command(lab_prior *p, sv_err *err) {
  char log[SV_CAP_PATH];
  const double t0 = lab_seconds(p->session);
  sv_status s = sv_path_join(log, sizeof log, p->folder, "log.txt", err);
  if (s == SV_OK) s = lab_prior_run(p->command, p->folder, log, p->limit_s, &p->session->console, err);
  p->seconds += lab_seconds(p->session) - t0;
  p->n_calls++;
  return s;
}

static sv_status call_with_pictures(lab_prior *p, sv_err *err) {
  const int n = p->trainer->n_views;
  sv_status s = make_folder(p, err);
  for (int i = 0; i < n && s == SV_OK; i++)
    s = write_picture(p, "picture", i, &p->trainer->views[i].image, err);
  if (s == SV_OK) s = write_request(p, NULL, n, 0.0f, err);
  if (s == SV_OK) s = run_command(p, err);
  for (int i = 0; i < n && s == SV_OK; i++) s = lab_prior_take(p, i, i, 0.0f, err);
  return s;
}

static float interval(const lab_prior *p) {
  return p->o->prior_calls > 0 ? (1.0f - FIRST_CALL) / (float)p->o->prior_calls : NEXT_CALL;
}

static sv_status call_for_views(lab_prior *p, float progress, sv_err *err) {
  const float turn = p->trainer->cfg.novel_rad * (TURN_START + TURN_MORE * progress);
  sv_status s = sv_prior_request_views(p->prior, turn, p->n_views, p->request);
  if (s < 0) return sv_fail(err, s, "no views to ask for: %s", sv_status_text(s));
  s = make_folder(p, err);
  for (int i = 0; i < p->n_views && s == SV_OK; i++) s = write_render(p, i, &p->request[i], progress, err);
  if (s == SV_OK) s = write_request(p, p->request, p->n_views, progress, err);
  if (s == SV_OK) s = run_command(p, err);
  const float until = progress + (float)KEPT_CALLS * interval(p);
  for (int i = 0; i < p->n_views && s == SV_OK; i++)
    s = lab_prior_take(p, i, -1, until > 1.0f - interval(p) ? 2.0f : until, err);
  return s;
}

static void set_depth_unit(lab_prior *p) {
  const sv_trainer *t = p->trainer;
  double farthest = 0;
  for (int i = 0; i < t->n_views; i++) {
    float eye[3];
    double d[3];
    sv_view_centre(eye, &t->views[i].view);
    for (int k = 0; k < 3; k++) d[k] = (double)eye[k] - (double)t->centre[k];
    farthest = fmax(farthest, sv_norm3(d));
  }
  p->depth_unit = (farthest + 4.0 * (double)t->radius) / 65535.0; // well behind the scene
}

// What the images themselves tell of depth, for the views that nobody else told of.
static sv_status measure(lab_prior *p, const sv_bounds *bounds, sv_arena *scratch, sv_err *err) {
  sv_status s = sv_prior_measure(p->prior, bounds, scratch, &p->n_maps);
  if (s < 0) return sv_fail(err, s, "no depth maps for --prior: %s", sv_status_text(s));
  if (p->n_maps > 0) lab_say(p->session, "depth maps of %d views from their overlap", p->n_maps);
  if (p->method && p->n_maps + p->n_files + p->n_depths == 0)
    lab_say(p->session,
            "--prior %s: no depth maps (the views do not overlap, the dataset has no depth_prior); "
            "continuing without a depth loss",
            sv_prior_method_name(p->method));
  return SV_OK;
}

static void align(lab_prior *p, const sv_bounds *bounds) {
  p->n_aligned = sv_prior_align_to_ball(p->prior, bounds);
  if (p->n_aligned > 0)
    lab_say(p->session, "depth priors of %d views: scale and shift from the ball around the scene",
            p->n_aligned);
}

static sv_status begin_calls(lab_prior *p, sv_err *err) {
  const lab_options *o = p->o;
  p->n_views = o->prior_views > 0 ? (int)o->prior_views : LAB_PRIOR_VIEWS;
  p->limit_s = o->prior_limit_s > 0 ? o->prior_limit_s : LAB_PRIOR_LIMIT_S;
  p->next = FIRST_CALL;
  if (!(p->request = malloc((size_t)p->n_views * sizeof *p->request)))
    return sv_fail(err, SV_E_NOMEM, "no memory for the views of --prior");
  set_depth_unit(p);
  sv_status s = call_with_pictures(p, err);
  if (s == SV_OK && p->n_depths > 0)
    lab_say(p->session, "depth maps of %d of %d views from '%.80s'", p->n_depths, p->views->n, p->command);
  return s;
}

sv_status lab_prior_begin(lab_prior *p, const lab_prior_input *run, const sv_bounds *bounds,
                          sv_arena *scratch, sv_err *err) {
  *p = (lab_prior){.o = run->o,
                   .session = run->session,
                   .trainer = run->prior->t,
                   .prior = run->prior,
                   .views = run->views,
                   .command = command_of(run->o->prior)};
  p->method = (sv_prior_method)method_of(run->o->prior);
  if (!p->command && !p->method) return SV_OK;
  const size_t px = run->views->cap_floats;
  p->rgba = malloc(4 * px);
  p->units = malloc(px * sizeof *p->units);
  p->map = malloc(px * sizeof *p->map);
  if (!p->rgba || !p->units || !p->map)
    return sv_fail(err, SV_E_NOMEM, "no memory for the images of --prior");
  for (int i = 0; p->command && i < p->views->n; i++)
    if (p->views->frames[i].lens.is_fisheye)
      return sv_fail(err, SV_E_UNSUPPORTED,
                     "%s: a fisheye; views are asked of a prior's program as pinholes only",
                     p->views->frames[i].path);
  sv_status s = lab_prior_load(p, err);
  if (s == SV_OK && p->command) s = begin_calls(p, err);
  const bool has_depths = p->n_files + p->n_depths > 0;
  if (s == SV_OK && (p->method || has_depths)) s = measure(p, bounds, scratch, err);
  if (s == SV_OK && has_depths) align(p, bounds);
  return s;
}

// Calls stay at their places however late one is: those that are past by now are left out.
static void plan_next(lab_prior *p, float progress) {
  const bool is_second = p->o->prior_calls < 1 && p->n_calls == 1;
  if (is_second) p->next = SECOND_CALL;
  while (p->next <= progress) p->next += interval(p);
}

void lab_prior_tick(lab_prior *p, float progress) {
  sv_err err = {0};
  const int before = p->n_pictures + p->n_depths;
  if (!p->command || p->is_off || progress < p->next) return;
  if (p->o->prior_calls > 0 && p->n_calls > p->o->prior_calls)
    return; // the place after the last may round to the end
  plan_next(p, progress);
  sv_status s = call_for_views(p, progress, &err);
  if (s == SV_OK && p->n_pictures + p->n_depths == before)
    lab_say(p->session, "%s: call %d returned nothing", p->folder, p->n_calls - 1);
  if (s == SV_OK || s == SV_E_INTERRUPTED) return;
  p->is_off = true;
  fprintf(stderr, "warning: %s; training continues without the prior\n", err.text);
}

void lab_prior_report(lab_report *j, const lab_prior *p) {
  if (p->command || p->method) {
    lab_report_int(j, "prior_depth_files", p->n_files);
    lab_report_int(j, "prior_depth_maps", p->n_maps);
  }
  if (p->method) {
    lab_report_int(j, "prior_warped", p->prior->n_warped);
    lab_report_int(j, "prior_unpooled", p->prior->n_unpooled);
    lab_report_int(j, "prior_pruned", p->prior->n_pruned);
    lab_report_num(j, "prior_dip", p->prior->last_dip);
  }
  if (!p->command) return;
  lab_report_int(j, "prior_calls", p->n_calls);
  lab_report_int(j, "prior_pictures", p->n_pictures);
  lab_report_int(j, "prior_depths", p->n_depths);
  lab_report_num(j, "prior_seconds", p->seconds);
  lab_report_bool(j, "prior_failed", p->is_off);
}

void lab_prior_end(lab_prior *p) {
  free(p->request);
  free(p->rgba);
  free(p->units);
  free(p->map);
}
