// SPDX-License-Identifier: Apache-2.0
#include "src/format/kalibr.h"

#include <math.h>
#include <string.h>

#include "src/base/str.h"
#include "src/rig/limits.h"
#include "src/format/text.h"

typedef enum { K_MODEL, K_INTRINSICS, K_LENS, K_COEFFS, K_SIZE, K_POSE, N_KEYS, K_OTHER, K_NONE } key;

static const struct {
  const char *name;
  int n; // count of numbers (also for lenses that are refused by name later); 0: a word
} keys[N_KEYS] = {{"camera_model", 0},      {"intrinsics", 6}, {"distortion_model", 0},
                  {"distortion_coeffs", 5}, {"resolution", 2}, {"T_cn_cnm1", 16}};

typedef struct {
  sv_text text;
  sv_rig *rig;
  sv_err *err;
  bool is_outside; // below a top-level key that is not a camera
  // The camera being read
  int i_camera, indent; // -1: none yet; of its keys, 0: not known yet
  int n[N_KEYS];        // values of each key; -1: the key is absent
  char model[24], lens[24];
  double intrinsics[6], coeffs[5], size[2], pose[16];
  // The entry being read
  key at;
  int line, depth; // where it began; open brackets
} reader;

static sv_status fail_at(const reader *r, int line, sv_status s, const char *what) {
  return sv_fail(r->err, s, "%s:%d: %s", r->text.name, line, what);
}

static double *numbers(reader *r, key k) {
  return k == K_INTRINSICS ? r->intrinsics : k == K_COEFFS ? r->coeffs : k == K_SIZE ? r->size : r->pose;
}

static sv_status fail_key(const reader *r, key k, sv_status s, const char *what) {
  return sv_fail(r->err, s, "%s:%d: cam%d: %s: %s", r->text.name, r->line, r->i_camera, keys[k].name, what);
}

// --- values --------------------------------------------------------------------------------------

static sv_status take_value(reader *r, sv_word w) {
  if (r->at >= N_KEYS) return SV_OK;
  int *n = &r->n[r->at];
  if (keys[r->at].n) {
    if (*n == keys[r->at].n) return fail_key(r, r->at, SV_E_FORMAT, "too many numbers");
    double v;
    if (!sv_parse_double(w.t, w.n, &v) || !(fabs(v) < 1e12))
      return fail_key(r, r->at, SV_E_FORMAT, "a number was expected");
    numbers(r, r->at)[(*n)++] = v;
    return SV_OK;
  }
  char *to = r->at == K_MODEL ? r->model : r->lens;
  if ((*n)++ || r->depth) return fail_key(r, r->at, SV_E_FORMAT, "one word was expected");
  if (w.n > 2 && (*w.t == '\'' || *w.t == '"') && w.t[w.n - 1] == *w.t) {
    w.t++;
    w.n -= 2;
  }
  if (w.n >= sizeof r->model) w.n = sizeof r->model - 1; // longer than any word that is known
  memcpy(to, w.t, w.n);
  to[w.n] = 0;
  return SV_OK;
}

// Words of a value: brackets and commas are read as such where a value may begin, and inside lists.
static sv_status take_values(reader *r, sv_word line) {
  for (size_t i = 0, end; i < line.n; i = end) {
    char c = line.t[i];
    end = i + 1;
    if (c == ' ' || c == '\t' || (c == ',' && r->depth)) continue;
    // a comment
    if (c == '#' && (i == 0 || line.t[i - 1] == ' ' || line.t[i - 1] == '\t')) return SV_OK;
    // an item of a list
    if (c == '-' && !r->depth && (end == line.n || line.t[end] == ' ')) continue;
    if (c == '[') {
      if (++r->depth > 8) return fail_at(r, r->text.line, SV_E_FORMAT, "lists are nested more than 8 deep");
      continue;
    }
    if (c == ']') {
      if (--r->depth < 0) return fail_at(r, r->text.line, SV_E_FORMAT, "']' without a '['");
      continue;
    }
    if (c == '\'' || c == '"') {
      while (end < line.n && line.t[end] != c) end++;
      if (end == line.n) return fail_at(r, r->text.line, SV_E_FORMAT, "a quote is not closed in its line");
      end++;
    } else {
      while (end < line.n && line.t[end] != ' ' && line.t[end] != '\t' &&
             !(r->depth && (line.t[end] == ',' || line.t[end] == '[' || line.t[end] == ']')))
        end++;
    }
    sv_status s = take_value(r, (sv_word){line.t + i, end - i});
    if (s != SV_OK) return s;
  }
  return SV_OK;
}

