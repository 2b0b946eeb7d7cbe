// SPDX-License-Identifier: Apache-2.0
#include "src/format/cameramodel.h"

#include <math.h>
#include <string.h>

#include "src/rig/limits.h"

#define CAP_DEPTH 16

typedef enum { T_END, T_STRING, T_BYTES, T_NUMBER, T_WORD, T_PUNCT } token_kind;

typedef struct {
  const char *name, *text;
  size_t bytes, at;
  int line;
  // the last token: text[from..to); for strings without quotes and prefix
  token_kind kind;
  size_t from, to;
  sv_err *err;
} lexer;

static sv_status bad(const lexer *l, const char *what) {
  return sv_fail(l->err, SV_E_FORMAT, "%s:%d: %s", l->name, l->line, what);
}

static char peek(const lexer *l, size_t ahead) {
  return l->bytes - l->at > ahead ? l->text[l->at + ahead] : 0;
}

static void skip_blank(lexer *l) {
  for (; l->at < l->bytes; l->at++) {
    char c = l->text[l->at];
    if (c == '#')
      while (l->at + 1 < l->bytes && l->text[l->at + 1] != '\n') l->at++;
    else if (c == '\n') l->line++;
    else if (c != ' ' && c != '\t' && c != '\r') return;
  }
}

