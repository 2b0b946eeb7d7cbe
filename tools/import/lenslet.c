// SPDX-License-Identifier: Apache-2.0
// Raw images of a lenslet camera and a white image -> sub-views, their rig, and a dataset.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "src/base/mathx.h"
#include "src/base/str.h"
#include "src/rig/lenslet.h"
#include "tools/common/imageio.h"
#include "tools/import/import.h"
#include "tools/import/lytro.h"

// What nobody has said: a field of view of 53 degrees and a millimeter between sub-views. Scale and
// depth of the result are then arbitrary, its shape is right up to a stretch along the axis.
#define DEFAULT_BASELINE_M 0.001

typedef struct {
  const lab_options *o;
  lab_session *se;
  char images[SV_CAP_PATH];
  sv_lenslet_plan plan;
  float *gain; // [sensor height][sensor width]
  sv_rig rig;
  void *rig_block;
  bool is_lytro;   // raw files of a Lytro camera: values are linear
  lab_lytro lytro; // the first of them
} job;

static sv_raw raw_of(const sv_bitmap *b) {
  return (sv_raw){b->u8, b->u16, b->width_px, b->height_px, b->n_channels};
}

static bool is_container(const char *name) {
  const char *e = sv_path_extension(name);
  return !strcasecmp(e, ".lfp") || !strcasecmp(e, ".lfr");
}

static bool is_picture(const char *name) {
  const char *e = sv_path_extension(name);
  return strcmp(e, ".png") == 0 || strcmp(e, ".jpg") == 0 || strcmp(e, ".jpeg") == 0;
}

static bool is_white(const char *name) { return strncmp(name, "white.", 6) == 0; }

// --- white image ---------------------------------------------------------------------------------

static sv_status find_grid(job *j, const char *path, const sv_raw *white, sv_lenslet_grid *g, sv_err *err) {
  size_t bytes = sv_lenslet_find_bytes() + SV_ARENA_ALIGN;
  void *block = malloc(bytes);
  if (!block) return sv_fail(err, SV_E_NOMEM, "%s: no memory to find its lenslets", path);
  sv_arena a = sv_arena_make(block, bytes);
  sv_status s = sv_lenslet_find(g, path, white, &a, err);
  free(block);
  if (s == SV_OK)
    lab_say(j->se,
            "%s: %s lenslets, pitch %.3f px, rotated by %.3f degrees, one at %.2f, %.2f; %d of %d used, RMS "
            "%.3f px",
            path, g->is_hexagonal ? "hexagonal" : "square", g->pitch_px, g->rotation_rad * 180 / SV_PI,
            g->offset_px[0], g->offset_px[1], g->n_used, g->n_seen, g->rms_px);
  return s;
}

// 9 of 13, as the paper keeps: the rim of a lenslet is dark.
static int default_keep(double pitch_px) {
  int keep = (int)(0.7 * pitch_px);
  return sv_clampi(keep - (keep % 2 == 0), 1, 15);
}

static sv_status use_white(job *j, const char *path, sv_bitmap *b, sv_err *err) {
  sv_lenslet_grid g;
  sv_status s = sv_bitmap_to_channels(b, 1, err);
  if (s != SV_OK) return s;
  sv_raw white = raw_of(b);
  if ((s = find_grid(j, path, &white, &g, err)) != SV_OK) return s;
  sv_lenslet_cfg cfg = {.keep = j->o->keep > 0 ? (int)j->o->keep : default_keep(g.pitch_px)};
  s = sv_lenslet_plan_make(&j->plan, &g, &cfg, b->width_px, b->height_px, err);
  if (s != SV_OK) return s;
  j->gain = malloc(sizeof *j->gain * (size_t)b->width_px * (size_t)b->height_px);
  if (!j->gain) return sv_fail(err, SV_E_NOMEM, "%s: no memory for its vignetting", path);
  return sv_lenslet_gain(&j->plan, path, &white, j->gain, err);
}

