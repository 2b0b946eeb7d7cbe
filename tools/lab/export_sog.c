// SPDX-License-Identifier: Apache-2.0
#include "tools/lab/export_sog.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/str.h"
#include "tools/lab/curve.h"
#include "tools/lab/kmeans.h"
#include "tools/lab/zip.h"

#if defined(__has_include) && __has_include(<webp/encode.h>) && __has_include(<webp/mux.h>)
#include <webp/encode.h>

#define N_CODES      256
#define ROUNDS       12 // of k-means
#define MAX_PALETTE  4096
#define PER_SET      6  // Gaussians for one set of the palette, at least
#define SETS_PER_ROW 64 // of the image of the palette
#define LEVEL        6  // effort of the lossless WebP, 0 to 9
#define CAP_META     16384
#define MAX_FILES    8

typedef struct {
  const sv_pool *pool;
  sv_gaussian *v; // [n] along a space-filling curve
  int n, width, height;
  int n_rest;    // SH coefficients after the first: 0, 3, 8, 15
  uint8_t *rgba; // [height][width][4] of the image being made
  char meta[CAP_META];
  lab_zip_entry file[MAX_FILES];
  int n_files;
} sog;

// --- images --------------------------------------------------------------------------------------

static uint8_t byte_of(double x) { return (uint8_t)fmin(fmax(floor(x + 0.5), 0), 255); }

// Lossless, colors under transparent pixels included.
static sv_status add_image(sog *s, const char *name, int width, int height, sv_err *err) {
  WebPConfig config;
  WebPPicture p;
  WebPMemoryWriter out;
  if (!WebPConfigInit(&config) || !WebPConfigLosslessPreset(&config, LEVEL) || !WebPPictureInit(&p))
    return sv_fail(err, SV_E_NOMEM, "%s: libwebp does not start", name);
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
    return sv_fail(err, SV_E_RANGE, "%s: libwebp could not encode %dx%d pixels", name, width, height);
  }
  s->file[s->n_files++] = (lab_zip_entry){name, out.mem, out.size};
  return SV_OK;
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

static sv_status add_means(sog *s, sv_str *t, sv_err *err) {
  double lo[3], hi[3];
  float as_float[2][3];
  sv_status r = SV_OK;
  lab_curve_ranges(s->v, s->n, lo, hi);
  for (int k = 0; k < 3; k++) {
    as_float[0][k] = (float)lo[k];
    as_float[1][k] = (float)hi[k];
  }
  for (int part = 0; part < 2 && r == SV_OK; part++) {
    clear(s, (size_t)s->width * (size_t)s->height);
    for (int i = 0; i < s->n; i++)
      for (int k = 0; k < 3; k++) {
        const double x = (double)lab_curve_log(s->v[i].mean[k]),
                     u = hi[k] > lo[k] ? (x - lo[k]) / (hi[k] - lo[k]) : 0;
        s->rgba[4 * i + k] = (uint8_t)((unsigned)(u * 65535.0 + 0.5) >> (8 * part));
      }
    r = add_image(s, part ? "means_u.webp" : "means_l.webp", s->width, s->height, err);
  }
  sv_str_add(t, "\"means\":{");
  add_numbers(t, "mins", as_float[0], 3);
  sv_str_add(t, ",");
  add_numbers(t, "maxs", as_float[1], 3);
  sv_str_add(t, ",\"files\":[\"means_l.webp\",\"means_u.webp\"]},\n");
  return r;
}

static sv_status add_quats(sog *s, sv_str *t, sv_err *err) {
  clear(s, (size_t)s->width * (size_t)s->height);
  for (int i = 0; i < s->n; i++) {
    const float *q = s->v[i].quat_wxyz;
    const double norm = sqrt((double)(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]));
    int largest = 0;
    for (int k = 1; k < 4; k++)
      if (fabsf(q[k]) > fabsf(q[largest])) largest = k;
    const double scale = (q[largest] < 0 ? -1 : 1) * sqrt(2.0) / (norm > 0 ? norm : 1);
    for (int k = 0, to = 0; k < 4; k++)
      if (k != largest) s->rgba[4 * i + to++] = byte_of(((double)q[k] * scale * 0.5 + 0.5) * 255.0);
    s->rgba[4 * i + 3] = (uint8_t)(252 + largest);
  }
  sv_str_add(t, "\"quats\":{\"files\":[\"quats.webp\"]},\n");
  return add_image(s, "quats.webp", s->width, s->height, err);
}

