// SPDX-License-Identifier: Apache-2.0
#include "tools/import/lytro.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "src/base/str.h"
#include "src/format/json.h"
#include "tools/common/fileio.h"

#define HEAD_BYTES 16 // magic, version and length
#define REF_BYTES  80 // SHA-1 in text, padded
#define CAP_SIDE   20000
#define DARK       0.05 // mean of a white image, of its range, below which it is none

static uint32_t be32(const uint8_t *p) {
  return (uint32_t)p[0] << 24 | (uint32_t)p[1] << 16 | (uint32_t)p[2] << 8 | p[3];
}

// --- description ---------------------------------------------------------------------------------

// The value at "a.b.c" below an object; -1: absent.
static int find(const sv_json *j, int at, const char *path) {
  char key[40];
  while (at >= 0 && *path) {
    size_t n = strcspn(path, ".");
    snprintf(key, sizeof key, "%.*s", (int)n, path);
    at = sv_json_is_object(j, at) ? sv_json_get(j, at, key) : -1;
    path += n + (path[n] == '.');
  }
  return at;
}

static double number(const sv_json *j, int at, const char *path, double otherwise) {
  double x = otherwise;
  sv_err err;
  at = find(j, at, path);
  return at >= 0 && sv_json_is_number(j, at) && sv_json_double(j, at, &x, &err) == SV_OK ? x : otherwise;
}

// The four places of a tile like "r,gr:gb,b", from the one that the picture begins with.
static sv_status read_mosaic(lab_lytro *l, const sv_json *j, int raw, sv_err *err) {
  char tile[32] = "r,gr:gb,b", first[8] = "r", name[4][8] = {""};
  int at = find(j, raw, "mosaic.tile"), start = -1;
  sv_status s = at >= 0 ? sv_json_string(j, at, tile, sizeof tile, err) : SV_OK;
  at = find(j, raw, "mosaic.upperLeftPixel");
  if (s == SV_OK && at >= 0) s = sv_json_string(j, at, first, sizeof first, err);
  if (s != SV_OK) return s;
  bool is_tile = sscanf(tile, "%7[a-z],%7[a-z]:%7[a-z],%7[a-z]", name[0], name[1], name[2], name[3]) == 4;
  for (int i = 0; i < 4; i++) {
    is_tile = is_tile && strchr("rgb", name[i][0]);
    if (sv_str_eq(name[i], first)) start = i;
  }
  if (!is_tile || start < 0)
    return sv_json_fail(j, raw, err, SV_E_UNSUPPORTED,
                        "a mosaic of %.20s, beginning with %s; expected Bayer's", tile, first);
  for (int i = 0; i < 4; i++) {
    const char *color = name[i ^ start]; // rows and columns both repeat after two
    char key[48];
    l->channel[i] = color[0] == 'r' ? 0 : color[0] == 'g' ? 1 : 2;
    snprintf(key, sizeof key, "pixelFormat.black.%s", color);
    l->black[i] = number(j, raw, key, 0);
    snprintf(key, sizeof key, "pixelFormat.white.%s", color);
    l->white[i] = number(j, raw, key, (1 << l->bits) - 1);
    if (!(l->black[i] >= 0 && l->white[i] > l->black[i] && l->white[i] < 1 << l->bits))
      return sv_json_fail(j, raw, err, SV_E_RANGE, "black and white levels that do not fit %d bits", l->bits);
    snprintf(key, sizeof key, "color.whiteBalanceGain.%s", color);
    l->balance[i] = number(j, find(j, 0, "image"), key, 1);
    if (!(l->balance[i] > 0 && l->balance[i] < 100)) l->balance[i] = 1;
  }
  return SV_OK;
}