// --- cameras -------------------------------------------------------------------------------------

#define CAP_PLACE 256

static const char *place_of(const reader *r, char out[CAP_PLACE]) {
  sv_fmt(out, CAP_PLACE, "%s: cam%d", r->text.name, r->i_camera);
  return out;
}

static sv_status set_lens(reader *r, sv_camera_model *m) {
  bool is_radtan = sv_str_eq(r->lens, "radtan"), is_fisheye = sv_str_eq(r->lens, "equidistant");
  if (!sv_str_eq(r->model, "pinhole"))
    return sv_fail(
        r->err, SV_E_UNSUPPORTED,
        "%s: cam%d: camera_model %s is not supported; calibrate with pinhole-radtan or pinhole-equi",
        r->text.name, r->i_camera, r->model);
  if (!is_radtan && !is_fisheye && !sv_str_eq(r->lens, "none"))
    return sv_fail(
        r->err, SV_E_UNSUPPORTED,
        "%s: cam%d: distortion_model %s is not supported; radtan, equidistant or none was expected",
        r->text.name, r->i_camera, r->lens);
  int n = is_radtan || is_fisheye ? 4 : 0;
  if (r->n[K_INTRINSICS] != 4 || r->n[K_COEFFS] != n || r->n[K_SIZE] != 2)
    return sv_fail(r->err, SV_E_FORMAT,
                   "%s: cam%d: 4 intrinsics, %d distortion_coeffs and 2 numbers of resolution were expected, "
                   "there are %d, %d and %d",
                   r->text.name, r->i_camera, n, r->n[K_INTRINSICS], r->n[K_COEFFS], r->n[K_SIZE]);
  for (int k = 0; k < 2; k++) {
    if (!(r->size[k] >= 1 && r->size[k] <= SV_CAP_IMAGE_SIDE_PX && r->size[k] == floor(r->size[k])))
      return sv_fail(r->err, SV_E_RANGE, "%s: cam%d: resolution: whole numbers from 1 to 32767 were expected",
                     r->text.name, r->i_camera);
  }
  *m = (sv_camera_model){.kind = is_radtan    ? SV_MODEL_OPENCV4
                                 : is_fisheye ? SV_MODEL_KB4
                                              : SV_MODEL_PINHOLE,
                         .width_px = (int)r->size[0],
                         .height_px = (int)r->size[1]};
  for (int k = 0; k < 4; k++) m->p[k] = r->intrinsics[k] + (k < 2 ? 0 : 0.5);
  for (int k = 0; k < n; k++) m->p[4 + k] = r->coeffs[k];
  char place[CAP_PLACE];
  return sv_limits_check_camera(m, place_of(r, place), r->err);
}

// T_cn_cnm1, until all cameras are there.
static sv_status set_pose(reader *r, sv_pose *out) {
  static const double last_row[4] = {0, 0, 0, 1};
  double q[4];
  if (r->n[K_POSE] != 16)
    return sv_fail(r->err, SV_E_FORMAT, "%s: cam%d: T_cn_cnm1: 4 x 4 numbers were expected, there are %d",
                   r->text.name, r->i_camera, r->n[K_POSE]);
  for (int i = 0; i < 3; i++) {
    for (int k = 0; k < 3; k++) out->r[3 * i + k] = r->pose[4 * i + k];
    out->t[i] = r->pose[4 * i + 3];
  }
  bool is_rigid = sv_rotation_error(out->r) < 1e-3;
  for (int k = 0; k < 4; k++) is_rigid = is_rigid && fabs(r->pose[12 + k] - last_row[k]) < 1e-9;
  if (!is_rigid)
    return sv_fail(r->err, SV_E_RANGE,
                   "%s: cam%d: T_cn_cnm1: a rotation and a translation above the row 0 0 0 1 were expected",
                   r->text.name, r->i_camera);
  sv_quat_from_mat(q, out->r); // removes the file's rounding
  sv_quat_to_mat(out->r, q);
  return SV_OK;
}

