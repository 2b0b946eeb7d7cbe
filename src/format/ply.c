// SPDX-License-Identifier: Apache-2.0
#include "src/format/ply.h"

#include "src/format/axes.h"

#include <float.h>
#include <math.h>
#include <string.h>

#include "src/base/str.h"
#include "src/format/text.h"
#include "src/format/bytes.h"

// Scalar types with both of PLY's spellings. scale: divisor of a color of this type.
typedef enum { T_I8, T_U8, T_I16, T_U16, T_I32, T_U32, T_F32, T_F64, N_TYPES } type_id;
static const struct {
  const char *name, *alias;
  uint8_t bytes;
  double full;
} types[N_TYPES] = {{"char", "int8", 1, 127},         {"uchar", "uint8", 1, 255},
                    {"short", "int16", 2, 32767},     {"ushort", "uint16", 2, 65535},
                    {"int", "int32", 4, 2147483647.}, {"uint", "uint32", 4, 4294967295.},
                    {"float", "float32", 4, 1},       {"double", "float64", 8, 1}};

// Fields: the 59 floats of sv_gaussian in its order, but SH as the file has it (f_rest
// channel-major).
enum {
  F_X = 0,
  F_ROT = 3,
  F_SCALE = 7,
  F_OPACITY = 10,
  F_DC = 11,
  F_REST = 14,
  F_RED = 59,
  N_FIELDS = 62,
  F_NONE = 255
};

// "scale_2" with prefix "scale_" gives 2; -1 when it is not prefix and a number below 1000.
static int indexed(sv_word w, const char *prefix) {
  size_t n = strlen(prefix);
  long long v;
  if (w.n <= n || w.n > n + 3 || memcmp(w.t, prefix, n) != 0 || w.t[n] < '0' || w.t[n] > '9') return -1;
  if (w.t[n] == '0' && w.n > n + 1) return -1;
  return sv_parse_int(w.t + n, w.n - n, &v) ? (int)v : -1;
}

static int field_of(sv_word w) {
  static const struct {
    const char *name;
    int field;
  } plain[] = {{"x", F_X},
               {"y", F_X + 1},
               {"z", F_X + 2},
               {"opacity", F_OPACITY},
               {"red", F_RED},
               {"green", F_RED + 1},
               {"blue", F_RED + 2},
               {"r", F_RED},
               {"g", F_RED + 1},
               {"b", F_RED + 2},
               {"diffuse_red", F_RED},
               {"diffuse_green", F_RED + 1},
               {"diffuse_blue", F_RED + 2}};
  static const struct {
    const char *prefix;
    int field, n;
  } numbered[] = {{"f_dc_", F_DC, 3}, {"f_rest_", F_REST, 45}, {"scale_", F_SCALE, 3}, {"rot_", F_ROT, 4}};
  for (size_t i = 0; i < sizeof plain / sizeof *plain; i++)
    if (sv_word_is(w, plain[i].name)) return plain[i].field;
  for (size_t i = 0; i < sizeof numbered / sizeof *numbered; i++) {
    int k = indexed(w, numbered[i].prefix);
    if (k >= 0 && k < numbered[i].n) return numbered[i].field + k;
  }
  return F_NONE;
}

// --- header --------------------------------------------------------------------------------------
typedef struct {
  bool is_vertex, is_after, has_format, has_list, has_vertex;
  uint64_t n;                      // of the element being declared
  uint64_t stride;                 // its bytes
  uint64_t skip_bytes, skip_lines; // of finished elements before the vertices
  uint64_t seen;                   // bit per field
} header;

static sv_status bad(const sv_text *l, sv_err *err, sv_status s, const char *what, sv_word w) {
  int n = w.n > 60 ? 60 : (int)w.n;
  return sv_fail(err, s, "%s:%d: %s \"%.*s\"", l->name, l->line, what, n, w.t);
}

