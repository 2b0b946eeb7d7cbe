// SPDX-License-Identifier: Apache-2.0
#include "tools/lab/export_sog.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/str.h"
#include "src/base/vec.h"
#include "src/format/axes.h"
#include "tools/lab/curve.h"
#include "tools/lab/kmeans.h"
#include "tools/lab/zip.h"

#if defined(__has_include) && __has_include(<webp/encode.h>) && __has_include(<webp/mux.h>)
#include <webp/encode.h>

#define N_CODES      256
#define ROUNDS       6 // of k-means
#define MAX_PALETTE  8192
#define PER_SET      2  // Gaussians for one set of the palette, at least
#define SETS_PER_ROW 64 // of the image of the palette
#define LEVEL        6  // effort of the lossless WebP, 0 to 9
#define CAP_META     16384
#define MAX_FILES    8

// Steps are even, so that WebP finds what neighbors and channels have in common.
#define SCALE_STEP    0.0625
#define COLOR_STEP    0.03125
#define QUAT_STEP     2           // of 255
#define POSITION_STEP 0.25        // of the smallest standard deviation, at most
#define SH_STEP       (1 / 128.0) // the finest; coarser ones are 2^(1/4) apart
#define N_SH_STEPS    17
#define SH_ROUNDING   0.45 // a little towards 0, which costs the fewest bits
// Of a Gaussian, at most. Without views the other images are smaller.
#define PALETTE_BYTES(has_views) ((has_views) ? 4.0 : 4.5)

#define MAX_LEVEL    3
#define LEVEL_UNSEEN 1
#define FINEST       0.75 // quantile of the weights from whose half on steps are the finest

#define SH_C0 0.28209479177387814