static sv_status end_entry(reader *r) {
  if (r->depth) return fail_at(r, r->line, SV_E_FORMAT, "a list is not closed");
  r->at = K_NONE;
  return SV_OK;
}

static sv_status end_camera(reader *r) {
  char place[CAP_PLACE];
  sv_status s = end_entry(r);
  if (s != SV_OK || r->i_camera < 0) return s;
  sv_sub_view *v = &r->rig->sub_views[r->i_camera];
  for (int k = 0; k < N_KEYS; k++) {
    if (k == K_POSE && r->i_camera == 0) continue;
    if (r->n[k] < 0 || (!keys[k].n && r->n[k] == 0))
      return sv_fail(r->err, SV_E_NOT_FOUND, "%s: cam%d: %s is missing", r->text.name, r->i_camera,
                     keys[k].name);
  }
  if (r->i_camera == 0 && r->n[K_POSE] >= 0)
    return sv_fail(r->err, SV_E_FORMAT, "%s: cam0: T_cn_cnm1 has no camera before it", r->text.name);
  s = set_lens(r, &v->model);
  v->cam_from_rig = sv_pose_identity();
  if (s == SV_OK && r->i_camera > 0) s = set_pose(r, &v->cam_from_rig);
  if (s == SV_OK) s = sv_limits_check_pose(&v->cam_from_rig, place_of(r, place), r->err);
  sv_fmt(v->name, sizeof v->name, "cam%d", r->i_camera);
  v->i_camera = r->i_camera;
  r->i_camera = -1;
  return s;
}

// --- lines ---------------------------------------------------------------------------------------

// Splits "key: value"; false when the line has another form.
static bool split_key(sv_word line, sv_word *k, sv_word *value) {
  size_t i = 0;
  while (i < line.n && line.t[i] != ':' && line.t[i] != ' ') i++;
  if (i == 0 || i == line.n || line.t[i] != ':') return false;
  if (i + 1 < line.n && line.t[i + 1] != ' ' && line.t[i + 1] != '\t') return false;
  *k = (sv_word){line.t, i};
  *value = (sv_word){line.t + i + 1, line.n - i - 1};
  return true;
}

static sv_status begin_camera(reader *r, sv_word line) {
  sv_word k, value;
  long long i = -1;
  sv_status s = end_camera(r);
  if (s != SV_OK) return s;
  r->is_outside = true;
  if ((line.n >= 5 && memcmp(line.t, "%YAML", 5) == 0) || sv_word_is(line, "---") || sv_word_is(line, "..."))
    return SV_OK;
  if (!split_key(line, &k, &value))
    return fail_at(r, r->text.line, SV_E_FORMAT, "cam0:, cam1:, ... was expected at the left margin");
  r->at = K_OTHER;
  r->line = r->text.line;
  if (k.n < 4 || memcmp(k.t, "cam", 3) != 0 || !sv_parse_int(k.t + 3, k.n - 3, &i))
    return take_values(r, value);
  if (i < 0 || i >= r->rig->cap_sub_views)
    return sv_fail(r->err, SV_E_FULL, "%s:%d: a camera number outside 0 to %d", r->text.name, r->text.line,
                   r->rig->cap_sub_views - 1);
  if (*r->rig->sub_views[i].name)
    return sv_fail(r->err, SV_E_FORMAT, "%s:%d: cam%lld is given twice", r->text.name, r->text.line, i);
  while (value.n && (*value.t == ' ' || *value.t == '\t')) {
    value.t++;
    value.n--;
  }
  if (value.n && *value.t != '#')
    return fail_at(r, r->text.line, SV_E_FORMAT, "the camera's keys were expected on lines of their own");
  r->is_outside = false;
  r->at = K_NONE;
  r->i_camera = (int)i;
  r->indent = 0;
  if (i >= r->rig->n_sub_views) r->rig->n_sub_views = (int)i + 1;
  for (int j = 0; j < N_KEYS; j++) r->n[j] = -1;
  return SV_OK;
}

