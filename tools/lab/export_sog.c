// SPDX-License-Identifier: Apache-2.0
#include "tools/lab/export_sog.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/str.h"
#include "tools/lab/sog_model.h"
#include "tools/lab/zip.h"

#if defined(__has_include) && __has_include(<webp/encode.h>) && __has_include(<webp/mux.h>)
#include <webp/encode.h>

#define SETS_PER_ROW 64 // of the image of the palette
#define LEVEL        6  // effort of the lossless WebP, 0 to 9
#define CAP_META     16384
#define MAX_FILES    8

typedef struct {
  sog_model m;
  int width, height;
  uint8_t *rgba; // [height][width][4] of the image being made
  char meta[CAP_META];
  lab_zip_entry file[MAX_FILES];
  int n_files;
} sog;

// --- images --------------------------------------------------------------------------------------

// Lossless, colors under transparent pixels included.
static sv_status encode(const sog *s, int width, int height, lab_zip_entry *to, sv_err *err) {
  WebPConfig config;
  WebPPicture p;
  WebPMemoryWriter out;
  if (!WebPConfigInit(&config) || !WebPConfigLosslessPreset(&config, LEVEL) || !WebPPictureInit(&p))
    return sv_fail(err, SV_E_NOMEM, "%s: libwebp does not start", to->name);
  config.exact = 1;
  p.use_argb = 1;
  p.width = width;
  p.height = height;
  WebPMemoryWriterInit(&out);
  p.writer = WebPMemoryWrite;
  p.custom_ptr = &out;
  const bool is_good = WebPPictureImportRGBA(&p, s->rgba, 4 * width) && WebPEncode(&config, &p);
  WebPPictureFree(&p);
  if (!is_good) {
    WebPMemoryWriterClear(&out);
    return sv_fail(err, SV_E_RANGE, "%s: libwebp could not encode %dx%d pixels", to->name, width, height);
  }
  to->data = out.mem;
  to->bytes = out.size;
  return SV_OK;
}

static sv_status add_image(sog *s, const char *name, int width, int height, sv_err *err) {
  lab_zip_entry image = {.name = name};
  const sv_status r = encode(s, width, height, &image, err);
  if (r == SV_OK) s->file[s->n_files++] = image;
  return r;
}

static void clear(sog *s, size_t n_px) {
  memset(s->rgba, 0, 4 * n_px);
  for (size_t i = 0; i < n_px; i++) s->rgba[4 * i + 3] = 255;
}

static void add_numbers(sv_str *t, const char *key, const float *v, int n) {
  sv_str_add(t, "\"%s\":[", key);
  for (int i = 0; i < n; i++) sv_str_add(t, "%s%.6g", i ? "," : "", (double)v[i]);
  sv_str_add(t, "]");
}

static void add_codebook(sv_str *t, const sog_codebook *c) {
  float code[SOG_CODES];
  for (int j = 0; j < SOG_CODES; j++) code[j] = (float)(c->first + j * c->step);
  add_numbers(t, "codebook", code, SOG_CODES);
}

// Pixel of Gaussian i in an image of one pixel for each.
typedef void put_pixel(uint8_t px[4], const sog_model *m, int i);

static sv_status add_pixels(sog *s, const char *name, put_pixel *put, sv_err *err) {
  clear(s, (size_t)s->width * (size_t)s->height);
  for (int i = 0; i < s->m.n; i++) put(s->rgba + 4 * (size_t)i, &s->m, i);
  return add_image(s, name, s->width, s->height, err);
}

static void put_low(uint8_t px[4], const sog_model *m, int i) {
  const sog_coded c = sog_model_code(m, i);
  for (int k = 0; k < 3; k++) px[k] = (uint8_t)(c.position[k] & 255);
}

static void put_high(uint8_t px[4], const sog_model *m, int i) {
  const sog_coded c = sog_model_code(m, i);
  for (int k = 0; k < 3; k++) px[k] = (uint8_t)(c.position[k] >> 8);
}

static void put_scale(uint8_t px[4], const sog_model *m, int i) { memcpy(px, sog_model_code(m, i).scale, 3); }

