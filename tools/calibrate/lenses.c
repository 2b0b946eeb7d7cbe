// SPDX-License-Identifier: Apache-2.0
#include "tools/calibrate/lenses.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/str.h"
#include "tools/common/imageio.h"

#define LIT_SHARE 0.3f // of the plateau: what is darker says little about the object
#define RIM_PX    3    // left out inside the lit part
#define CAP_LEVEL 0.995
#define MIN_LEVEL (4.0f / 65535)

// One channel of linear light, 16 bits.
static sv_status read_light(const char *path, bool is_linear, sv_bitmap *out, sv_err *err) {
  sv_status s = sv_bitmap_read(path, out, err);
  if (s == SV_OK && out->n_channels == 2)
    s = sv_fail(err, SV_E_FORMAT, "%s: gray with alpha is not a sensor image", path);
  size_t n = (size_t)out->width_px * (size_t)out->height_px;
  uint16_t *v = s == SV_OK ? malloc(n * sizeof *v) : NULL;
  if (s == SV_OK && !v) s = sv_fail(err, SV_E_NOMEM, "%s: no memory for it", path);
  for (size_t i = 0; i < n && s == SV_OK; i++) {
    double sum = 0;
    int nc = out->n_channels < 3 ? 1 : 3;
    for (int c = 0; c < nc; c++) {
      size_t at = i * (size_t)out->n_channels + (size_t)c;
      double x = out->u16 ? out->u16[at] / 65535.0 : out->u8[at] / 255.0;
      sum += is_linear ? x : x <= 0.04045 ? x / 12.92 : pow((x + 0.055) / 1.055, 2.4);
    }
    v[i] = (uint16_t)lrint(sum / nc * 65535);
  }
  if (s != SV_OK) {
    sv_bitmap_free(out);
    return s;
  }
  free(out->u8);
  free(out->u16);
  *out = (sv_bitmap){
      .width_px = out->width_px, .height_px = out->height_px, .n_channels = 1, .bits = 16, .u16 = v};
  return SV_OK;
}

static bool is_picture(const char *name) {
  const char *e = sv_path_extension(name);
  return strcmp(e, ".png") == 0 || strcmp(e, ".PNG") == 0 || strcmp(e, ".jpg") == 0 ||
         strcmp(e, ".jpeg") == 0;
}

// --- white images --------------------------------------------------------------------------------
// Well lit, and RIM_PX away from what is not: the lens's edge is no feature of the object.
static void fill_mask(cal_lens *l) {
  int w = l->footprint.width_px, h = l->footprint.height_px;
  for (int y = 0; y < h; y++)
    for (int x = 0; x < w; x++) {
      bool is_in = x >= RIM_PX && y >= RIM_PX && x < w - RIM_PX && y < h - RIM_PX;
      for (int d = 0; d < 9 && is_in; d++) {
        int px = x + (d % 3 - 1) * RIM_PX, py = y + (d / 3 - 1) * RIM_PX;
        is_in = l->footprint.coverage[py * w + px] >= (uint8_t)(255 * LIT_SHARE);
      }
      l->mask[y * w + x] = is_in ? 255 : 0;
    }
}

static sv_status measure(cal_lenses *l, cal_lens *lens, const cal_options *o, const char *path, sv_err *err) {
  sv_bitmap white = {0};
  sv_status s = read_light(path, o->is_linear, &white, err);
  if (s != SV_OK) return s;
  if (!l->width_px) {
    l->width_px = white.width_px;
    l->height_px = white.height_px;
  }
  if (white.width_px != l->width_px || white.height_px != l->height_px)
    s = sv_fail(err, SV_E_FORMAT, "%s: %dx%d pixels, the other white images have %dx%d", path, white.width_px,
                white.height_px, l->width_px, l->height_px);
  size_t n_scratch = sv_footprint_bytes(white.width_px, white.height_px) + 4 * SV_ARENA_ALIGN;
  size_t n_out = (size_t)white.width_px * (size_t)white.height_px + 4 * SV_ARENA_ALIGN;
  void *work = malloc(n_scratch);
  lens->block = malloc(n_out);
  if (s == SV_OK && (!work || !lens->block))
    s = sv_fail(err, SV_E_NOMEM, "%s: no memory to measure it", path);
  if (s == SV_OK) {
    sv_arena scratch = sv_arena_make(work, n_scratch), out = sv_arena_make(lens->block, n_out);
    sv_raw raw = {NULL, white.u16, white.width_px, white.height_px, 1};
    s = sv_footprint_measure(&lens->footprint, &lens->stats, &(sv_white_image){path, &raw, o->dark}, &out,
                             &scratch, err);
  }
  sv_bitmap_free(&white);
  free(work);
  if (s != SV_OK) return s;
  lens->mask = malloc((size_t)lens->footprint.width_px * (size_t)lens->footprint.height_px);
  if (!lens->mask) return sv_fail(err, SV_E_NOMEM, "%s: no memory for its mask", path);
  fill_mask(lens);
  return SV_OK;
}