static sv_status read_white(job *j, const sv_names *names, sv_err *err) {
  char path[SV_CAP_PATH];
  int i = 0;
  while (i < names->n && !(is_white(names->names[i]) && is_picture(names->names[i]))) i++;
  if (i == names->n)
    return sv_fail(err, SV_E_NOT_FOUND, "%s: has no white.png (or .jpg) of an evenly lit field", j->o->input);
  sv_bitmap b;
  sv_status s = sv_path_join(path, sizeof path, j->o->input, names->names[i], err);
  if (s == SV_OK) s = sv_bitmap_read(path, &b, err);
  if (s != SV_OK) return s;
  s = use_white(j, path, &b, err);
  sv_bitmap_free(&b);
  return s;
}

// A Lytro camera's white images are in DIR/white, or where --white says.
static sv_status read_lytro_white(job *j, const sv_names *names, sv_err *err) {
  char path[SV_CAP_PATH], folder[SV_CAP_PATH];
  sv_bitmap b = {0};
  int i = 0;
  while (i < names->n && !is_container(names->names[i])) i++;
  if (i == names->n) return sv_fail(err, SV_E_NOT_FOUND, "%s: has no .lfp or .lfr files", j->o->input);
  sv_status s = sv_path_join(path, sizeof path, j->o->input, names->names[i], err);
  if (s == SV_OK) s = lab_lytro_read(path, &j->lytro, &b, err);
  sv_bitmap_free(&b);
  if (s == SV_OK)
    s = sv_path_join(folder, sizeof folder, j->o->white ? "." : j->o->input,
                     j->o->white ? j->o->white : "white", err);
  if (s == SV_OK) s = lab_lytro_white(folder, &j->lytro, path, &b, err);
  if (s != SV_OK) return s;
  lab_say(j->se, "white image: %s", path);
  s = use_white(j, path, &b, err);
  sv_bitmap_free(&b);
  return s;
}

// --- rig -----------------------------------------------------------------------------------------

static sv_status make_rig(job *j, sv_err *err) {
  sv_lenslet_optics optics = {.focal_px = j->o->focal_px > 0 ? j->o->focal_px : j->plan.width_px,
                              .baseline_m = j->o->baseline_m > 0 ? j->o->baseline_m : DEFAULT_BASELINE_M,
                              .focus_m = j->o->focus_m > 0 ? j->o->focus_m : 0};
  // One pixel of a sub-view is one microlens; the sub-views lie within the lens's aperture.
  const lab_lytro *l = &j->lytro;
  if (j->is_lytro && l->focal_m > 0 && l->lens_pitch_m > 0 && !(j->o->focal_px > 0))
    optics.focal_px = l->focal_m / l->lens_pitch_m;
  if (j->is_lytro && l->focal_m > 0 && l->f_number > 0 && !(j->o->baseline_m > 0))
    optics.baseline_m = l->focal_m / l->f_number / j->plan.grid.pitch_px;
  int n = j->plan.cfg.keep * j->plan.cfg.keep;
  size_t bytes = sizeof(sv_sub_view) * (size_t)n + 2 * SV_ARENA_ALIGN;
  j->rig_block = malloc(bytes);
  sv_arena a = sv_arena_make(j->rig_block, j->rig_block ? bytes : 0);
  if (sv_rig_init(&j->rig, n, &a) != SV_OK || sv_lenslet_rig(&j->rig, &j->plan, &optics) != SV_OK)
    return sv_fail(err, SV_E_NOMEM, "%s: no memory for a rig of %d sub-views", j->o->input, n);
  if (!(j->o->focal_px > 0 && j->o->baseline_m > 0))
    lab_say(j->se,
            j->is_lytro ? "by the file or assumed: --focal %.6g px, --baseline %.6g m%s"
                        : "assumed: --focal %.6g px, --baseline %.6g m%s",
            optics.focal_px, optics.baseline_m, optics.focus_m > 0 ? "" : ", focus at infinity");
  char folder[SV_CAP_PATH];
  sv_status s = sv_path_join(folder, sizeof folder, j->o->out, "rig", err);
  return s == SV_OK ? lab_rig_write(&j->rig, folder, err) : s;
}