static sv_status begin_entry(reader *r, sv_word line) {
  sv_word k, value;
  int i = 0;
  sv_status s = end_entry(r);
  if (s != SV_OK) return s;
  if (!split_key(line, &k, &value)) return fail_at(r, r->text.line, SV_E_FORMAT, "'key: value' was expected");
  while (i < N_KEYS && !sv_word_is(k, keys[i].name)) i++;
  r->at = i < N_KEYS ? (key)i : K_OTHER;
  r->line = r->text.line;
  if (i < N_KEYS && r->n[i] >= 0) return fail_key(r, r->at, SV_E_FORMAT, "it is given twice");
  if (i < N_KEYS) r->n[i] = 0;
  return take_values(r, value);
}

static sv_status take_line(reader *r, sv_word line) {
  if (r->depth) return take_values(r, line); // a list goes on
  int indent = 0;
  while (line.n && *line.t == ' ') {
    line.t++;
    line.n--;
    indent++;
  }
  if (!line.n || *line.t == '#') return SV_OK;
  bool is_item = *line.t == '-' && (line.n == 1 || line.t[1] == ' ');
  if (indent == 0 && !(is_item && r->at != K_NONE)) return begin_camera(r, line);
  if (r->is_outside) return take_values(r, line);
  if (r->i_camera < 0) return fail_at(r, r->text.line, SV_E_FORMAT, "cam0: was expected before its keys");
  if (is_item || (r->at == K_OTHER && indent > r->indent)) {
    if (r->at == K_NONE) return fail_at(r, r->text.line, SV_E_FORMAT, "a list without a key before it");
    return take_values(r, line);
  }
  if (!r->indent) r->indent = indent;
  if (indent != r->indent)
    return fail_at(r, r->text.line, SV_E_FORMAT, "a key with the indent of the keys above was expected");
  return begin_entry(r, line);
}

sv_status sv_kalibr_read(sv_rig *rig, const char *name, const char *text, size_t bytes, sv_err *err) {
  reader r = {.text = {.name = name, .buf = (const uint8_t *)text, .bytes = bytes},
              .rig = rig,
              .err = err,
              .i_camera = -1,
              .at = K_NONE};
  sv_word line;
  sv_status s = SV_OK;
  for (int i = 0; i < rig->cap_sub_views; i++) rig->sub_views[i] = (sv_sub_view){.i_camera = 0};
  rig->n_sub_views = 0;
  rig->forward = SV_FORWARD_DIRECT;
  sv_copy(rig->name, sizeof rig->name, "kalibr");
  while (s == SV_OK && sv_text_line(&r.text, &line)) s = take_line(&r, line);
  if (s == SV_OK) s = end_camera(&r);
  if (s == SV_OK && !rig->n_sub_views)
    s = sv_fail(err, SV_E_NOT_FOUND, "%s: holds no camera; expected Kalibr's camchain.yaml", name);
  for (int i = 0; i < rig->n_sub_views && s == SV_OK; i++) {
    sv_pose *p = &rig->sub_views[i].cam_from_rig;
    if (!*rig->sub_views[i].name)
      s = sv_fail(err, SV_E_NOT_FOUND, "%s: cam%d of the chain is missing", name, i);
    else if (i) *p = sv_pose_mul(p, &rig->sub_views[i - 1].cam_from_rig);
  }
  return s;
}