static bool is_letter(char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_'; }
static bool is_digit(char c) { return c >= '0' && c <= '9'; }

// A quoted string with one or three quotes of either kind. Backslashes are kept: the strings used
// here hold none.
static sv_status read_string(lexer *l) {
  char q = l->text[l->at];
  size_t n_quotes = peek(l, 1) == q && peek(l, 2) == q ? 3 : 1, run = 0;
  l->at += n_quotes;
  l->from = l->at;
  for (; l->at < l->bytes; l->at++) {
    char c = l->text[l->at];
    if (c == '\\') {
      if (++l->at == l->bytes) break;
      if (l->text[l->at] == '\n') l->line++;
      run = 0;
      continue;
    }
    if (c == '\n') {
      if (n_quotes == 1) return bad(l, "a string does not end on its line");
      l->line++;
    }
    run = c == q ? run + 1 : 0;
    if (run == n_quotes) {
      l->to = l->at + 1 - n_quotes;
      l->at++;
      return SV_OK;
    }
  }
  return bad(l, "a string has no end");
}

static sv_status next(lexer *l) {
  skip_blank(l);
  l->from = l->to = l->at;
  if (l->at == l->bytes) {
    l->kind = T_END;
    return SV_OK;
  }
  char c = l->text[l->at];
  if (strchr("bBrRuU", c) && c) { // a prefixed string?
    size_t n = 1;
    while (n < 2 && peek(l, n) && strchr("bBrR", peek(l, n))) n++;
    if (peek(l, n) == '\'' || peek(l, n) == '"') {
      bool is_bytes = (c | 32) == 'b' || (n == 2 && (peek(l, 1) | 32) == 'b');
      l->at += n;
      l->kind = is_bytes ? T_BYTES : T_STRING;
      return read_string(l);
    }
  }
  if (c == '\'' || c == '"') {
    l->kind = T_STRING;
    return read_string(l);
  }
  if (is_letter(c)) {
    while (is_letter(peek(l, 0)) || is_digit(peek(l, 0))) l->at++;
    l->kind = T_WORD;
  } else if (is_digit(c) || c == '-' || c == '+' || c == '.') {
    for (l->at++; l->at < l->bytes; l->at++) {
      char d = l->text[l->at], before = l->text[l->at - 1];
      if (!is_digit(d) && d != '.' && (d | 32) != 'e' && !((d == '-' || d == '+') && (before | 32) == 'e'))
        break;
    }
    double v;
    l->kind = T_NUMBER;
    if (!sv_parse_double(l->text + l->from, l->at - l->from, &v))
      return bad(l, "a malformed or too large number");
  } else if (c && strchr("{}[]():,", c)) {
    l->at++;
    l->kind = T_PUNCT;
  } else return bad(l, "an unexpected character");
  l->to = l->at;
  return SV_OK;
}

static bool is_punct(const lexer *l, char c) { return l->kind == T_PUNCT && l->text[l->from] == c; }
static bool is_text(const lexer *l, const char *s) {
  return strlen(s) == l->to - l->from && memcmp(s, l->text + l->from, l->to - l->from) == 0;
}
static bool is_scalar(const lexer *l) {
  return l->kind == T_STRING || l->kind == T_BYTES || l->kind == T_NUMBER ||
         (l->kind == T_WORD && (is_text(l, "True") || is_text(l, "False") || is_text(l, "None")));
}

// Skips one value, from its first token to the token after it. Adjacent literals ('a' 'b') are one
// value.
static sv_status skip_value(lexer *l) {
  char stack[CAP_DEPTH];
  int depth = 0;
  bool is_needed = false; // a value must follow: after ':'
  do {
    sv_status s = SV_OK;
    if (l->kind == T_PUNCT && strchr("{[(", l->text[l->from])) {
      if (depth == CAP_DEPTH) return bad(l, "nested too deeply");
      char c = l->text[l->from];
      stack[depth++] = c == '{' ? '}' : c == '[' ? ']' : ')';
      is_needed = false;
      s = next(l);
      if (s != SV_OK) return s;
      continue;
    }
    if (depth && !is_needed && is_punct(l, stack[depth - 1])) {
      depth--;
      s = next(l);
    } else if (is_scalar(l)) {
      token_kind kind = l->kind;
      s = next(l);
      while (s == SV_OK && (kind == T_STRING || kind == T_BYTES) && l->kind == kind) s = next(l);
    } else return bad(l, "a value was expected");
    if (s != SV_OK) return s;
    if (!depth) return SV_OK;
    is_needed = stack[depth - 1] == '}' && is_punct(l, ':');
    if (is_punct(l, ',') || is_needed) s = next(l);
    else if (!is_punct(l, stack[depth - 1])) return bad(l, "',' or a closing bracket was expected");
    if (s != SV_OK) return s;
  } while (depth);
  return SV_OK;
}

// [n numbers] into out[cap]; the lexer is at the bracket, and afterwards behind the list.
static sv_status read_numbers(lexer *l, double *out, int cap, int *n) {
  if (!is_punct(l, '[') && !is_punct(l, '(')) return bad(l, "a list of numbers was expected");
  char close = is_punct(l, '[') ? ']' : ')';
  sv_status s = next(l);
  for (*n = 0; s == SV_OK && !is_punct(l, close); s = next(l)) {
    if (l->kind != T_NUMBER) return bad(l, "a number was expected in the list");
    if (*n == cap) return bad(l, "the list is longer than any known lens model needs");
    if (!sv_parse_double(l->text + l->from, l->to - l->from, &out[(*n)++]))
      return bad(l, "a malformed number");
    s = next(l);
    if (s != SV_OK) return s;
    if (is_punct(l, close)) break;
    if (!is_punct(l, ',')) return bad(l, "',' or the list's end was expected");
  }
  return s == SV_OK ? next(l) : s;
}

typedef struct {
  bool has_model, has_intrinsics, has_extrinsics, has_size;
  sv_model_kind kind;
  sv_lens_spline spline;
  double *splined; // its intrinsics, then its control points
  sv_arena *arena; // may be NULL
  int n_intrinsics;
  double intrinsics[SV_CAP_MODEL_PARAMS], extrinsics[6], size[2];
} dict;

// "_order=3_Nx=30_Ny=18_fov_x_deg=150" behind the model's name
static bool read_config(const char *text, sv_lens_spline *s) {
  static const char *const keys[4] = {"_order=", "_Nx=", "_Ny=", "_fov_x_deg="};
  long long v[4];
  for (int k = 0; k < 4; k++) {
    size_t n = strlen(keys[k]), w = 0;
    if (strncmp(text, keys[k], n) != 0) return false;
    text += n;
    while (text[w] && text[w] != '_') w++;
    if (!sv_parse_int(text, w, &v[k])) return false;
    text += w;
  }
  *s =
      (sv_lens_spline){.order = 2 + (v[0] == 3), .nx = (int)v[1], .ny = (int)v[2], .fov_x_deg = (double)v[3]};
  return !*text && (v[0] == 2 || v[0] == 3) && v[1] > v[0] && v[2] > v[0] && v[1] <= SV_CAP_SPLINE_SIDE &&
         v[2] <= SV_CAP_SPLINE_SIDE && v[3] > 0 && v[3] < 360;
}

static sv_status read_splined(lexer *l, dict *d, const char *config) {
  if (d->has_intrinsics) return bad(l, "the lens model of a splined lens must stand before its intrinsics");
  if (!read_config(config, &d->spline))
    return bad(l, "_order=2 or 3, _Nx=, _Ny= (order + 1 to 256) and _fov_x_deg= (1 to 359) were expected");
  if (!d->arena) return bad(l, "a splined lens cannot be used here");
  size_t n = 4 + 2 * (size_t)d->spline.nx * (size_t)d->spline.ny;
  d->splined = SV_TAKE(d->arena, double, n);
  if (!d->splined) return bad(l, "no memory is left for the lens's control points");
  d->kind = SV_MODEL_SPLINED;
  d->has_model = true;
  return next(l);
}

static sv_status read_lensmodel(lexer *l, dict *d) {
  char model[96];
  const char *spline = sv_model_name(SV_MODEL_SPLINED);
  size_t n = l->to - l->from;
  if (d->has_model || l->kind != T_STRING || n >= sizeof model)
    return bad(l, "one lens model's name was expected");
  memcpy(model, l->text + l->from, n);
  model[n] = 0;
  if (strncmp(model, spline, strlen(spline)) == 0) return read_splined(l, d, model + strlen(spline));
  if (!sv_model_by_name(model, &d->kind))
    return sv_fail(
        l->err, SV_E_UNSUPPORTED,
        "%s:%d: %s is not supported; LENSMODEL_PINHOLE, OPENCV4, 5, 8, KB4 and SPLINED_STEREOGRAPHIC are",
        l->name, l->line, model);
  d->has_model = true;
  return next(l);
}

static sv_status read_entry(lexer *l, dict *d) { // at the key
  size_t from = l->from, to = l->to;
  if (l->kind != T_STRING) return bad(l, "a key in quotes was expected");
  sv_status s = next(l);
  if (s != SV_OK) return s;
  if (!is_punct(l, ':')) return bad(l, "':' was expected after a key");
  s = next(l);
  if (s != SV_OK) return s;
  lexer key = {.text = l->text, .from = from, .to = to};
  int n = 0;
  if (is_text(&key, "lensmodel")) return read_lensmodel(l, d);
  if (is_text(&key, "intrinsics")) {
    if (d->has_intrinsics) return bad(l, "intrinsics are given twice");
    d->has_intrinsics = true;
    if (!d->splined) return read_numbers(l, d->intrinsics, SV_CAP_MODEL_PARAMS, &d->n_intrinsics);
    return read_numbers(l, d->splined, 4 + 2 * d->spline.nx * d->spline.ny, &d->n_intrinsics);
  }
  if (is_text(&key, "extrinsics") || is_text(&key, "rt_cam_ref")) {
    if (d->has_extrinsics) return bad(l, "extrinsics are given twice");
    d->has_extrinsics = true;
    s = read_numbers(l, d->extrinsics, 6, &n);
    return s == SV_OK && n != 6 ? bad(l, "extrinsics need 6 numbers") : s;
  }
  if (is_text(&key, "imagersize")) {
    if (d->has_size) return bad(l, "imagersize is given twice");
    d->has_size = true;
    s = read_numbers(l, d->size, 2, &n);
    return s == SV_OK && n != 2 ? bad(l, "imagersize needs width and height") : s;
  }
  return skip_value(l);
}

static sv_status check(const lexer *l, const dict *d) {
  const char *missing = !d->has_model        ? "lensmodel"
                        : !d->has_intrinsics ? "intrinsics"
                        : !d->has_extrinsics ? "extrinsics"
                        : !d->has_size       ? "imagersize"
                                             : NULL;
  if (missing) return sv_fail(l->err, SV_E_NOT_FOUND, "%s: \"%s\" is missing", l->name, missing);
  int n = d->splined ? 4 + 2 * d->spline.nx * d->spline.ny : sv_model_n_params(d->kind);
  const double *p = d->splined ? d->splined : d->intrinsics;
  if (d->n_intrinsics != n)
    return sv_fail(l->err, SV_E_FORMAT, "%s: %s has %d intrinsics, %d were expected", l->name,
                   sv_model_name(d->kind), d->n_intrinsics, n);
  for (int i = 0; i < 2; i++)
    if (!(d->size[i] >= 1 && d->size[i] <= SV_CAP_IMAGE_SIDE_PX && d->size[i] == floor(d->size[i])))
      return sv_fail(l->err, SV_E_RANGE, "%s: imagersize %g is not a whole number of 1 to 32767", l->name,
                     d->size[i]);
  for (int i = 4; d->splined && i < n; i++) // the others are checked with the model
    if (!(fabs(p[i]) < 1e12))
      return sv_fail(l->err, SV_E_RANGE, "%s: a control point is out of range", l->name);
  for (int i = 0; i < 6; i++) // a rotation vector of many turns is a mistake of units
    if (!(fabs(d->extrinsics[i]) < (i < 3 ? 100 : 1e12)))
      return sv_fail(l->err, SV_E_RANGE, "%s: extrinsics %g is out of range", l->name, d->extrinsics[i]);
  return SV_OK;
}

sv_status sv_cameramodel_read(const sv_file_data *file, sv_camera_model *model, sv_pose *cam_from_ref,
                              sv_err *err) {
  return sv_cameramodel_read_splined(file, NULL, model, cam_from_ref, err);
}

static void take_model(const dict *d, sv_camera_model *model) {
  *model = (sv_camera_model){.kind = d->kind, .width_px = (int)d->size[0], .height_px = (int)d->size[1]};
  const double *p = d->splined ? d->splined : d->intrinsics;
  int n = d->splined ? 4 : d->n_intrinsics;
  for (int i = 0; i < n; i++) model->p[i] = p[i] + (i == 2 || i == 3 ? 0.5 : 0);
  model->spline = d->spline;
  if (d->splined) model->spline.control = d->splined + 4;
}

sv_status sv_cameramodel_read_splined(const sv_file_data *file, sv_arena *splines, sv_camera_model *model,
                                      sv_pose *cam_from_ref, sv_err *err) {
  lexer l = {.name = file->name, .text = file->data, .bytes = file->bytes, .line = 1, .err = err};
  dict d = {.arena = splines};
  sv_status s = next(&l);
  if (s != SV_OK) return s;
  if (!is_punct(&l, '{')) return bad(&l, "not a .cameramodel: '{' was expected");
  s = next(&l);
  while (s == SV_OK && !is_punct(&l, '}')) {
    s = read_entry(&l, &d);
    if (s != SV_OK) return s;
    if (is_punct(&l, '}')) break;
    if (!is_punct(&l, ',')) return bad(&l, "',' or '}' was expected");
    s = next(&l);
  }
  if (s == SV_OK) s = next(&l);
  if (s != SV_OK) return s;
  if (l.kind != T_END) return bad(&l, "text after the end");
  s = check(&l, &d);
  if (s != SV_OK) return s;
  take_model(&d, model);
  sv_rodrigues(cam_from_ref->r, d.extrinsics);
  for (int i = 0; i < 3; i++) cam_from_ref->t[i] = d.extrinsics[3 + i];
  s = sv_limits_check_camera(model, file->name, err);
  return s < 0 ? s : sv_limits_check_pose(cam_from_ref, file->name, err);
}

sv_status sv_cameramodel_write(sv_str *out, const sv_camera_model *model, const sv_pose *cam_from_ref) {
  double rt[6];
  sv_rodrigues_inv(rt, cam_from_ref->r);
  for (int i = 0; i < 3; i++) rt[3 + i] = cam_from_ref->t[i];
  sv_str_add(out, "{\n    'lensmodel': '%s", sv_model_name(model->kind));
  const sv_lens_spline *s = &model->spline;
  bool is_splined = model->kind == SV_MODEL_SPLINED;
  if (is_splined)
    sv_str_add(out, "_order=%d_Nx=%d_Ny=%d_fov_x_deg=%d", s->order, s->nx, s->ny, (int)s->fov_x_deg);
  sv_str_add(out, "',\n\n    'intrinsics': [");
  for (int i = 0; i < sv_model_n_params(model->kind); i++)
    // mrcal's centres are at integers
    sv_str_add(out, " %.17g,", model->p[i] - (i == 2 || i == 3 ? 0.5 : 0));
  for (int i = 0; is_splined && i < 2 * s->nx * s->ny; i++) sv_str_add(out, " %.17g,", s->control[i]);
  sv_str_add(out, "],\n\n    # camera from reference: rotation vector, translation\n    'extrinsics': [");
  for (int i = 0; i < 6; i++) sv_str_add(out, " %.17g,", rt[i]);
  sv_str_add(out, "],\n\n    'imagersize': [ %d, %d,],\n}\n", model->width_px, model->height_px);
  return out->is_cut ? SV_E_NOMEM : SV_OK;
}