// --- sub-views -----------------------------------------------------------------------------------

typedef struct {
  const job *j;
  sv_bitmap raw;
  int exposure;
  sv_err *errs;
} shot;

static void view_name(const sv_sub_view *v, int exposure, char *out, size_t cap) {
  snprintf(out, cap, "%s/%06d.png", v->name, exposure);
}

static float encode_srgb(float v) {
  return v <= 0.0031308f ? 12.92f * v : 1.055f * powf(v, 1 / 2.4f) - 0.055f;
}

static void put_channel(const float *from, sv_bitmap *b, int channel, bool is_linear) {
  size_t n = (size_t)b->width_px * (size_t)b->height_px, nc = (size_t)b->n_channels;
  for (size_t i = 0; i < n; i++) {
    float v = sv_clampf(from[i], 0, 1);
    if (is_linear) v = encode_srgb(v);
    if (b->bits == 8) b->u8[i * nc + (size_t)channel] = (uint8_t)(v * 255 + 0.5f);
    else b->u16[i * nc + (size_t)channel] = (uint16_t)(v * 65535 + 0.5f);
  }
}

static sv_status write_view(const shot *t, int i_view, sv_err *err) {
  const sv_lenslet_plan *p = &t->j->plan;
  char name[64], path[SV_CAP_PATH], folder[SV_CAP_PATH];
  size_t n = (size_t)p->width_px * (size_t)p->height_px;
  sv_bitmap b = {.width_px = p->width_px,
                 .height_px = p->height_px,
                 .n_channels = t->raw.n_channels,
                 .bits = t->raw.bits};
  view_name(&t->j->rig.sub_views[i_view], t->exposure, name, sizeof name);
  sv_status s = sv_path_join(path, sizeof path, t->j->images, name, err);
  if (s != SV_OK) return s;
  sv_path_folder(folder, sizeof folder, path);
  if ((s = sv_path_make_folder(folder, err)) != SV_OK) return s;
  float *out = malloc(sizeof *out * (n + (size_t)p->n_columns));
  void *px = malloc(n * (size_t)b.n_channels * (size_t)(b.bits / 8));
  if (b.bits == 8) b.u8 = px;
  else b.u16 = px;
  if (!out || !px) s = sv_fail(err, SV_E_NOMEM, "%s: no memory for the image", path);
  sv_raw raw = raw_of(&t->raw);
  for (int c = 0; c < b.n_channels && s == SV_OK; c++) {
    sv_lenslet_decode(p, &(sv_lenslet_image){&raw, t->j->gain, c}, i_view % p->cfg.keep, i_view / p->cfg.keep,
                      out + n, out);
    put_channel(out, &b, c, t->j->is_lytro);
  }
  if (s == SV_OK) s = sv_bitmap_write_png(path, &b, err);
  free(out);
  sv_bitmap_free(&b);
  return s;
}

static void view_task(void *arg, int i_task, int i_thread) {
  shot *t = arg;
  (void)i_thread;
  t->errs[i_task].status =
      lab_is_stopped(t->j->se) ? SV_E_INTERRUPTED : write_view(t, i_task, &t->errs[i_task]);
}

static sv_status decode_all(shot *t, sv_err *err) {
  int n = t->j->rig.n_sub_views;
  sv_status s = SV_OK;
  t->errs = calloc((size_t)n, sizeof *t->errs);
  if (!t->errs) return sv_fail(err, SV_E_NOMEM, "no memory for %d sub-views", n);
  sv_pool_run(&t->j->se->pool, view_task, t, n);
  for (int i = 0; i < n && s == SV_OK; i++)
    if ((s = t->errs[i].status) != SV_OK) *err = t->errs[i];
  free(t->errs);
  return s;
}

