// SPDX-License-Identifier: Apache-2.0
#include "src/format/glb.h"

#include <math.h>
#include <string.h>

#include "src/base/mathx.h"
#include "src/base/str.h"
#include "src/format/axes.h"
#include "src/format/bytes.h"

#define MAGIC      0x46546c67u // "glTF"
#define JSON_CHUNK 0x4e4f534au
#define BIN_CHUNK  0x004e4942u
#define JSON_BYTES 8192u // spaces fill it up
#define BIN_AT     (12 + 8 + JSON_BYTES + 8)
#define FLOAT_TYPE 5126
#define EXTENSION  "KHR_gaussian_splatting"

static int n_sh(int degree) { return (degree + 1) * (degree + 1); }

// --- writing -------------------------------------------------------------------------------------

void sv_glb_extend(sv_glb *z, const sv_gaussian *in) {
  sv_gaussian g = *in;
  sv_gaussian_turn(&g, SV_TURN_Z);
  for (int k = 0; k < 3; k++) {
    if (z->n == 0 || g.mean[k] < z->min[k]) z->min[k] = g.mean[k];
    if (z->n == 0 || g.mean[k] > z->max[k]) z->max[k] = g.mean[k];
  }
  z->n++;
}

// Attribute i: position, rotation, scale, opacity, color, then SH; attributes are stored one after
// another.
static size_t width_of(int i) {
  static const uint8_t widths[] = {12, 16, 12, 4, 4};
  return i < 5 ? widths[i] : 12;
}
static size_t at_of(const sv_glb *z, int i) {
  size_t at = 0;
  for (int k = 0; k < i; k++) at += width_of(k) * z->n;
  return at;
}
static int n_attributes(const sv_glb *z) { return 5 + n_sh(z->sh_degree); }
static size_t bin_bytes(const sv_glb *z) { return at_of(z, n_attributes(z)); }
size_t sv_glb_bytes(const sv_glb *z) { return BIN_AT + bin_bytes(z); }

static void add_unit(sv_str *s, const sv_unit *u) {
  if (!u->is_metric) return;
  sv_str_add(s, ",\"extras\":{\"unit\":\"m\"");
  if (u->scale_sigma > 0) sv_str_add(s, ",\"scale_sigma\":%.3g", (double)u->scale_sigma);
  sv_str_add(s, "}");
}

static void add_name(sv_str *s, int i) {
  static const char *const names[] = {"POSITION", EXTENSION ":ROTATION", EXTENSION ":SCALE",
                                      EXTENSION ":OPACITY", "COLOR_0"};
  int k = i - 5, degree = k < 1 ? 0 : k < 4 ? 1 : k < 9 ? 2 : 3;
  if (i < 5) sv_str_add(s, "\"%s\":%d", names[i], i);
  else sv_str_add(s, "\"" EXTENSION ":SH_DEGREE_%d_COEF_%d\":%d", degree, k - degree * degree, i);
}

static void add_accessor(sv_str *s, const sv_glb *z, int i) {
  static const char *const types[] = {"VEC3", "VEC4", "VEC3", "SCALAR", "VEC4"};
  sv_str_add(s, "%s{\"bufferView\":%d,\"componentType\":%d,\"count\":%u,\"type\":\"%s\"", i ? "," : "", i,
             i == 4 ? 5121 : FLOAT_TYPE, z->n, i < 5 ? types[i] : "VEC3");
  if (i == 4) sv_str_add(s, ",\"normalized\":true");
  if (i == 0)
    sv_str_add(s, ",\"min\":[%g,%g,%g],\"max\":[%g,%g,%g]", (double)z->min[0], (double)z->min[1],
               (double)z->min[2], (double)z->max[0], (double)z->max[1], (double)z->max[2]);
  sv_str_add(s, "}");
}