static sv_status add_lens(cal_lenses *l, const cal_options *o, const char *file, sv_err *err) {
  char path[SV_CAP_PATH];
  if (l->n_lenses == SV_CAP_SUB_VIEWS)
    return sv_fail(err, SV_E_FULL, "%s: more than %d lenses", o->white, SV_CAP_SUB_VIEWS);
  sv_status s = cal_stopped(l->session, NULL, err);
  if (s == SV_OK) s = sv_path_join(path, sizeof path, o->white, file, err);
  if (s != SV_OK) return s;
  cal_lens *lens = &l->lenses[l->n_lenses++];
  size_t n = strlen(file) - strlen(sv_path_extension(file));
  if (n >= sizeof lens->name)
    return sv_fail(err, SV_E_RANGE, "%s: expected a lens name of at most %zu characters", path,
                   sizeof lens->name - 1);
  sv_fmt(lens->name, sizeof lens->name, "%.*s", (int)n, file);
  return measure(l, lens, o, path, err);
}

static sv_status read_white(cal_lenses *l, const cal_options *o, sv_err *err) {
  sv_names names;
  sv_status s = sv_folder_list(o->white, &names, err);
  if (s != SV_OK) return s;
  l->lenses = calloc((size_t)names.n + 1, sizeof *l->lenses);
  if (!l->lenses) s = sv_fail(err, SV_E_NOMEM, "%s: no memory for its list", o->white);
  for (int k = 0; k < names.n && s == SV_OK; k++)
    if (is_picture(names.names[k])) s = add_lens(l, o, names.names[k], err);
  sv_names_free(&names);
  if (s != SV_OK) return s;
  if (l->n_lenses < 3)
    return sv_fail(err, SV_E_NOT_FOUND,
                   "%s: found %d white images, expected one for each of at least 3 lenses", o->white,
                   l->n_lenses);
  float *sum = malloc((size_t)l->width_px * (size_t)l->height_px * sizeof *sum);
  sv_footprint *f = malloc((size_t)l->n_lenses * sizeof *f);
  if (!sum || !f) s = sv_fail(err, SV_E_NOMEM, "%s: no memory for the sum of footprints", o->white);
  for (int i = 0; i < l->n_lenses && f; i++) f[i] = l->lenses[i].footprint;
  sv_overlap_map map = {.width_px = l->width_px, .height_px = l->height_px, .sum = sum};
  if (s == SV_OK) s = sv_footprint_sum(f, l->n_lenses, &map, err);
  if (s == SV_OK) l->max_overlap = map.max_overlap;
  free(sum);
  free(f);
  return s;
}

// --- isolated images -----------------------------------------------------------------------------
static int compare(const void *a, const void *b) {
  float x = *(const float *)a, y = *(const float *)b;
  return (x > y) - (x < y);
}

// The lens's part, divided by its coverage, between its darkest and nearly brightest values, as 8
// bits with a gamma of 2: features are found in the shadows, too.
static sv_status cut_out(cal_lens *l, int exposure, const sv_bitmap *b, const char *path, sv_err *err) {
  const sv_footprint *f = &l->footprint;
  size_t n = (size_t)f->width_px * (size_t)f->height_px, n_lit = 0;
  float *v = malloc(2 * n * sizeof *v), *sorted = v ? v + n : NULL;
  l->grey[exposure] = malloc(n);
  if (!v || !l->grey[exposure]) {
    free(v);
    return sv_fail(err, SV_E_NOMEM, "%s: no memory for it", path);
  }
  for (size_t i = 0; i < n; i++) {
    size_t x = (size_t)f->x0_px + i % (size_t)f->width_px, y = (size_t)f->y0_px + i / (size_t)f->width_px;
    float c = f->coverage[i] / 255.0f;
    v[i] = (float)b->u16[y * (size_t)b->width_px + x] / 65535.0f / (c < LIT_SHARE ? LIT_SHARE : c);
    if (l->mask[i]) sorted[n_lit++] = v[i];
  }
  qsort(sorted, n_lit, sizeof *sorted, compare);
  float lo = n_lit ? sorted[n_lit / 200] : 0,
        hi = n_lit ? sorted[(size_t)((double)(n_lit - 1) * CAP_LEVEL)] : 0;
  bool is_dark = !(hi - lo > MIN_LEVEL);
  for (size_t i = 0; i < n && !is_dark; i++) {
    float x = (v[i] - lo) / (hi - lo);
    l->grey[exposure][i] = (uint8_t)lrintf(255 * sqrtf(x < 0 ? 0 : x > 1 ? 1 : x));
  }
  free(v);
  return is_dark ? sv_fail(err, SV_E_FORMAT,
                           "%s: dark where lens %s lights the sensor; is another lens open?", path, l->name)
                 : SV_OK;
}