static sv_status read_description(lab_lytro *l, const sv_json *j, sv_err *err) {
  int top = 0, frames = find(j, 0, "master.picture.frameArray");
  char order[16] = "";
  if (frames >= 0) top = find(j, sv_json_first(j, frames), "frame.metadata");
  const int image = find(j, top, "image"), details = find(j, image, "rawDetails");
  const int raw = details >= 0 ? details : image, packing = find(j, raw, "pixelPacking");
  const double w = number(j, image, "width", 0), h = number(j, image, "height", 0);
  if (!(w >= 16 && h >= 16 && w <= CAP_SIDE && h <= CAP_SIDE))
    return sv_json_fail(j, image, err, SV_E_FORMAT, "expected image.width and height of 16 to %d", CAP_SIDE);
  l->width_px = (int)w;
  l->height_px = (int)h;
  l->bits = (int)number(j, packing, "bitsPerPixel", 0);
  int at = find(j, packing, "endianness");
  if (at >= 0 && sv_json_string(j, at, order, sizeof order, err) != SV_OK) return SV_E_FORMAT;
  if (!(l->bits == 10 && !sv_str_eq(order, "big")) && !(l->bits == 12 && !sv_str_eq(order, "little")))
    return sv_json_fail(j, image, err, SV_E_UNSUPPORTED,
                        "pixels of %d bits, %s endian; expected 10 or 12 packed", l->bits,
                        *order ? order : "of unknown");
  l->focal_m = number(j, top, "devices.lens.focalLength", 0);
  l->f_number = number(j, top, "devices.lens.fNumber", 0);
  l->zoom = number(j, top, "devices.lens.zoomStep", 0);
  l->focus = number(j, top, "devices.lens.focusStep", 0);
  l->lens_pitch_m = number(j, top, "devices.mla.lensPitch", 0);
  l->pixel_m = number(j, top, "devices.sensor.pixelPitch", 0);
  return read_mosaic(l, j, raw, err);
}

// Whole groups of four or two pixels.
static size_t packed_bytes(const lab_lytro *l) {
  const size_t n = (size_t)l->width_px * (size_t)l->height_px;
  return l->bits == 10 ? (n + 3) / 4 * 5 : (n + 1) / 2 * 3;
}

sv_status lab_lytro_describe(lab_lytro *l, const sv_file_data *json, const sv_file_data *raw, sv_err *err) {
  int n = 0;
  sv_json j;
  memset(l, 0, sizeof *l);
  sv_status s = sv_json_count(json->name, json->data, json->bytes, &n, err);
  jsmntok_t *tok = s == SV_OK ? malloc(((size_t)n + 1) * sizeof *tok) : NULL;
  if (s == SV_OK && !tok) s = sv_fail(err, SV_E_NOMEM, "%s: no memory", json->name);
  if (s == SV_OK) s = sv_json_parse(&j, json, tok, n, err);
  if (s == SV_OK) s = read_description(l, &j, err);
  free(tok);
  if (s != SV_OK || !raw) return s;
  if (raw->bytes < packed_bytes(l))
    return sv_fail(err, SV_E_FORMAT, "%s: has %zu bytes; %dx%d pixels of %d bits need %zu", raw->name,
                   raw->bytes, l->width_px, l->height_px, l->bits, packed_bytes(l));
  l->raw = (const uint8_t *)raw->data;
  l->raw_bytes = packed_bytes(l);
  return SV_OK;
}

// --- container -----------------------------------------------------------------------------------

static bool has_word(const uint8_t *p, size_t n, const char *word) {
  const size_t len = strlen(word);
  for (size_t i = 0; i + len <= n; i++)
    if (memcmp(p + i, word, len) == 0) return true;
  return false;
}

// The next section's data; false at the end.
static bool next_section(const sv_file_data *f, size_t *at, sv_file_data *out) {
  const uint8_t *d = (const uint8_t *)f->data;
  while (*at < f->bytes && d[*at] == 0) (*at)++; // padding
  if (f->bytes - *at < HEAD_BYTES || memcmp(d + *at, "\x89LF", 3) != 0) return false;
  const size_t bytes = be32(d + *at + 12), head = bytes ? HEAD_BYTES + REF_BYTES : HEAD_BYTES;
  if (head > f->bytes - *at || bytes > f->bytes - *at - head) return false;
  *out = (sv_file_data){f->name, d + *at + head, bytes};
  *at += head + bytes;
  return true;
}