sv_status sv_glb_head(const sv_glb *z, uint8_t *file, sv_err *err) {
  if (z->sh_degree < 0 || z->sh_degree > 3 || sv_glb_bytes(z) > UINT32_MAX)
    return sv_fail(err, SV_E_RANGE, "GLB: %u Gaussians of SH degree %d do not fit (4 GiB, degree 0 to 3)",
                   z->n, z->sh_degree);
  sv_put_le32(file, MAGIC);
  sv_put_le32(file + 4, 2);
  sv_put_le32(file + 8, (uint32_t)sv_glb_bytes(z));
  sv_put_le32(file + 12, JSON_BYTES);
  sv_put_le32(file + 16, JSON_CHUNK);
  // its terminator is overwritten by the next part
  sv_str s = sv_str_make((char *)file + 20, JSON_BYTES + 1);
  sv_str_add(&s, "{\"asset\":{\"version\":\"2.0\",\"generator\":\"subview\"");
  add_unit(&s, &z->unit);
  sv_str_add(&s, "},\"extensionsUsed\":[\"" EXTENSION
                 "\"],\"scene\":0,\"scenes\":[{\"nodes\":[0]}],\"nodes\":[{\"mesh\":0}],"
                 "\"meshes\":[{\"primitives\":[{\"mode\":0,\"attributes\":{");
  for (int i = 0; i < n_attributes(z); i++) {
    if (i) sv_str_add(&s, ",");
    add_name(&s, i);
  }
  sv_str_add(&s, "},\"extensions\":{\"" EXTENSION
                 "\":{\"kernel\":\"ellipse\",\"colorSpace\":\"srgb_rec709_display\","
                 "\"sortingMethod\":\"cameraDistance\",\"projection\":\"perspective\"}}}]}],\"accessors\":[");
  for (int i = 0; i < n_attributes(z); i++) add_accessor(&s, z, i);
  sv_str_add(&s, "],\"bufferViews\":[");
  for (int i = 0; i < n_attributes(z); i++)
    sv_str_add(&s, "%s{\"buffer\":0,\"byteOffset\":%zu,\"byteLength\":%zu,\"target\":34962}", i ? "," : "",
               at_of(z, i), width_of(i) * z->n);
  sv_str_add(&s, "],\"buffers\":[{\"byteLength\":%zu}]}", bin_bytes(z));
  memset(s.buf + s.len, ' ', JSON_BYTES - s.len);
  sv_put_le32(file + BIN_AT - 8, (uint32_t)bin_bytes(z));
  sv_put_le32(file + BIN_AT - 4, BIN_CHUNK);
  return s.is_cut ? sv_fail(err, SV_E_RANGE, "GLB: its description is longer than %u bytes", JSON_BYTES)
                  : SV_OK;
}

static double sigmoid(double x) { return 1 / (1 + sv_exp(-x)); }
static uint8_t to_byte(double x) { return (uint8_t)(x > 1 ? 255 : x > 0 ? x * 255 + 0.5 : 0); }

void sv_glb_put(const sv_glb *z, uint8_t *file, uint32_t i, const sv_gaussian *in) {
  sv_gaussian g = *in;
  sv_gaussian_turn(&g, SV_TURN_Z);
  uint8_t *at[5 + SV_GLB_N_SH];
  for (int a = 0; a < n_attributes(z); a++) at[a] = file + BIN_AT + at_of(z, a) + width_of(a) * i;
  double n = 0, opacity = sigmoid((double)g.opacity_logit);
  for (int k = 0; k < 4; k++) n += (double)g.quat_wxyz[k] * (double)g.quat_wxyz[k];
  bool is_usable = n > 1e-30 && n < 1e30;
  for (int k = 0; k < 4; k++) {
    double q = is_usable ? (double)g.quat_wxyz[(k + 1) % 4] / sqrt(n) : k == 3;
    sv_put_lef32(at[1] + 4 * k, (float)q);
  }
  for (int k = 0; k < 3; k++) {
    sv_put_lef32(at[0] + 4 * k, g.mean[k]);
    sv_put_lef32(at[2] + 4 * k, (float)sv_exp((double)g.log_scale[k]));
    at[4][k] = to_byte(0.5 + SV_SH_C0 * (double)g.sh[0][k]);
    for (int c = 0; c < n_sh(z->sh_degree); c++) sv_put_lef32(at[5 + c] + 4 * k, g.sh[c][k]);
  }
  sv_put_lef32(at[3], (float)opacity);
  at[4][3] = to_byte(opacity);
}