// Three values of each Gaussian by their places in a codebook. all: [3 n] room.
typedef struct {
  const char *key, *file;
  float (*value)(const sv_gaussian *g, int k);
  bool has_opacity;
} coded_row;

static float scale_of(const sv_gaussian *g, int k) { return g->log_scale[k]; }
static float color_of(const sv_gaussian *g, int k) { return g->sh[0][k]; }

static sv_status add_coded(sog *s, const coded_row *row, float *all, sv_str *t, sv_err *err) {
  float code[N_CODES];
  for (int i = 0; i < s->n; i++)
    for (int k = 0; k < 3; k++) all[3 * i + k] = row->value(&s->v[i], k);
  if (!lab_codebook(all, 3 * (size_t)s->n, code, N_CODES, ROUNDS))
    return sv_fail(err, SV_E_NOMEM, "%s: no memory", row->file);
  clear(s, (size_t)s->width * (size_t)s->height);
  for (int i = 0; i < s->n; i++) {
    for (int k = 0; k < 3; k++)
      s->rgba[4 * i + k] = (uint8_t)lab_nearest_code(code, N_CODES, row->value(&s->v[i], k));
    if (row->has_opacity) s->rgba[4 * i + 3] = byte_of(255.0 / (1.0 + exp(-(double)s->v[i].opacity_logit)));
  }
  sv_str_add(t, "\"%s\":{", row->key);
  add_numbers(t, "codebook", code, N_CODES);
  sv_str_add(t, ",\"files\":[\"%s\"]}%s\n", row->file, row->has_opacity && !s->n_rest ? "" : ",");
  return add_image(s, row->file, s->width, s->height, err);
}

// --- SH ------------------------------------------------------------------------------------------

// Pixels of the palette: set j, coefficient c at column (j % 64) C + c, row j / 64.
static void put_palette(sog *s, const float *set, int n_sets, const float *code) {
  const int width = SETS_PER_ROW * s->n_rest, dims = 3 * s->n_rest;
  for (int j = 0; j < n_sets; j++)
    for (int c = 0; c < s->n_rest; c++) {
      uint8_t *px = s->rgba + 4 * ((size_t)(j / SETS_PER_ROW) * (size_t)width +
                                   (size_t)(j % SETS_PER_ROW * s->n_rest + c));
      for (int k = 0; k < 3; k++)
        px[k] = (uint8_t)lab_nearest_code(code, N_CODES, set[(size_t)j * (size_t)dims + (size_t)(3 * c + k)]);
    }
}

// About how much of a picture it colors: opacity by area.
static float visibility(const sv_gaussian *g) {
  const float *l = g->log_scale, least = fminf(l[0], fminf(l[1], l[2]));
  return expf(l[0] + l[1] + l[2] - least) / (1.0f + expf(-g->opacity_logit)) + 1e-12f;
}

static sv_status add_sh(sog *s, float *all, sv_str *t, sv_err *err) {
  const int dims = 3 * s->n_rest, degree = s->n_rest == 3 ? 1 : s->n_rest == 8 ? 2 : 3;
  int n_sets = s->n / PER_SET;
  n_sets = n_sets < SETS_PER_ROW ? SETS_PER_ROW : n_sets > MAX_PALETTE ? MAX_PALETTE : n_sets;
  if (n_sets > s->n) n_sets = s->n;
  const int rows = (n_sets + SETS_PER_ROW - 1) / SETS_PER_ROW, width = SETS_PER_ROW * s->n_rest;
  float code[N_CODES], *set = malloc((size_t)n_sets * (size_t)dims * sizeof *set);
  int *label = malloc((size_t)s->n * sizeof *label);
  float *weight = malloc((size_t)s->n * sizeof *weight);
  for (int i = 0; i < s->n; i++)
    memcpy(all + (size_t)i * (size_t)dims, s->v[i].sh[1], (size_t)dims * sizeof *all);
  for (int i = 0; weight && i < s->n; i++) weight[i] = visibility(&s->v[i]);
  const lab_points points = {all, weight, s->n, dims, s->pool};
  sv_status r = SV_OK;
  if (!set || !label || !weight || !lab_palette(&points, set, n_sets, label, ROUNDS) ||
      !lab_codebook(set, (size_t)n_sets * (size_t)dims, code, N_CODES, ROUNDS))
    r = sv_fail(err, SV_E_NOMEM, "no memory for the SH of %d Gaussians", s->n);
  if (r == SV_OK) {
    clear(s, (size_t)rows * (size_t)width);
    put_palette(s, set, n_sets, code);
    r = add_image(s, "shN_centroids.webp", width, rows, err);
  }
  if (r == SV_OK) {
    clear(s, (size_t)s->width * (size_t)s->height);
    for (int i = 0; i < s->n; i++) {
      s->rgba[4 * i] = (uint8_t)(label[i] & 255);
      s->rgba[4 * i + 1] = (uint8_t)(label[i] >> 8);
    }
    sv_str_add(t, "\"shN\":{\"count\":%d,\"bands\":%d,", n_sets, degree);
    add_numbers(t, "codebook", code, N_CODES);
    sv_str_add(t, ",\"files\":[\"shN_centroids.webp\",\"shN_labels.webp\"]}\n");
    r = add_image(s, "shN_labels.webp", s->width, s->height, err);
  }
  free(set);
  free(label);
  free(weight);
  return r;
}