static sv_status end_element(sv_ply *p, header *h, const sv_text *l, sv_err *err) {
  if (h->is_vertex) {
    p->stride_bytes = (uint32_t)h->stride;
    h->is_vertex = false;
    h->is_after = true;
  } else if (!h->is_after && h->n) {
    if (h->has_list)
      return sv_fail(err, SV_E_UNSUPPORTED, "%s:%d: an element with a list comes before \"vertex\"", l->name,
                     l->line);
    if (h->n > UINT32_MAX)
      return sv_fail(err, SV_E_RANGE, "%s:%d: more than 2^32 elements", l->name, l->line);
    h->skip_bytes += h->n * h->stride;
    h->skip_lines += h->n;
    if (h->skip_bytes > 1ull << 62)
      return sv_fail(err, SV_E_RANGE, "%s:%d: too many elements", l->name, l->line);
  }
  h->n = 0;
  h->stride = 0;
  h->has_list = false;
  return SV_OK;
}

static sv_status read_element(sv_ply *p, header *h, const sv_text *l, sv_word rest, sv_err *err) {
  sv_status s = end_element(p, h, l, err);
  if (s != SV_OK) return s;
  sv_word name = sv_word_next(&rest), count = sv_word_next(&rest);
  long long n;
  if (!sv_parse_int(count.t, count.n, &n) || n < 0)
    return bad(l, err, SV_E_FORMAT, "expected a count, found", count);
  if (sv_word_is(name, "vertex")) {
    if (h->has_vertex) return bad(l, err, SV_E_FORMAT, "a second element", name);
    if (n > UINT32_MAX) return bad(l, err, SV_E_RANGE, "too many vertices:", count);
    p->n = (uint32_t)n;
    h->is_vertex = h->has_vertex = true;
  }
  h->n = (uint64_t)n;
  return SV_OK;
}

static sv_status read_property(sv_ply *p, header *h, const sv_text *l, sv_word rest, sv_err *err) {
  sv_word type = sv_word_next(&rest), name = sv_word_next(&rest);
  if (sv_word_is(type, "list")) {
    if (h->is_vertex)
      return bad(l, err, SV_E_UNSUPPORTED, "vertices with a list property are not supported:", rest);
    h->has_list = true;
    return SV_OK;
  }
  int t = 0;
  while (t < N_TYPES && !sv_word_is(type, types[t].name) && !sv_word_is(type, types[t].alias)) t++;
  if (t == N_TYPES) return bad(l, err, SV_E_FORMAT, "unknown property type", type);
  h->stride += types[t].bytes;
  if (h->stride > 4096) return bad(l, err, SV_E_RANGE, "too many properties at", name);
  if (!h->is_vertex) return SV_OK;
  if (p->n_properties == SV_PLY_CAP_PROPERTIES)
    return bad(l, err, SV_E_RANGE, "too many properties at", name);
  int f = field_of(name);
  if (f != F_NONE) {
    if (h->seen >> f & 1) return bad(l, err, SV_E_FORMAT, "a property is given twice:", name);
    h->seen |= 1ull << f;
  }
  p->property[p->n_properties++] = (sv_ply_property){(uint8_t)t, (uint8_t)f};
  return SV_OK;
}

// Whether a comment has this key; then only its value is left of it.
static bool has_key(sv_word *rest, const char *key) {
  const size_t n = strlen(key);
  if (rest->n <= n || memcmp(rest->t, key, n) != 0) return false;
  rest->t += n;
  rest->n -= n;
  return true;
}

// "#867c75" -> 0x867c75; 0 (black) for anything else.
static uint32_t color_of(sv_word v) {
  uint32_t rgb = 0;
  if (v.n != 7 || v.t[0] != '#') return 0;
  for (size_t i = 1; i < v.n; i++) {
    const char c = v.t[i];
    if (c >= '0' && c <= '9') rgb = rgb << 4 | (uint32_t)(c - '0');
    else if (c >= 'a' && c <= 'f') rgb = rgb << 4 | (uint32_t)(c - 'a' + 10);
    else return 0;
  }
  return rgb;
}