// --- reading -------------------------------------------------------------------------------------

typedef struct {
  const sv_json *j;
  const uint8_t *bin;
  size_t bin_bytes;
  int accessors, views, attributes;
  uint32_t n; // values of an attribute, 0: not known yet
} source;

static int element(const sv_json *j, int i_array, long long i) {
  int t = sv_json_first(j, i_array);
  while (t >= 0 && i-- > 0) t = sv_json_next(j, t);
  return t;
}

static sv_status get_field(source *s, const char *key, int width, bool is_needed, sv_glb_field *out,
                           sv_err *err) {
  const sv_json *j = s->j;
  const int attributes = s->attributes;
  long long i, count = 0, view = -1, type = 0, at = 0, more = 0, length = 0, stride = 4 * width;
  sv_status r = sv_json_get_int(j, attributes, key, (sv_json_range){0, 1 << 20}, &i, err);
  if (r == SV_END && !is_needed) return SV_OK;
  if (r != SV_OK) return r == SV_END ? sv_json_missing(j, attributes, key, err) : r;
  int a = element(j, s->accessors, i);
  if (a < 0) return sv_json_fail(j, attributes, err, SV_E_FORMAT, "%s: no accessor %lld", key, i);
  r = sv_json_get_int(j, a, "bufferView", (sv_json_range){0, 1 << 20}, &view, err);
  if (r >= 0) r = sv_json_get_int(j, a, "componentType", (sv_json_range){0, 65535}, &type, err);
  if (r >= 0) r = sv_json_get_int(j, a, "count", (sv_json_range){1, 100000000}, &count, err);
  if (r >= 0) r = sv_json_get_int(j, a, "byteOffset", (sv_json_range){0, UINT32_MAX}, &more, err);
  int v = r >= 0 && view >= 0 ? element(j, s->views, view) : -1;
  if (r >= 0 && v >= 0) r = sv_json_get_int(j, v, "byteOffset", (sv_json_range){0, UINT32_MAX}, &at, err);
  if (r >= 0 && v >= 0) r = sv_json_get_int(j, v, "byteLength", (sv_json_range){0, UINT32_MAX}, &length, err);
  if (r >= 0 && v >= 0) r = sv_json_get_int(j, v, "byteStride", (sv_json_range){4, 252}, &stride, err);
  if (r < 0) return r;
  if (type != FLOAT_TYPE || v < 0)
    return sv_json_fail(j, a, err, SV_E_UNSUPPORTED, "%s: floats in a buffer view were expected", key);
  if (s->n && (long long)s->n != count)
    return sv_json_fail(j, a, err, SV_E_FORMAT, "%s: %lld values, POSITION has %u", key, count, s->n);
  s->n = (uint32_t)count;
  bool is_inside =
      more + (count - 1) * stride + 4 * width <= length && at + length <= (long long)s->bin_bytes;
  if (stride < 4 * width || !is_inside)
    return sv_json_fail(j, a, err, SV_E_FORMAT, "%s: its %lld values lie outside of the file's data", key,
                        count);
  *out = (sv_glb_field){s->bin + at + more, (size_t)stride};
  return SV_OK;
}

// The attributes of the first primitive that has the extension, -1 when none has.
static int find_primitive(const sv_json *j) {
  for (int m = sv_json_first(j, sv_json_get(j, 0, "meshes")); m >= 0; m = sv_json_next(j, m))
    for (int p = sv_json_first(j, sv_json_get(j, m, "primitives")); p >= 0; p = sv_json_next(j, p))
      if (sv_json_get(j, sv_json_get(j, p, "extensions"), EXTENSION) >= 0)
        return sv_json_get(j, p, "attributes");
  return -1;
}