sv_status lab_lytro_parse(lab_lytro *l, const sv_file_data *f, sv_err *err) {
  size_t at = 0;
  sv_file_data s, json = {0}, largest = {0};
  memset(l, 0, sizeof *l);
  if (f->bytes < HEAD_BYTES || memcmp(f->data, "\x89LFP\r\n\x1a\n", 8) != 0)
    return sv_fail(err, SV_E_FORMAT, "%s: is no light field picture of a Lytro camera", f->name);
  while (next_section(f, &at, &s)) {
    const uint8_t *d = (const uint8_t *)s.data;
    if (s.bytes > 1 && d[0] == '{' && has_word(d, s.bytes, "\"devices\"") &&
        has_word(d, s.bytes, "\"image\""))
      json = s;
    else if (s.bytes > largest.bytes) largest = s;
  }
  if (!json.data)
    return sv_fail(
        err, SV_E_UNSUPPORTED,
        "%s: has no description of a raw picture, or is cut off; expected a file as the camera wrote it",
        f->name);
  while (json.bytes && !((const uint8_t *)json.data)[json.bytes - 1]) json.bytes--;
  if (!largest.data) largest = (sv_file_data){f->name, f->data, 0};
  return lab_lytro_describe(l, &json, &largest, err);
}

// --- pixels --------------------------------------------------------------------------------------

// Pixel i of the packed ones: 10 bits: four times the upper eight, then the lower two of all four;
// 12 bits: two pixels in three bytes, big-endian.
static int pixel(const lab_lytro *l, size_t i) {
  if (l->bits == 12) {
    const uint8_t *p = l->raw + i / 2 * 3;
    return i % 2 ? (p[1] & 15) << 8 | p[2] : p[0] << 4 | p[1] >> 4;
  }
  const uint8_t *p = l->raw + i / 4 * 5;
  return p[i % 4] << 2 | (p[4] >> (2 * (i % 4)) & 3);
}

static double light(const lab_lytro *l, size_t i, int place) {
  double v = (pixel(l, i) - l->black[place]) / (l->white[place] - l->black[place]);
  return v < 0 ? 0 : v > 1 ? 1 : v;
}

static int place_of(int x, int y) { return 2 * (y & 1) + (x & 1); }

// Each color: mean of the nearest pixels that have it, weighted by a tent of two pixels.
static void demosaic_at(const lab_lytro *l, const float *mosaic, int x, int y, uint16_t rgb[3]) {
  double sum[3] = {0}, weight[3] = {0};
  for (int dy = -1; dy <= 1; dy++)
    for (int dx = -1; dx <= 1; dx++) {
      const int u = x + dx, v = y + dy;
      if (u < 0 || v < 0 || u >= l->width_px || v >= l->height_px) continue;
      const double w = (2 - abs(dx)) * (2 - abs(dy));
      const int c = l->channel[place_of(u, v)];
      sum[c] += w * (double)mosaic[(size_t)v * (size_t)l->width_px + (size_t)u];
      weight[c] += w;
    }
  const int own = l->channel[place_of(x, y)];
  sum[own] = (double)mosaic[(size_t)y * (size_t)l->width_px + (size_t)x];
  weight[own] = 1;
  for (int c = 0; c < 3; c++) {
    double v = weight[c] > 0 ? sum[c] / weight[c] : 0;
    rgb[c] = (uint16_t)(65535 * (v > 1 ? 1 : v) + 0.5);
  }
}

sv_status lab_lytro_develop(const lab_lytro *l, bool is_grey, sv_bitmap *out, sv_err *err) {
  const size_t n = (size_t)l->width_px * (size_t)l->height_px;
  *out = (sv_bitmap){
      .width_px = l->width_px, .height_px = l->height_px, .n_channels = is_grey ? 1 : 3, .bits = 16};
  float *mosaic = malloc(n * sizeof *mosaic);
  out->u16 = malloc(n * (size_t)out->n_channels * sizeof *out->u16);
  if (!mosaic || !out->u16) {
    free(mosaic);
    sv_bitmap_free(out);
    return sv_fail(err, SV_E_NOMEM, "no memory for a raw picture of %dx%d", l->width_px, l->height_px);
  }
  for (size_t i = 0; i < n; i++) {
    const int place = place_of((int)(i % (size_t)l->width_px), (int)(i / (size_t)l->width_px));
    mosaic[i] = (float)(light(l, i, place) * (is_grey ? 1 : l->balance[place]));
    if (is_grey) out->u16[i] = (uint16_t)(65535 * mosaic[i] + 0.5f);
  }
  for (int y = 0; !is_grey && y < l->height_px; y++)
    for (int x = 0; x < l->width_px; x++)
      demosaic_at(l, mosaic, x, y, out->u16 + 3 * ((size_t)y * (size_t)l->width_px + (size_t)x));
  free(mosaic);
  return SV_OK;
}