// --- the file ------------------------------------------------------------------------------------

static sv_status make(sog *s, const sv_model_notes *notes, float *all, sv_err *err) {
  static const coded_row scales = {"scales", "scales.webp", scale_of, false},
                         colors = {"sh0", "sh0.webp", color_of, true};
  sv_str t = sv_str_make(s->meta, sizeof s->meta);
  sv_str_add(&t, "{\"version\":2,\"asset\":{\"generator\":\"subview %s\"", LAB_VERSION);
  if (notes->unit.is_metric) sv_str_add(&t, ",\"unit\":\"m\"");
  if (notes->unit.scale_sigma > 0) sv_str_add(&t, ",\"scale_sigma\":%.3g", (double)notes->unit.scale_sigma);
  sv_str_add(&t, "},\"count\":%d,\"antialias\":%s,\n", s->n, notes->is_mip ? "true" : "false");
  sv_status r = add_means(s, &t, err);
  if (r == SV_OK) r = add_coded(s, &scales, all, &t, err);
  if (r == SV_OK) r = add_quats(s, &t, err);
  if (r == SV_OK) r = add_coded(s, &colors, all, &t, err);
  if (r == SV_OK && s->n_rest) r = add_sh(s, all, &t, err);
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

sv_status lab_write_sog(const sv_gaussians *g, const sv_model_notes *notes, const sv_pool *pool,
                        const char *path, sv_err *err) {
  static const int rest[] = {0, 3, 8, 15};
  sog *s = calloc(1, sizeof *s);
  if (!s) return sv_fail(err, SV_E_NOMEM, "%s: no memory", path);
  s->pool = pool;
  s->n = g->n;
  s->n_rest = rest[g->sh_degree];
  s->width = 4 * (int)ceil(sqrt((double)s->n) / 4);
  s->height = 4 * ((s->n + 4 * s->width - 1) / (4 * s->width));
  const size_t n_px = (size_t)s->width * (size_t)s->height,
               n_palette = (size_t)(MAX_PALETTE * (s->n_rest + 1));
  s->v = lab_curve_order(g);
  s->rgba = malloc(4 * (n_px > n_palette ? n_px : n_palette));
  float *all = malloc((size_t)s->n * (size_t)(s->n_rest ? 3 * s->n_rest : 3) * sizeof *all);
  sv_status r =
      s->v && s->rgba && all ? SV_OK : sv_fail(err, SV_E_NOMEM, "%s: no memory for %d Gaussians", path, s->n);
  if (r == SV_OK) r = make(s, notes, all, err);
  if (r == SV_OK) r = write(s, path, err);
  for (int i = 0; i < s->n_files; i++) WebPFree((void *)(uintptr_t)s->file[i].data);
  free(all);
  free(s->rgba);
  free(s->v);
  free(s);
  return r;
}
#else
sv_status lab_write_sog(const sv_gaussians *g, const sv_model_notes *notes, const sv_pool *pool,
                        const char *path, sv_err *err) {
  (void)g;
  (void)notes;
  (void)pool;
  return sv_fail(err, SV_E_UNSUPPORTED,
                 "%s: this build has no libwebp, which SOG needs (Debian: libwebp-dev)", path);
}
#endif