static sv_status read_fields(sv_glb_reader *r, source *s, sv_err *err) {
  char key[64];
  sv_status t = get_field(s, "POSITION", 3, true, &r->position, err);
  if (t >= 0) t = get_field(s, EXTENSION ":ROTATION", 4, true, &r->rotation, err);
  if (t >= 0) t = get_field(s, EXTENSION ":SCALE", 3, true, &r->scale, err);
  if (t >= 0) t = get_field(s, EXTENSION ":OPACITY", 1, true, &r->opacity, err);
  for (int k = 0; t >= 0 && k < SV_GLB_N_SH; k++) {
    int degree = k < 1 ? 0 : k < 4 ? 1 : k < 9 ? 2 : 3;
    sv_fmt(key, sizeof key, EXTENSION ":SH_DEGREE_%d_COEF_%d", degree, k - degree * degree);
    t = get_field(s, key, 3, k == 0, &r->sh[k], err);
    if (t >= 0 && r->sh[k].at) r->sh_degree = degree;
  }
  r->n = s->n;
  return t < 0 ? t : SV_OK;
}

// Extras of other programs are skipped.
static void read_unit(const sv_json *j, sv_unit *unit) {
  const int i = sv_json_get(j, sv_json_get(j, 0, "asset"), "extras");
  char text[8] = "";
  double sigma = 0;
  sv_err err;
  if (i < 0 || !sv_json_is_object(j, i)) return;
  if (sv_json_get_string(j, i, "unit", text, sizeof text, &err) != SV_OK) return;
  const sv_status s = sv_json_get_double(j, i, "scale_sigma", &sigma, &err);
  unit->is_metric = sv_str_eq(text, "m");
  if (s == SV_OK && sigma > 0 && sigma < 1) unit->scale_sigma = (float)sigma;
}

sv_status sv_glb_open(sv_glb_reader *r, const sv_file_data *file, jsmntok_t *tok, sv_err *err) {
  const char *name = file->name;
  const uint8_t *d = file->data;
  const size_t bytes = file->bytes;
  memset(r, 0, sizeof *r);
  if (bytes < 28 || sv_le32(d) != MAGIC || sv_le32(d + 4) != 2 || sv_le32(d + 16) != JSON_CHUNK)
    return sv_fail(err, SV_E_FORMAT, "%s: not a binary glTF 2.0 file", name);
  size_t json = sv_le32(d + 12), after = 20 + json;
  if (json > bytes - 28 || sv_le32(d + after + 4) != BIN_CHUNK || sv_le32(d + after) > bytes - after - 8)
    return sv_fail(err, SV_E_FORMAT, "%s: its chunks are longer than the file", name);
  sv_json j;
  sv_status s = sv_json_parse(&j, &(sv_file_data){name, d + 20, json}, tok, SV_GLB_CAP_TOKENS, err);
  if (s < 0) return s;
  source src = {.j = &j,
                .bin = d + after + 8,
                .bin_bytes = sv_le32(d + after),
                .accessors = sv_json_get(&j, 0, "accessors"),
                .views = sv_json_get(&j, 0, "bufferViews"),
                .attributes = find_primitive(&j)};
  if (src.attributes < 0)
    return sv_fail(err, SV_E_NOT_FOUND, "%s: expected a primitive with " EXTENSION ", found none", name);
  read_unit(&j, &r->unit);
  return read_fields(r, &src, err);
}

static float at_float(const sv_glb_field *f, uint32_t i, int k) {
  return f->at ? sv_lef32(f->at + (size_t)i * f->stride_bytes + 4 * (size_t)k) : 0;
}

void sv_glb_get(const sv_glb_reader *r, uint32_t i, sv_gaussian *g) {
  memset(g, 0, sizeof *g);
  double o = (double)at_float(&r->opacity, i, 0);
  o = o > 1 - 1e-6 ? 1 - 1e-6 : o > 1e-6 ? o : 1e-6;
  g->opacity_logit = (float)sv_log(o / (1 - o));
  for (int k = 0; k < 4; k++) g->quat_wxyz[(k + 1) % 4] = at_float(&r->rotation, i, k);
  for (int k = 0; k < 3; k++) {
    double s = (double)at_float(&r->scale, i, k);
    g->mean[k] = at_float(&r->position, i, k);
    g->log_scale[k] = s > 1e-13 ? (float)sv_log(s) : -30.0f;
    for (int c = 0; c < n_sh(r->sh_degree); c++) g->sh[c][k] = at_float(&r->sh[c], i, k);
  }
  sv_gaussian_turn(g, SV_TURN_Z);
}
