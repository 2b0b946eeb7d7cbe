// SPDX-License-Identifier: Apache-2.0
// What came back from a call: answer_NNN.png, answer_NNN_depth.png (or .pfm, in world units),
// answer_NNN_disparity.png.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tools/train/prior.h"

#define PICTURE_WEIGHT 0.2f  // Difix3D+: 0.3 beside 1.5
#define DEPTH_WEIGHT   0.05f // FSGS

static bool find(const lab_prior *p, int i, const char *what, char *path) {
  char name[64];
  snprintf(name, sizeof name, "answer_%03d%s", i, what);
  return sv_path_join(path, SV_CAP_PATH, p->folder, name, NULL) == SV_OK && sv_path_exists(path);
}

static sv_status check_size(const char *path, int w, int h, const sv_view *v, sv_err *err) {
  if (w == v->width_px && h == v->height_px) return SV_OK;
  return sv_fail(err, SV_E_FORMAT, "%s: %dx%d pixels, expected the %dx%d that are trained on", path, w, h,
                 v->width_px, v->height_px);
}

// Without alpha of its own, an image counts where the model was at all.
static void mask_by_model(const lab_prior *p, int i, sv_bitmap *b) {
  char path[SV_CAP_PATH], name[64];
  sv_bitmap was;
  snprintf(name, sizeof name, "render_%03d.png", i);
  if (sv_path_join(path, sizeof path, p->folder, name, NULL) != SV_OK ||
      sv_bitmap_read(path, &was, NULL) != SV_OK)
    return;
  const size_t n = (size_t)b->width_px * (size_t)b->height_px;
  if (was.n_channels == 4 && was.bits == 8 && was.width_px == b->width_px && was.height_px == b->height_px)
    for (size_t k = 0; k < n; k++) b->u8[4 * k + 3] = was.u8[4 * k + 3] > 127 ? 255 : 0;
  sv_bitmap_free(&was);
}

static sv_status take_picture(lab_prior *p, int i, const char *path, float until, int *id, sv_err *err) {
  const sv_view *v = &p->request[i];
  sv_bitmap b;
  sv_status s = sv_bitmap_read(path, &b, err);
  if (s != SV_OK) return s;
  s = check_size(path, b.width_px, b.height_px, v, err);
  const bool has_alpha = b.n_channels == 2 || b.n_channels == 4;
  if (s == SV_OK) s = sv_bitmap_to_8(&b, err);
  if (s == SV_OK) s = sv_bitmap_to_channels(&b, 4, err);
  if (s == SV_OK && !has_alpha) mask_by_model(p, i, &b);
  if (s == SV_OK) {
    const sv_image_u8 im = {b.u8, b.width_px, b.height_px, 4, 4 * b.width_px};
    const float weight = p->o->prior_weight >= 0 ? (float)p->o->prior_weight : PICTURE_WEIGHT;
    s = sv_prior_submit_view(p->prior, v, &im, weight, until, id);
    if (s != SV_OK) s = sv_fail(err, s, "%s: %s", path, sv_status_text(s));
    p->n_pictures += s == SV_OK;
  }
  sv_bitmap_free(&b);
  return s;
}

// 8 or 16 bits; of depth 0 is unknown, of disparity it is far away.
static sv_status read_png(lab_prior *p, const char *path, const sv_view *v, bool is_disparity, sv_err *err) {
  sv_bitmap b;
  sv_status s = sv_bitmap_read(path, &b, err);
  if (s != SV_OK) return s;
  s = check_size(path, b.width_px, b.height_px, v, err);
  if (s == SV_OK && b.n_channels != 1)
    s = sv_fail(err, SV_E_FORMAT, "%s: %d channels, expected one (gray, 8 or 16 bits)", path, b.n_channels);
  const size_t n = s == SV_OK ? (size_t)b.width_px * (size_t)b.height_px : 0;
  for (size_t k = 0; k < n; k++) {
    const float value = b.bits == 16 ? (float)b.u16[k] / 65535.0f : (float)b.u8[k] / 255.0f;
    p->map[k] = value > 0.0f || is_disparity ? value : -1.0f;
  }
  sv_bitmap_free(&b);
  return s;
}