typedef struct {
  const sv_pool *pool;
  sv_gaussian *v;       // [n] by level, and then along a space-filling curve
  int *index;           // [n] of these in the model
  float *weight;        // [n] how much of the pictures they color, about
  int *level;           // [n] their steps are 2^level times the finest
  const lab_seen *seen; // or NULL
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

// A codebook of even steps.
typedef struct {
  double first, step;
} coding;

// The nearest code that is a multiple of 2^level.
static uint8_t code_of(const coding *c, double x, int level) {
  const double u = (x - c->first) / c->step;
  const int last = N_CODES - (1 << level);
  return (uint8_t)(fmin(fmax(floor(u / (1 << level) + 0.5), 0), last >> level)) << level;
}

static void add_codebook(sv_str *t, const coding *c) {
  float code[N_CODES];
  for (int j = 0; j < N_CODES; j++) code[j] = (float)(c->first + j * c->step);
  add_numbers(t, "codebook", code, N_CODES);
}

// --- Gaussians -----------------------------------------------------------------------------------

// Without views: opacity by area.
static float visibility(const sog *s, int i) {
  const sv_gaussian *g = &s->v[i];
  float sum = 0;
  for (int v = 0; s->seen && v < s->seen->n_views; v++)
    sum += s->seen->weight[(size_t)v * (size_t)s->n + (size_t)s->index[i]];
  if (s->seen) return sum + 1e-12f;
  const float *l = g->log_scale, least = fminf(l[0], fminf(l[1], l[2]));
  return expf(l[0] + l[1] + l[2] - least) / (1.0f + expf(-g->opacity_logit)) + 1e-12f;
}

static int by_size(const void *a, const void *b) {
  const float x = *(const float *)a, y = *(const float *)b;
  return (x > y) - (x < y);
}

// [n] levels, malloc'ed. The least total error for a number of bits has steps that are inverse to
// the square roots of the weights. Weights without views are too rough for that.
static int *levels_of(const sog *s, const float *weight, int n) {
  float *sorted = malloc((size_t)n * sizeof *sorted);
  int *level = calloc((size_t)n, sizeof *level);
  if (sorted && level) {
    memcpy(sorted, weight, (size_t)n * sizeof *sorted);
    qsort(sorted, (size_t)n, sizeof *sorted, by_size);
    const float at = sorted[(size_t)(FINEST * (n - 1))];
    for (int i = 0; i < n; i++) {
      if (!s->seen) level[i] = LEVEL_UNSEEN;
      else
        while (level[i] < MAX_LEVEL && weight[i] * (float)(2 << 2 * level[i]) < at) level[i]++;
    }
  }
  free(sorted);
  return level;
}

static sv_status weigh(sog *s, sv_err *err) {
  s->weight = malloc((size_t)s->n * sizeof *s->weight);
  for (int i = 0; s->weight && i < s->n; i++) s->weight[i] = visibility(s, i);
  s->level = s->weight ? levels_of(s, s->weight, s->n) : NULL;
  return s->level ? SV_OK : sv_fail(err, SV_E_NOMEM, "no memory for %d Gaussians", s->n);
}

// Gaussians of a level side by side, where WebP finds that they have few values.
static sv_status group(sog *s, sv_err *err) {
  const size_t n = (size_t)s->n;
  sog old = *s;
  s->v = malloc(n * sizeof *s->v);
  s->index = malloc(n * sizeof *s->index);
  s->weight = malloc(n * sizeof *s->weight);
  s->level = malloc(n * sizeof *s->level);
  const bool is_good = s->v && s->index && s->weight && s->level;
  for (int l = 0, k = 0; is_good && l <= MAX_LEVEL; l++)
    for (int i = 0; i < s->n; i++) {
      if (old.level[i] != l) continue;
      s->v[k] = old.v[i];
      s->index[k] = old.index[i];
      s->weight[k] = old.weight[i];
      s->level[k++] = old.level[i];
    }
  free(old.v);
  free(old.index);
  free(old.weight);
  free(old.level);
  return is_good ? SV_OK : sv_fail(err, SV_E_NOMEM, "no memory for %d Gaussians", s->n);
}

// How many of the 16 bits of its position a Gaussian does not need. unit: of an axis's bit, in
// sign(x) ln(1 + |x|).
static int spare_bits(const sv_gaussian *g, int level, const double unit[3]) {
  const float *l = g->log_scale;
  const double enough = POSITION_STEP * (1 << level) * exp((double)fminf(l[0], fminf(l[1], l[2])));
  double step = 0;
  for (int k = 0; k < 3; k++) step = fmax(step, unit[k] * (1 + fabs((double)g->mean[k])));
  int bits = 0;
  while (bits < 8 && step * (2 << bits) <= enough) bits++;
  return bits;
}

static sv_status add_means(sog *s, sv_str *t, sv_err *err) {
  double lo[3], hi[3], unit[3];
  float as_float[2][3];
  sv_status r = SV_OK;
  lab_curve_ranges(s->v, s->n, lo, hi);
  for (int k = 0; k < 3; k++) {
    as_float[0][k] = (float)lo[k];
    as_float[1][k] = (float)hi[k];
    unit[k] = (hi[k] - lo[k]) / 65535.0;
  }
  for (int part = 0; part < 2 && r == SV_OK; part++) {
    clear(s, (size_t)s->width * (size_t)s->height);
    for (int i = 0; i < s->n; i++) {
      const int bits = spare_bits(&s->v[i], s->level[i], unit);
      for (int k = 0; k < 3; k++) {
        const double x = (double)lab_curve_log(s->v[i].mean[k]), u = unit[k] > 0 ? (x - lo[k]) / unit[k] : 0;
        const unsigned rounded = (unsigned)(u / (1 << bits) + 0.5) << bits,
                       q = rounded < 65535 ? rounded : 65535;
        s->rgba[4 * i + k] = (uint8_t)(q >> (8 * part));
      }
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

// Of the 24 orders and signs of its axes that describe the same Gaussian, the one nearest to no
// rotation: its quaternion has the fewest values.
static void choose_axes(sv_gaussian *g) {
  static const uint8_t order[6][3] = {{0, 1, 2}, {1, 2, 0}, {2, 0, 1}, {0, 2, 1}, {2, 1, 0}, {1, 0, 2}};
  double m[9], r[9], q[4], best = -INFINITY, sign[3] = {1, 1, 1};
  for (int k = 0; k < 4; k++) q[k] = (double)g->quat_wxyz[k];
  sv_quat_to_mat(m, q);
  const uint8_t *axis = order[0];
  for (int j = 0; j < 6; j++) {
    int weakest = 0;
    double trace = 0, hand = j < 3 ? 1 : -1, d[3];
    for (int k = 0; k < 3; k++) {
      d[k] = m[3 * k + order[j][k]];
      trace += fabs(d[k]);
      hand *= d[k] < 0 ? -1 : 1;
      if (fabs(d[k]) < fabs(d[weakest])) weakest = k;
    }
    if (hand < 0) trace -= 2 * fabs(d[weakest]);
    if (trace <= best) continue;
    best = trace;
    axis = order[j];
    for (int k = 0; k < 3; k++) sign[k] = (d[k] < 0) == (hand < 0 && k == weakest) ? 1 : -1;
  }
  float log_scale[3];
  for (int k = 0; k < 3; k++) {
    for (int row = 0; row < 3; row++) r[3 * row + k] = sign[k] * m[3 * row + axis[k]];
    log_scale[k] = g->log_scale[axis[k]];
  }
  sv_quat_from_mat(q, r);
  memcpy(g->log_scale, log_scale, sizeof log_scale);
  for (int k = 0; k < 4; k++) g->quat_wxyz[k] = (float)(q[0] < 0 ? -q[k] : q[k]);
}

// w is the largest component of all (choose_axes).
static sv_status add_quats(sog *s, sv_str *t, sv_err *err) {
  clear(s, (size_t)s->width * (size_t)s->height);
  for (int i = 0; i < s->n; i++) {
    for (int k = 0; k < 3; k++) {
      const double u = (double)s->v[i].quat_wxyz[1 + k] * sqrt(0.5) * 255.0;
      const double step = QUAT_STEP * (1 << s->level[i]);
      s->rgba[4 * i + k] = byte_of(128 + step * floor(u / step + 0.5));
    }
    s->rgba[4 * i + 3] = 252;
  }
  sv_str_add(t, "\"quats\":{\"files\":[\"quats.webp\"]},\n");
  return add_image(s, "quats.webp", s->width, s->height, err);
}

static sv_status add_scales(sog *s, sv_str *t, sv_err *err) {
  double hi = -INFINITY;
  for (int i = 0; i < s->n; i++)
    for (int k = 0; k < 3; k++) hi = fmax(hi, (double)s->v[i].log_scale[k]);
  const coding c = {(ceil(hi / SCALE_STEP) - (N_CODES - 1)) * SCALE_STEP, SCALE_STEP};
  clear(s, (size_t)s->width * (size_t)s->height);
  for (int i = 0; i < s->n; i++)
    for (int k = 0; k < 3; k++) s->rgba[4 * i + k] = code_of(&c, (double)s->v[i].log_scale[k], s->level[i]);
  sv_str_add(t, "\"scales\":{");
  add_codebook(t, &c);
  sv_str_add(t, ",\"files\":[\"scales.webp\"]},\n");
  return add_image(s, "scales.webp", s->width, s->height, err);
}

static sv_status add_colors(sog *s, sv_str *t, sv_err *err) {
  double most = 0, step = COLOR_STEP;
  for (int i = 0; i < s->n; i++)
    for (int k = 0; k < 3; k++) most = fmax(most, fabs((double)s->v[i].sh[0][k]));
  while (step * (N_CODES / 2 - 1) < most) step *= 2;
  const coding c = {-N_CODES / 2 * step, step};
  clear(s, (size_t)s->width * (size_t)s->height);
  for (int i = 0; i < s->n; i++) {
    for (int k = 0; k < 3; k++) s->rgba[4 * i + k] = code_of(&c, (double)s->v[i].sh[0][k], s->level[i]);
    s->rgba[4 * i + 3] = byte_of(255.0 / (1.0 + exp(-(double)s->v[i].opacity_logit)));
  }
  sv_str_add(t, "\"sh0\":{");
  add_codebook(t, &c);
  sv_str_add(t, ",\"files\":[\"sh0.webp\"]}\n");
  return add_image(s, "sh0.webp", s->width, s->height, err);
}

// --- SH ------------------------------------------------------------------------------------------

// The sets of SH coefficients that Gaussians share.
typedef struct {
  float *set; // [n][3 n_rest]
  int *level; // [n] as that of Gaussians, by the sum of their weights
  int n, width, rows;
  coding c;
} palette;

// Coefficient c of set j in steps of the palette.
static int rounded(const palette *p, int j, int c, int dims) {
  const double x = (double)p->set[(size_t)j * (size_t)dims + (size_t)c],
               step = p->c.step * (1 << p->level[j]);
  const double size = fmin(floor(fabs(x) / step + SH_ROUNDING), (N_CODES / 2 >> p->level[j]) - 1);
  return (int)copysign(size, x) * (1 << p->level[j]);
}

// Pixels of the palette: set j, coefficient c at column (j % 64) C + c, row j / 64.
static void put_palette(sog *s, const palette *p) {
  const int dims = 3 * s->n_rest;
  clear(s, (size_t)p->rows * (size_t)p->width);
  for (int j = 0; j < p->n; j++)
    for (int c = 0; c < s->n_rest; c++) {
      uint8_t *px = s->rgba + 4 * ((size_t)(j / SETS_PER_ROW) * (size_t)p->width +
                                   (size_t)(j % SETS_PER_ROW * s->n_rest + c));
      for (int k = 0; k < 3; k++) px[k] = (uint8_t)(N_CODES / 2 + rounded(p, j, 3 * c + k, dims));
    }
}

// The finest step with which the image of the palette has at most PALETTE_BYTES for each Gaussian.
static sv_status add_palette(sog *s, palette *p, sv_err *err) {
  lab_zip_entry image = {.name = "shN_centroids.webp"};
  sv_status r = SV_OK;
  for (int lo = 0, hi = N_SH_STEPS - 1, i = 0; r == SV_OK;) {
    WebPFree((void *)(uintptr_t)image.data);
    image.data = NULL;
    p->c.step = SH_STEP * pow(2, i / 4.0);
    p->c.first = -N_CODES / 2 * p->c.step;
    put_palette(s, p);
    r = encode(s, p->width, p->rows, &image, err);
    if (r != SV_OK || lo == hi) break;
    if ((double)image.bytes <= PALETTE_BYTES(s->seen) * s->n) hi = i;
    else lo = i + 1;
    if (hi == i && lo == hi) break;
    i = (lo + hi) / 2;
  }
  if (r == SV_OK) s->file[s->n_files++] = image;
  return r;
}

// The first coefficient takes the mean of what the palette changes in the colors that views see.
static void refit_color(sog *s, int i, const palette *p, int label) {
  const int n = s->n_rest;
  double sum[3] = {0}, total = 0, change[3][15];
  for (int c = 0; c < n; c++)
    for (int k = 0; k < 3; k++)
      change[k][c] = (double)s->v[i].sh[1 + c][k] - p->c.step * rounded(p, label, 3 * c + k, 3 * n);
  for (int v = 0; v < s->seen->n_views; v++) {
    const double w = (double)s->seen->weight[(size_t)v * (size_t)s->n + (size_t)s->index[i]];
    double d[3], y[15];
    for (int k = 0; k < 3; k++) d[k] = (double)s->v[i].mean[k] - s->seen->eye[v][k];
    const double length = sv_norm3(d);
    if (!(w > 0 && length > 0)) continue;
    for (int k = 0; k < 3; k++) d[k] /= length;
    sv_sh_basis(y, d);
    for (int k = 0; k < 3; k++)
      for (int c = 0; c < n; c++) sum[k] += w * change[k][c] * y[c];
    total += w;
  }
  for (int k = 0; total > 0 && k < 3; k++) s->v[i].sh[0][k] += (float)(sum[k] / total / SH_C0);
}

static sv_status level_sets(const sog *s, palette *p, const int *label, sv_err *err) {
  float *weight = calloc((size_t)p->n, sizeof *weight);
  for (int i = 0; weight && i < s->n; i++) weight[label[i]] += s->weight[i];
  p->level = weight ? levels_of(s, weight, p->n) : NULL;
  free(weight);
  return p->level ? SV_OK : sv_fail(err, SV_E_NOMEM, "no memory for %d sets of SH", p->n);
}

static sv_status add_sh(sog *s, sv_str *t, sv_err *err) {
  const int dims = 3 * s->n_rest, degree = s->n_rest == 3 ? 1 : s->n_rest == 8 ? 2 : 3;
  const size_t n = (size_t)s->n;
  int n_sets = s->n / PER_SET;
  n_sets = n_sets < SETS_PER_ROW ? SETS_PER_ROW : n_sets > MAX_PALETTE ? MAX_PALETTE : n_sets;
  if (n_sets > s->n) n_sets = s->n;
  palette p = {.n = n_sets,
               .width = SETS_PER_ROW * s->n_rest,
               .rows = (n_sets + SETS_PER_ROW - 1) / SETS_PER_ROW,
               .set = malloc((size_t)n_sets * (size_t)dims * sizeof *p.set)};
  int *label = malloc(n * sizeof *label);
  float *all = malloc(n * (size_t)dims * sizeof *all);
  sv_status r = SV_OK;
  for (size_t i = 0; all && i < n; i++)
    memcpy(all + i * (size_t)dims, s->v[i].sh[1], (size_t)dims * sizeof *all);
  const lab_points points = {all, s->weight, s->n, dims, s->pool};
  if (!p.set || !label || !all || !lab_palette(&points, p.set, n_sets, label, ROUNDS))
    r = sv_fail(err, SV_E_NOMEM, "no memory for the SH of %d Gaussians", s->n);
  if (r == SV_OK) r = level_sets(s, &p, label, err);
  if (r == SV_OK) r = add_palette(s, &p, err);
  if (r == SV_OK) {
    clear(s, (size_t)s->width * (size_t)s->height);
    for (int i = 0; i < s->n; i++) {
      s->rgba[4 * i] = (uint8_t)(label[i] & 255);
      s->rgba[4 * i + 1] = (uint8_t)(label[i] >> 8);
    }
    sv_str_add(t, "\"shN\":{\"count\":%d,\"bands\":%d,", n_sets, degree);
    add_codebook(t, &p.c);
    sv_str_add(t, ",\"files\":[\"shN_centroids.webp\",\"shN_labels.webp\"]},\n");
    r = add_image(s, "shN_labels.webp", s->width, s->height, err);
    for (int i = 0; s->seen && i < s->n; i++) refit_color(s, i, &p, label[i]);
  }
  free(p.set);
  free(p.level);
  free(label);
  free(all);
  return r;
}

// --- the file ------------------------------------------------------------------------------------

static sv_status make(sog *s, const sv_model_notes *notes, sv_err *err) {
  sv_str t = sv_str_make(s->meta, sizeof s->meta);
  sv_str_add(&t, "{\"version\":2,\"asset\":{\"generator\":\"subview %s\"", LAB_VERSION);
  if (notes->unit.is_metric) sv_str_add(&t, ",\"unit\":\"m\"");
  if (notes->unit.scale_sigma > 0) sv_str_add(&t, ",\"scale_sigma\":%.3g", (double)notes->unit.scale_sigma);
  sv_str_add(&t, "},\"count\":%d,\"antialias\":%s,\n", s->n, notes->is_mip ? "true" : "false");
  sv_status r = add_means(s, &t, err);
  if (r == SV_OK) r = add_scales(s, &t, err);
  if (r == SV_OK) r = add_quats(s, &t, err);
  if (r == SV_OK && s->n_rest) r = add_sh(s, &t, err);
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
                        const sv_pool *pool, const char *path, sv_err *err) {
  static const int rest[] = {0, 3, 8, 15};
  sog *s = calloc(1, sizeof *s);
  if (!s) return sv_fail(err, SV_E_NOMEM, "%s: no memory", path);
  s->pool = pool;
  s->seen = seen;
  s->n = g->n;
  s->n_rest = rest[g->sh_degree];
  s->width = 4 * (int)ceil(sqrt((double)s->n) / 4);
  s->height = 4 * ((s->n + 4 * s->width - 1) / (4 * s->width));
  const size_t n_px = (size_t)s->width * (size_t)s->height,
               n_palette = (size_t)(MAX_PALETTE * (s->n_rest + 1));
  s->index = malloc((size_t)s->n * sizeof *s->index);
  s->v = s->index ? lab_curve_order(g, s->index) : NULL;
  s->rgba = malloc(4 * (n_px > n_palette ? n_px : n_palette));
  sv_status r =
      s->v && s->rgba ? SV_OK : sv_fail(err, SV_E_NOMEM, "%s: no memory for %d Gaussians", path, s->n);
  for (int i = 0; r == SV_OK && i < s->n; i++) choose_axes(&s->v[i]);
  if (r == SV_OK) r = weigh(s, err);
  if (r == SV_OK) r = group(s, err);
  if (r == SV_OK) r = make(s, notes, err);
  if (r == SV_OK) r = write(s, path, err);
  for (int i = 0; i < s->n_files; i++) WebPFree((void *)(uintptr_t)s->file[i].data);
  free(s->rgba);
  free(s->v);
  free(s->index);
  free(s->weight);
  free(s->level);
  free(s);
  return r;
}
#else
sv_status lab_write_sog(const sv_gaussians *g, const sv_model_notes *notes, const lab_seen *seen,
                        const sv_pool *pool, const char *path, sv_err *err) {
  (void)g;
  (void)notes;
  (void)seen;
  (void)pool;
  return sv_fail(err, SV_E_UNSUPPORTED,
                 "%s: this build has no libwebp, which SOG needs (Debian: libwebp-dev)", path);
}
#endif