static void put_quat(uint8_t px[4], const sog_model *m, int i) {
  memcpy(px, sog_model_code(m, i).quat, 3);
  px[3] = 252; // w is left out
}

static void put_color(uint8_t px[4], const sog_model *m, int i) {
  const sog_coded c = sog_model_code(m, i);
  memcpy(px, c.color, 3);
  px[3] = c.alpha;
}

static void put_label(uint8_t px[4], const sog_model *m, int i) {
  px[0] = (uint8_t)(m->label[i] & 255);
  px[1] = (uint8_t)(m->label[i] >> 8);
}

// Set j, coefficient c at column (j % 64) C + c, row j / 64.
static sv_status add_palette(sog *s, sv_err *err) {
  const int n_rest = s->m.n_rest, width = SETS_PER_ROW * n_rest,
            rows = (s->m.palette.n + SETS_PER_ROW - 1) / SETS_PER_ROW;
  clear(s, (size_t)rows * (size_t)width);
  for (int j = 0; j < s->m.palette.n; j++)
    for (int c = 0; c < n_rest; c++) {
      uint8_t *px = s->rgba + 4 * ((size_t)(j / SETS_PER_ROW) * (size_t)width +
                                   (size_t)(j % SETS_PER_ROW * n_rest + c));
      for (int k = 0; k < 3; k++) px[k] = (uint8_t)(SOG_CODES / 2 + sog_model_sh(&s->m, j, 3 * c + k));
    }
  return add_image(s, "shN_centroids.webp", width, rows, err);
}

static sv_status add_means(sog *s, sv_str *t, sv_err *err) {
  float as_float[2][3];
  for (int k = 0; k < 3; k++) {
    as_float[0][k] = (float)s->m.lo[k];
    as_float[1][k] = (float)s->m.hi[k];
  }
  sv_str_add(t, "\"means\":{");
  add_numbers(t, "mins", as_float[0], 3);
  sv_str_add(t, ",");
  add_numbers(t, "maxs", as_float[1], 3);
  sv_str_add(t, ",\"files\":[\"means_l.webp\",\"means_u.webp\"]},\n");
  const sv_status r = add_pixels(s, "means_l.webp", put_low, err);
  return r == SV_OK ? add_pixels(s, "means_u.webp", put_high, err) : r;
}

static sv_status add_scales(sog *s, sv_str *t, sv_err *err) {
  sv_str_add(t, "\"scales\":{");
  add_codebook(t, &s->m.scale);
  sv_str_add(t, ",\"files\":[\"scales.webp\"]},\n");
  return add_pixels(s, "scales.webp", put_scale, err);
}

static sv_status add_quats(sog *s, sv_str *t, sv_err *err) {
  sv_str_add(t, "\"quats\":{\"files\":[\"quats.webp\"]},\n");
  return add_pixels(s, "quats.webp", put_quat, err);
}

static sv_status add_sh(sog *s, sv_str *t, sv_err *err) {
  const int n_rest = s->m.n_rest, degree = n_rest == 3 ? 1 : n_rest == 8 ? 2 : 3;
  const sog_palette *p = &s->m.palette;
  const sog_codebook c = {-SOG_CODES / 2 * p->step, p->step};
  sv_str_add(t, "\"shN\":{\"count\":%d,\"bands\":%d,", p->n, degree);
  add_codebook(t, &c);
  sv_str_add(t, ",\"files\":[\"shN_centroids.webp\",\"shN_labels.webp\"]},\n");
  const sv_status r = add_palette(s, err);
  return r == SV_OK ? add_pixels(s, "shN_labels.webp", put_label, err) : r;
}

static sv_status add_colors(sog *s, sv_str *t, sv_err *err) {
  sv_str_add(t, "\"sh0\":{");
  add_codebook(t, &s->m.color);
  sv_str_add(t, ",\"files\":[\"sh0.webp\"]}\n");
  return add_pixels(s, "sh0.webp", put_color, err);
}

// --- the file ------------------------------------------------------------------------------------