// Two that Brush writes, and our own; others are ignored.
static void read_comment(sv_ply *p, sv_word rest) {
  double x;
  while (rest.n && (*rest.t == ' ' || *rest.t == '\t')) {
    rest.t++;
    rest.n--;
  }
  if (has_key(&rest, "Vertical axis:")) {
    const sv_word v = sv_word_next(&rest);
    if (v.n && v.n < sizeof p->vertical) {
      memcpy(p->vertical, v.t, v.n);
      p->vertical[v.n] = 0;
    }
  } else if (has_key(&rest, "SplatUp:")) {
    const sv_word v = sv_word_next(&rest);
    char word[4] = "";
    double ignored[3];
    if (v.n && v.n < sizeof word) memcpy(word, v.t, v.n);
    if (sv_up_axis(word, ignored)) memcpy(p->up, word, sizeof word);
  } else if (has_key(&rest, "SplatUnit:")) {
    p->unit.is_metric = sv_word_is(sv_word_next(&rest), "m");
  } else if (has_key(&rest, "SplatScaleSigma:")) {
    const sv_word v = sv_word_next(&rest);
    if (sv_parse_double(v.t, v.n, &x) && x > 0 && x < 1) p->unit.scale_sigma = (float)x;
  } else if (has_key(&rest, "SplatRenderMode:")) {
    p->is_mip = sv_word_is(sv_word_next(&rest), "mip");
  } else if (has_key(&rest, "SplatDilation:")) {
    const sv_word v = sv_word_next(&rest);
    if (sv_parse_double(v.t, v.n, &x) && x > 0 && x < 100) p->dilation_px2 = (float)x;
  } else if (has_key(&rest, "SplatBackground:")) {
    p->background = color_of(sv_word_next(&rest));
  }
}

static bool has_all(const header *h, int field, int n) {
  uint64_t mask = ((1ull << n) - 1) << field;
  return (h->seen & mask) == mask;
}

// Points or Gaussians: a model with only some of its properties is refused, not read as points.
static sv_status decide_kind(sv_ply *p, const header *h, sv_err *err) {
  if (!has_all(h, F_X, 3)) return sv_fail(err, SV_E_NOT_FOUND, "%s: vertices have no x, y and z", p->name);
  while (p->n_rest < 45 && h->seen >> (F_REST + p->n_rest) & 1) p->n_rest++;
  uint64_t model = ((1ull << 8) - 1) << F_ROT; // rot, scale, opacity
  bool has_dc = has_all(h, F_DC, 3);
  if (h->seen & model) {
    if (!has_all(h, F_ROT, 8) || !has_dc)
      return sv_fail(err, SV_E_FORMAT,
                     "%s: not a whole 3DGS model: needs f_dc_0..2, opacity, scale_0..2 and rot_0..3",
                     p->name);
    p->kind = SV_PLY_GAUSSIANS;
    int d = 0;
    while (d < 3 && 3 * ((d + 1) * (d + 1) - 1) != p->n_rest) d++;
    uint64_t above = ((1ull << 45) - 1) >> p->n_rest << p->n_rest << F_REST; // f_rest after a gap
    if (3 * ((d + 1) * (d + 1) - 1) != p->n_rest || (h->seen & above))
      return sv_fail(err, SV_E_FORMAT, "%s: %d f_rest properties; 0, 9, 24 or 45 were expected", p->name,
                     p->n_rest);
    p->sh_degree = d;
  }
  p->has_colour = has_dc || has_all(h, F_RED, 3);
  if (p->kind == SV_PLY_POINTS) p->n_rest = 0;
  return SV_OK;
}

static sv_status read_header(sv_ply *p, sv_text *l, header *h, sv_err *err) {
  sv_word line;
  if (!sv_text_line(l, &line) || !sv_word_is(line, "ply"))
    return sv_fail(err, SV_E_FORMAT, "%s: not a PLY file: it does not start with \"ply\"", p->name);
  while (sv_text_line(l, &line)) {
    sv_word rest = line, key = sv_word_next(&rest);
    sv_status s = SV_OK;
    if (sv_word_is(key, "end_header")) {
      s = end_element(p, h, l, err);
      if (s != SV_OK) return s;
      if (!h->has_format) return sv_fail(err, SV_E_FORMAT, "%s: the header has no format line", p->name);
      if (!h->has_vertex)
        return sv_fail(err, SV_E_NOT_FOUND, "%s: the header has no element \"vertex\"", p->name);
      return decide_kind(p, h, err);
    }
    if (sv_word_is(key, "format")) {
      sv_word f = sv_word_next(&rest);
      p->is_ascii = sv_word_is(f, "ascii");
      if (!p->is_ascii && !sv_word_is(f, "binary_little_endian"))
        return bad(l, err, SV_E_UNSUPPORTED, "ascii or binary_little_endian was expected, found", f);
      if (!sv_word_is(sv_word_next(&rest), "1.0"))
        return bad(l, err, SV_E_UNSUPPORTED, "version 1.0 was expected in", line);
      h->has_format = true;
    } else if (sv_word_is(key, "element")) s = read_element(p, h, l, rest, err);
    else if (sv_word_is(key, "property")) s = read_property(p, h, l, rest, err);
    else if (sv_word_is(key, "comment")) read_comment(p, rest);
    else if (!sv_word_is(key, "obj_info") && key.n) s = bad(l, err, SV_E_FORMAT, "unknown header line", line);
    if (s != SV_OK) return s;
  }
  return sv_fail(err, SV_E_FORMAT, "%s: the header has no end_header", p->name);
}