// --- files ---------------------------------------------------------------------------------------

sv_status lab_lytro_read(const char *path, lab_lytro *l, sv_bitmap *out, sv_err *err) {
  void *data = NULL;
  size_t bytes = 0;
  memset(l, 0, sizeof *l);
  sv_status s = sv_file_read(path, &data, &bytes, err);
  const sv_file_data file = {path, data, bytes};
  if (s == SV_OK) s = lab_lytro_parse(l, &file, err);
  if (s == SV_OK) s = lab_lytro_develop(l, false, out, err);
  l->raw = NULL;
  free(data);
  return s;
}

static sv_status read_white(const char *folder, const char *txt, lab_lytro *l, bool is_developed,
                            sv_bitmap *out, sv_err *err) {
  char path[SV_CAP_PATH], raw_path[SV_CAP_PATH];
  void *json = NULL, *raw = NULL;
  size_t n_json = 0, n_raw = 0;
  sv_status s = sv_path_join(path, sizeof path, folder, txt, err);
  if (s != SV_OK) return s;
  snprintf(raw_path, sizeof raw_path, "%s", path);
  memcpy(raw_path + strlen(raw_path) - 4, strcmp(sv_path_extension(txt), ".txt") ? ".RAW" : ".raw", 4);
  s = sv_file_read(path, &json, &n_json, err);
  if (s == SV_OK && is_developed) s = sv_file_read(raw_path, &raw, &n_raw, err);
  const sv_file_data a = {path, json, n_json}, b = {raw_path, raw, n_raw};
  if (s == SV_OK) s = lab_lytro_describe(l, &a, is_developed ? &b : NULL, err);
  if (s == SV_OK && is_developed) s = lab_lytro_develop(l, true, out, err);
  l->raw = NULL;
  free(json);
  free(raw);
  return s;
}

static double mean_of(const sv_bitmap *b) {
  double sum = 0;
  const size_t n = (size_t)b->width_px * (size_t)b->height_px;
  for (size_t i = 0; i < n; i++) sum += b->u16[i];
  return sum / (65535.0 * (double)n);
}

sv_status lab_lytro_white(const char *folder, const lab_lytro *of, char *path, sv_bitmap *out, sv_err *err) {
  sv_names names;
  sv_status s = sv_folder_list(folder, &names, err);
  if (s != SV_OK) return s;
  double *far = malloc(((size_t)names.n + 1) * sizeof *far);
  for (int i = 0; far && i < names.n; i++) {
    lab_lytro l;
    sv_err ignored;
    far[i] = INFINITY;
    if (strcasecmp(sv_path_extension(names.names[i]), ".txt") != 0 ||
        read_white(folder, names.names[i], &l, false, NULL, &ignored) != SV_OK)
      continue;
    if (l.width_px == of->width_px && l.height_px == of->height_px)
      far[i] = hypot(l.zoom - of->zoom, l.focus - of->focus);
  }
  s = sv_fail(err, SV_E_NOT_FOUND,
              "%s: has no white image of %dx%d; expected the camera's MOD_*.TXT and MOD_*.RAW", folder,
              of->width_px, of->height_px);
  for (int tries = 0; far && tries < names.n; tries++) {
    lab_lytro l;
    int best = 0;
    for (int i = 1; i < names.n; i++)
      if (far[i] < far[best]) best = i;
    if (!isfinite(far[best])) break;
    far[best] = INFINITY;
    if ((s = read_white(folder, names.names[best], &l, true, out, err)) != SV_OK) break;
    if (mean_of(out) >= DARK) {
      s = sv_path_join(path, SV_CAP_PATH, folder, names.names[best], err);
      break;
    }
    sv_bitmap_free(out);
    s = sv_fail(err, SV_E_NOT_FOUND, "%s: all of its white images are dark", folder);
  }
  free(far);
  sv_names_free(&names);
  return s;
}