static sv_status take(cal_lenses *l, int lens, int exposure, const char *path, const cal_options *o,
                      sv_err *err) {
  sv_bitmap b = {0};
  sv_status s = cal_stopped(l->session, NULL, err);
  if (s == SV_OK) s = read_light(path, o->is_linear, &b, err);
  if (s != SV_OK) return s;
  if (b.width_px != l->width_px || b.height_px != l->height_px)
    s = sv_fail(err, SV_E_FORMAT, "%s: %dx%d pixels, the white images have %dx%d", path, b.width_px,
                b.height_px, l->width_px, l->height_px);
  if (s == SV_OK) s = cut_out(&l->lenses[lens], exposure, &b, path, err);
  sv_bitmap_free(&b);
  return s;
}

static int lens_of(const cal_lenses *l, const char *file) { // by name, with or without extension
  size_t n = strlen(file) - (is_picture(file) ? strlen(sv_path_extension(file)) : 0);
  for (int i = 0; i < l->n_lenses; i++)
    if (strlen(l->lenses[i].name) == n && strncmp(l->lenses[i].name, file, n) == 0) return i;
  return -1;
}

static sv_status more_exposures(cal_lenses *l, int n, sv_err *err) {
  for (int i = 0; i < l->n_lenses && n > l->n_exposures; i++) {
    uint8_t **more = realloc(l->lenses[i].grey, (size_t)n * sizeof *more);
    if (!more) return sv_fail(err, SV_E_NOMEM, "no memory for %d isolated exposures", n);
    for (int e = l->n_exposures; e < n; e++) more[e] = NULL;
    l->lenses[i].grey = more;
  }
  if (n > l->n_exposures) l->n_exposures = n;
  return SV_OK;
}

// A folder of images: of one lens in many exposures, or of one exposure through many lenses.
static sv_status read_inner(cal_lenses *l, const cal_options *o, const char *folder, int lens, int exposure,
                            sv_err *err) {
  sv_names names;
  char path[SV_CAP_PATH];
  sv_status s = sv_folder_list(folder, &names, err);
  if (s != SV_OK) return s;
  for (int k = 0, n = 0; k < names.n && s == SV_OK; k++) {
    if (!is_picture(names.names[k])) continue;
    int i = lens >= 0 ? lens : lens_of(l, names.names[k]), e = lens >= 0 ? n++ : exposure;
    s = sv_path_join(path, sizeof path, folder, names.names[k], err);
    if (s == SV_OK && i < 0)
      s = sv_fail(err, SV_E_NOT_FOUND, "%s: %s has no white image of that name", path, o->white);
    if (s == SV_OK) s = more_exposures(l, e + 1, err);
    if (s == SV_OK) s = take(l, i, e, path, o, err);
  }
  sv_names_free(&names);
  return s;
}

static sv_status read_isolated(cal_lenses *l, const cal_options *o, sv_err *err) {
  sv_names names;
  char path[SV_CAP_PATH];
  sv_status s = sv_folder_list(o->isolated, &names, err);
  if (s != SV_OK) return s;
  for (int k = 0, n_folders = 0; k < names.n && s == SV_OK; k++) {
    int i = lens_of(l, names.names[k]);
    s = sv_path_join(path, sizeof path, o->isolated, names.names[k], err);
    if (s != SV_OK) break;
    if (sv_path_is_folder(path)) {
      s = read_inner(l, o, path, i, i < 0 ? n_folders : 0, err);
      n_folders += i < 0;
    } else if (is_picture(path)) {
      if (i < 0) s = sv_fail(err, SV_E_NOT_FOUND, "%s: %s has no white image of that name", path, o->white);
      if (s == SV_OK) s = more_exposures(l, 1, err);
      if (s == SV_OK) s = take(l, i, 0, path, o, err);
    }
  }
  sv_names_free(&names);
  for (int i = 0; i < l->n_lenses && s == SV_OK; i++) {
    bool is_there = false;
    for (int e = 0; e < l->n_exposures; e++) is_there = is_there || l->lenses[i].grey[e];
    if (!is_there)
      s = sv_fail(err, SV_E_NOT_FOUND,
                  "%s: no image with lens %s alone (%s.png, in a folder %s, or in a folder per exposure)",
                  o->isolated, l->lenses[i].name, l->lenses[i].name, l->lenses[i].name);
  }
  return s;
}

sv_status cal_lenses_read(cal_lenses *l, const cal_options *o, const lab_session *session, sv_err *err) {
  memset(l, 0, sizeof *l);
  l->session = session;
  sv_status s = read_white(l, o, err);
  return s == SV_OK ? read_isolated(l, o, err) : s;
}

void cal_lenses_free(cal_lenses *l) {
  for (int i = 0; i < l->n_lenses; i++) {
    for (int e = 0; e < l->n_exposures && l->lenses[i].grey; e++) free(l->lenses[i].grey[e]);
    free(l->lenses[i].grey);
    free(l->lenses[i].mask);
    free(l->lenses[i].block);
  }
  free(l->lenses);
  memset(l, 0, sizeof *l);
}