sv_status sv_ply_open(sv_ply *p, const char *name, const void *buf, size_t bytes, sv_err *err) {
  *p = (sv_ply){.name = name, .buf = buf, .bytes = bytes};
  sv_text l = {name, buf, bytes, 0, 0};
  header h = {0};
  sv_status s = read_header(p, &l, &h, err);
  if (s != SV_OK) return s;
  if (p->is_ascii) {
    sv_word line;
    for (uint64_t i = 0; i < h.skip_lines;) {
      if (!sv_text_line(&l, &line))
        return sv_fail(err, SV_E_FORMAT, "%s: the file ends before its vertices", name);
      i += sv_word_next(&line).n > 0;
    }
  } else {
    uint64_t room = bytes - l.at, need = (uint64_t)p->n * p->stride_bytes;
    if (h.skip_bytes > room) return sv_fail(err, SV_E_FORMAT, "%s: the file ends before its vertices", name);
    l.at += (size_t)h.skip_bytes;
    room -= h.skip_bytes;
    if (need > room)
      return sv_fail(err, SV_E_FORMAT, "%s: %u vertices of %u bytes were expected, the file ends after %u",
                     name, p->n, p->stride_bytes, (unsigned)(room / p->stride_bytes));
  }
  p->data_at = p->at = l.at;
  return SV_OK;
}

// --- vertices ------------------------------------------------------------------------------------
static double scalar(const uint8_t *b, int type) {
  switch (type) {
  case T_I8: return (int8_t)b[0];
  case T_U8: return b[0];
  case T_I16: return (int16_t)sv_le16(b);
  case T_U16: return sv_le16(b);
  case T_I32: return (int32_t)sv_le32(b);
  case T_U32: return sv_le32(b);
  case T_F32: return (double)sv_lef32(b);
  default: return sv_lef64(b);
  }
}

static bool ascii_value(sv_word w, double *v) {
  if (sv_parse_double(w.t, w.n, v)) return true;
  bool neg = w.n && w.t[0] == '-';
  if (w.n && (w.t[0] == '-' || w.t[0] == '+')) {
    w.t++;
    w.n--;
  }
  if (sv_word_is(w, "inf") || sv_word_is(w, "Infinity")) *v = neg ? -INFINITY : INFINITY;
  else if (sv_word_is(w, "nan") || sv_word_is(w, "NaN")) *v = NAN;
  else return false;
  return true;
}

static sv_status ascii_line(sv_ply *p, uint32_t i, sv_word *line, sv_err *err) {
  if (i < p->i_next) {
    p->i_next = 0;
    p->at = p->data_at;
  }
  sv_text l = {p->name, p->buf, p->bytes, p->at, 0};
  for (sv_word w = {NULL, 0}; p->i_next <= i;) {
    if (!sv_text_line(&l, line))
      return sv_fail(err, SV_E_FORMAT, "%s: %u vertices were expected, the file ends after %u", p->name, p->n,
                     p->i_next);
    w = *line;
    p->i_next += sv_word_next(&w).n > 0;
    p->at = l.at;
  }
  return SV_OK;
}