static sv_status make(sog *s, const sv_model_notes *notes, sv_err *err) {
  sv_str t = sv_str_make(s->meta, sizeof s->meta);
  sv_str_add(&t, "{\"version\":2,\"asset\":{\"generator\":\"subview %s\"", LAB_VERSION);
  if (notes->unit.is_metric) sv_str_add(&t, ",\"unit\":\"m\"");
  if (notes->unit.scale_sigma > 0) sv_str_add(&t, ",\"scale_sigma\":%.3g", (double)notes->unit.scale_sigma);
  sv_str_add(&t, "},\"count\":%d,\"antialias\":%s,\n", s->m.n, notes->is_mip ? "true" : "false");
  sv_status r = add_means(s, &t, err);
  if (r == SV_OK) r = add_scales(s, &t, err);
  if (r == SV_OK) r = add_quats(s, &t, err);
  if (r == SV_OK && s->m.n_rest) r = add_sh(s, &t, err);
  if (r == SV_OK) r = add_colors(s, &t, err);
  sv_str_add(&t, "}\n");
  if (r == SV_OK && t.is_cut) r = sv_fail(err, SV_E_RANGE, "meta.json does not fit into %d bytes", CAP_META);
  return r;
}

static sv_status write(const sog *s, const char *path, sv_err *err) {
  char folder[SV_CAP_PATH], name[SV_CAP_PATH];
  const size_t bytes = strlen(s->meta);
  if (!sv_str_eq(sv_path_name(path), "meta.json")) {
    lab_zip_entry all[MAX_FILES + 1] = {{"meta.json", (const uint8_t *)s->meta, bytes}};
    memcpy(all + 1, s->file, (size_t)s->n_files * sizeof *all);
    return lab_zip_write(path, all, s->n_files + 1, err);
  }
  sv_status r = SV_OK;
  sv_path_folder(folder, sizeof folder, path);
  for (int i = 0; i < s->n_files && r == SV_OK; i++) {
    r = sv_path_join(name, sizeof name, folder, s->file[i].name, err);
    if (r == SV_OK) r = sv_file_write(name, s->file[i].data, s->file[i].bytes, err);
  }
  return r == SV_OK ? sv_file_write(path, s->meta, bytes, err) : r;
}

sv_status lab_write_sog(const sv_gaussians *g, const sv_model_notes *notes, const lab_seen *seen,
                        sog_judge *judge, const char *path, sv_err *err) {
  sog *s = calloc(1, sizeof *s);
  if (!s) return sv_fail(err, SV_E_NOMEM, "%s: no memory", path);
  s->width = 4 * (int)ceil(sqrt((double)g->n) / 4);
  s->height = 4 * ((g->n + 4 * s->width - 1) / (4 * s->width));
  sv_status r = sog_judge_start(judge, g, err);
  if (r == SV_OK) r = sog_model_start(&s->m, g, seen, judge, err);
  const size_t n_px = (size_t)s->width * (size_t)s->height,
               n_palette = (size_t)((s->m.palette.n + SETS_PER_ROW) * s->m.n_rest);
  s->rgba = malloc(4 * (n_px > n_palette ? n_px : n_palette));
  if (r == SV_OK && !s->rgba) r = sv_fail(err, SV_E_NOMEM, "%s: no memory for %d Gaussians", path, g->n);
  if (r == SV_OK) r = make(s, notes, err);
  if (r == SV_OK) r = write(s, path, err);
  for (int i = 0; i < s->n_files; i++) WebPFree((void *)(uintptr_t)s->file[i].data);
  sog_judge_stop(judge);
  sog_model_stop(&s->m);
  free(s->rgba);
  free(s);
  return r;
}
#else
sv_status lab_write_sog(const sv_gaussians *g, const sv_model_notes *notes, const lab_seen *seen,
                        sog_judge *judge, const char *path, sv_err *err) {
  (void)g;
  (void)notes;
  (void)seen;
  (void)judge;
  return sv_fail(err, SV_E_UNSUPPORTED,
                 "%s: this build has no libwebp, which SOG needs (Debian: libwebp-dev)", path);
}
#endif