// "Pf", width, height, scale (negative: little-endian), one white character, floats from the bottom
// row up.
static sv_status read_pfm(lab_prior *p, const char *path, const sv_view *v, sv_err *err) {
  void *data;
  size_t bytes;
  int w, h, at = 0;
  double scale;
  sv_status s = sv_file_read(path, &data, &bytes, err);
  if (s != SV_OK) return s;
  const char *text = data; // one zero byte follows
  if (sscanf(text, "Pf %d %d %lf%n", &w, &h, &scale, &at) != 3 || at < 1 || w < 1 || h < 1)
    s = sv_fail(err, SV_E_FORMAT, "%s: not a gray PFM, expected \"Pf\", width, height and scale", path);
  else s = check_size(path, w, h, v, err);
  if (s == SV_OK && (scale >= 0 || bytes != (size_t)at + 1 + sizeof(float) * (size_t)w * (size_t)h))
    s = sv_fail(err, SV_E_FORMAT,
                "%s: expected %dx%d little-endian floats (a negative scale) and nothing more", path, w, h);
  for (int y = 0; y < h && s == SV_OK; y++)
    memcpy(p->map + (size_t)y * (size_t)w, text + at + 1 + sizeof(float) * (size_t)(h - 1 - y) * (size_t)w,
           sizeof(float) * (size_t)w);
  const size_t n = s == SV_OK ? (size_t)w * (size_t)h : 0;
  for (size_t k = 0; k < n; k++)
    if (!(p->map[k] > 0.0f) || !isfinite(p->map[k])) p->map[k] = -1.0f;
  free(data);
  return s;
}

static sv_status take_depth(lab_prior *p, int i, int id, const sv_view *v, sv_err *err) {
  char path[SV_CAP_PATH];
  sv_prior_depth_kind kind = SV_PRIOR_METRIC;
  sv_status s;
  if (find(p, i, "_depth.pfm", path)) s = read_pfm(p, path, v, err);
  else if (find(p, i, "_depth.png", path)) {
    kind = SV_PRIOR_RELATIVE;
    s = read_png(p, path, v, false, err);
  } else if (find(p, i, "_disparity.png", path)) {
    kind = SV_PRIOR_INVERSE;
    s = read_png(p, path, v, true, err);
  } else return SV_OK;
  if (s != SV_OK) return s;
  s = sv_prior_submit_depth(p->prior, id,
                            &(sv_prior_map){p->map, v->width_px, v->height_px, kind, DEPTH_WEIGHT});
  if (s != SV_OK) return sv_fail(err, s, "%s: %s", path, sv_status_text(s));
  p->n_depths++;
  return SV_OK;
}

sv_status lab_prior_take(lab_prior *p, int i, int id, float until, sv_err *err) {
  char path[SV_CAP_PATH];
  const sv_view *v = id >= 0 ? &p->trainer->views[id].view : &p->request[i];
  if (id < 0) { // depth goes with an image: alone it would have no view to belong to
    if (!find(p, i, ".png", path)) return SV_OK;
    sv_status s = take_picture(p, i, path, until, &id, err);
    if (s != SV_OK) return s;
  }
  return take_depth(p, i, id, v, err);
}

sv_status lab_prior_load(lab_prior *p, sv_err *err) {
  for (int i = 0; i < p->views->n; i++) {
    const lab_frame *f = &p->views->frames[i];
    sv_prior_depth_kind kind =
        f->f.prior_kind == SV_TRANSFORMS_DISPARITY ? SV_PRIOR_INVERSE : SV_PRIOR_RELATIVE;
    char path[SV_CAP_PATH];
    sv_status s;
    if (!f->f.prior_kind) continue;
    if ((s = sv_path_join(path, sizeof path, p->o->data, f->f.prior_path, err)) != SV_OK) return s;
    if (f->lens.is_remapped || f->lens.is_fisheye)
      return sv_fail(err, SV_E_UNSUPPORTED,
                     "%s: depth priors of distorted and fisheye images are not supported, expected a pinhole "
                     "camera",
                     path);
    if (strcmp(sv_path_extension(path), ".pfm") == 0) {
      kind = SV_PRIOR_METRIC;
      s = read_pfm(p, path, &f->view, err);
    } else s = read_png(p, path, &f->view, kind == SV_PRIOR_INVERSE, err);
    if (s != SV_OK) return s;
    s = sv_prior_submit_depth(
        p->prior, i, &(sv_prior_map){p->map, f->view.width_px, f->view.height_px, kind, DEPTH_WEIGHT});
    if (s != SV_OK) return sv_fail(err, s, "%s: %s", path, sv_status_text(s));
    p->n_files++;
  }
  return SV_OK;
}