// All known fields of vertex i; colours of integer types divided by their full range.
static sv_status read_fields(sv_ply *p, uint32_t i, double out[N_FIELDS], sv_err *err) {
  if (i >= p->n) return sv_fail(err, SV_E_ARG, "%s: vertex %u requested, the file has %u", p->name, i, p->n);
  for (int f = 0; f < N_FIELDS; f++) out[f] = 0;
  const uint8_t *b = p->buf + p->data_at + (size_t)i * p->stride_bytes;
  sv_word line = {NULL, 0};
  if (p->is_ascii) {
    sv_status s = ascii_line(p, i, &line, err);
    if (s != SV_OK) return s;
  }
  for (int k = 0; k < p->n_properties; k++) {
    int type = p->property[k].type, f = p->property[k].field;
    double v = 0;
    if (p->is_ascii) {
      sv_word w = sv_word_next(&line);
      if (!w.n)
        return sv_fail(err, SV_E_FORMAT, "%s: vertex %u has %d values, %d were expected", p->name, i, k,
                       p->n_properties);
      if (!ascii_value(w, &v))
        return sv_fail(err, SV_E_FORMAT, "%s: vertex %u: \"%.*s\" is not a number", p->name, i,
                       w.n > 40 ? 40 : (int)w.n, w.t);
    } else {
      if (f != F_NONE) v = scalar(b, type);
      b += types[type].bytes;
    }
    if (f == F_NONE) continue;
    if (f == F_OPACITY) v = v == INFINITY ? 15 : v == -INFINITY ? -15 : v;
    if (f >= F_SCALE && f < F_SCALE + 3 && v == -INFINITY) v = -30;
    if (!(fabs(v) <= (double)FLT_MAX))
      return sv_fail(err, SV_E_RANGE, "%s: vertex %u has a value that is not finite", p->name, i);
    out[f] = f >= F_RED ? v / types[type].full : v;
  }
  if (p->is_ascii && sv_word_next(&line).n)
    return sv_fail(err, SV_E_FORMAT, "%s: vertex %u has more than %d values", p->name, i, p->n_properties);
  return SV_OK;
}

sv_status sv_ply_read_gaussian(sv_ply *p, uint32_t i, sv_gaussian *g, sv_err *err) {
  double f[N_FIELDS];
  if (p->kind != SV_PLY_GAUSSIANS)
    return sv_fail(err, SV_E_FORMAT, "%s: holds points; a 3DGS model was expected", p->name);
  sv_status s = read_fields(p, i, f, err);
  if (s != SV_OK) return s;
  *g = (sv_gaussian){{0}, {0}, {0}, (float)f[F_OPACITY], {{0}}};
  bool is_zero = true;
  for (int k = 0; k < 4; k++) {
    g->quat_wxyz[k] = (float)f[F_ROT + k];
    is_zero = is_zero && f[F_ROT + k] == 0;
  }
  if (is_zero) return sv_fail(err, SV_E_RANGE, "%s: vertex %u has a rotation of all zeros", p->name, i);
  int per_channel = p->n_rest / 3;
  for (int c = 0; c < 3; c++) {
    g->mean[c] = (float)f[F_X + c];
    g->log_scale[c] = (float)f[F_SCALE + c];
    g->sh[0][c] = (float)f[F_DC + c];
    for (int k = 0; k < per_channel; k++) g->sh[1 + k][c] = (float)f[F_REST + c * per_channel + k];
  }
  return SV_OK;
}

sv_status sv_ply_read_point(sv_ply *p, uint32_t i, float xyz[3], float rgb[3], sv_err *err) {
  double f[N_FIELDS];
  sv_status s = read_fields(p, i, f, err);
  if (s != SV_OK) return s;
  bool has_red = false;
  for (int k = 0; k < p->n_properties; k++) has_red = has_red || p->property[k].field == F_RED;
  for (int c = 0; c < 3; c++) {
    double v = !p->has_colour                        ? 0.5
               : has_red && p->kind == SV_PLY_POINTS ? f[F_RED + c]
                                                     : 0.5 + SV_SH_C0 * f[F_DC + c];
    rgb[c] = (float)(v < 0 ? 0 : v > 1 ? 1 : v);
    xyz[c] = (float)f[F_X + c];
  }
  return SV_OK;
}