static sv_status add_views(lab_import *im, const job *j, int exposure, sv_err *err) {
  sv_status s = SV_OK;
  for (int i = 0; i < j->rig.n_sub_views && s == SV_OK; i++) {
    const sv_sub_view *sub = &j->rig.sub_views[i];
    lab_import_view *v = lab_import_add(im);
    if (!v) return sv_fail(err, SV_E_NOMEM, "no memory for %d views", im->n + 1);
    v->model = sub->model;
    v->cam_from_world = sub->cam_from_rig;
    v->exposure = exposure;
    v->sub_view = i;
    sv_copy(v->camera, sizeof v->camera, sub->name);
    view_name(sub, exposure, v->name, sizeof v->name);
    s = sv_path_join(v->source, sizeof v->source, j->images, v->name, err); // where it already is
  }
  return s;
}

static sv_status add_raw(lab_import *im, const job *j, const char *name, int exposure, sv_err *err) {
  char path[SV_CAP_PATH];
  shot t = {.j = j, .exposure = exposure};
  sv_status s = sv_path_join(path, sizeof path, j->o->input, name, err);
  lab_lytro l;
  if (s == SV_OK) s = j->is_lytro ? lab_lytro_read(path, &l, &t.raw, err) : sv_bitmap_read(path, &t.raw, err);
  if (s != SV_OK) return s;
  if (t.raw.width_px != j->plan.sensor_width_px || t.raw.height_px != j->plan.sensor_height_px)
    s = sv_fail(err, SV_E_FORMAT, "%s: %dx%d pixels, the white image has %dx%d", path, t.raw.width_px,
                t.raw.height_px, j->plan.sensor_width_px, j->plan.sensor_height_px);
  if (s == SV_OK && t.raw.n_channels % 2 == 0) s = sv_bitmap_to_channels(&t.raw, t.raw.n_channels - 1, err);
  if (s == SV_OK) s = decode_all(&t, err);
  sv_bitmap_free(&t.raw);
  return s == SV_OK ? add_views(im, j, exposure, err) : s;
}

static sv_status run(lab_import *im, job *j, const sv_names *names, sv_err *err) {
  int n = 0;
  sv_status s = j->is_lytro ? read_lytro_white(j, names, err) : read_white(j, names, err);
  if (s == SV_OK) s = make_rig(j, err);
  if (s == SV_OK) s = sv_path_join(j->images, sizeof j->images, j->o->out, "images", err);
  for (int i = 0; i < names->n && s == SV_OK; i++)
    if (j->is_lytro ? is_container(names->names[i])
                    : is_picture(names->names[i]) && !is_white(names->names[i]))
      s = add_raw(im, j, names->names[i], n++, err);
  if (s != SV_OK) return s;
  if (!n) return sv_fail(err, SV_E_NOT_FOUND, "%s: has a white image, but no other image", j->o->input);
  for (int i = 0; i < im->n && n > 1; i++) im->views[i].time = (double)im->views[i].exposure / (n - 1);
  lab_say(j->se, "%s: %dx%d sub-views of %dx%d pixels, from %d image%s; assuming a stationary rig", j->o->out,
          j->plan.cfg.keep, j->plan.cfg.keep, j->plan.width_px, j->plan.height_px, n, n == 1 ? "" : "s");
  return SV_OK;
}

sv_status lab_import_lenslet(lab_import *im, const lab_options *o, lab_session *se, sv_err *err) {
  sv_names names;
  job *j = calloc(1, sizeof *j);
  if (!j) return sv_fail(err, SV_E_NOMEM, "%s: no memory to read it", o->input);
  j->o = o;
  j->se = se;
  j->is_lytro = sv_str_eq(o->from, "lytro");
  sv_status s = sv_folder_list(o->input, &names, err);
  if (s == SV_OK) {
    s = run(im, j, &names, err);
    sv_names_free(&names);
  }
  free(j->gain);
  free(j->rig_block);
  free(j);
  return s;
}
