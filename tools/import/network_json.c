// SPDX-License-Identifier: Apache-2.0
// Poses of DUSt3R and MASt3R as JSON: an object with the lists of their scenes. cams2world: 4x4
// matrices, OpenCV's axes. intrinsics: 3x3 matrices, or focals, one a picture, with
// principal_points where they are known. filelist or image_names: the pictures' names; imshapes:
// height and width that the network saw. Those networks reduce the long side to 512 pixels and cut
// both sides to multiples of 16 about the middle.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/str.h"
#include "tools/import/network.h"

#define LONG_SIDE 512.0

typedef struct {
  const char *file;
  sv_json j;
  int names, poses, k, focals, centers, shapes; // tokens, -1: absent
  int n;
  lab_net_pictures pictures;
} scene;

static int get_either(const sv_json *j, const char *a, const char *b) {
  int at = sv_json_get(j, 0, a);
  return at >= 0 ? at : sv_json_get(j, 0, b);
}

static int element(const sv_json *j, int list, int i) {
  int at = list < 0 ? -1 : sv_json_first(j, list);
  while (i-- > 0 && at >= 0) at = sv_json_next(j, at);
  return at;
}

// A matrix as rows.
static sv_status read_rows(const sv_json *j, int matrix, int n_rows, int n_columns, double *out,
                           sv_err *err) {
  if (sv_json_size(j, matrix) < n_rows)
    return sv_json_fail(j, matrix, err, SV_E_FORMAT, "expected a matrix of %d rows", n_rows);
  int row = sv_json_first(j, matrix);
  sv_status s = SV_OK;
  for (int i = 0; s == SV_OK && i < n_rows; i++, row = sv_json_next(j, row))
    s = sv_json_doubles(j, row, out + i * n_columns, n_columns, err);
  return s;
}

// A number, or a list of one.
static sv_status read_focal(const sv_json *j, int at, double *out, sv_err *err) {
  return sv_json_is_array(j, at) ? sv_json_doubles(j, at, out, 1, err) : sv_json_double(j, at, out, err);
}

// What the network saw of a picture: its own words, else twice the center, else the rule.
static sv_status seen_size(const scene *c, int i, const lab_peek *p, const double k[9], double wh[2],
                           sv_err *err) {
  double hw[2];
  const double ratio = LONG_SIDE / (p->width_px > p->height_px ? p->width_px : p->height_px);
  wh[0] = floor(p->width_px * ratio / 16 + 0.01) * 16;
  wh[1] = floor(p->height_px * ratio / 16 + 0.01) * 16;
  if (c->shapes < 0) {
    if (k[2] > 0) wh[0] = 2 * k[2];
    if (k[5] > 0) wh[1] = 2 * k[5];
    return SV_OK;
  }
  sv_status s = sv_json_doubles(&c->j, element(&c->j, c->shapes, i), hw, 2, err);
  if (s == SV_OK && !(hw[0] >= 1 && hw[1] >= 1 && hw[0] < 1e5 && hw[1] < 1e5))
    return sv_json_fail(&c->j, c->shapes, err, SV_E_RANGE, "expected height and width in pixels");
  wh[0] = hw[1];
  wh[1] = hw[0];
  return s;
}

static sv_status read_lens(const scene *c, int i, lab_net_camera *out, sv_err *err) {
  double *k = out->k, wh[2], center[2] = {0, 0};
  lab_peek p;
  memset(k, 0, 9 * sizeof *k);
  sv_status s = lab_net_size(&c->pictures, (size_t)i, &p, err);
  if (s == SV_OK && c->k >= 0) {
    const bool is_one = sv_json_size(&c->j, c->k) == 3 && c->n != 3; // for all pictures
    s = read_rows(&c->j, is_one ? c->k : element(&c->j, c->k, i), 3, 3, k, err);
  } else if (s == SV_OK) {
    s = read_focal(&c->j, element(&c->j, c->focals, i), &k[0], err);
    k[4] = k[0];
    if (s == SV_OK && c->centers >= 0)
      s = sv_json_doubles(&c->j, element(&c->j, c->centers, i), center, 2, err);
    k[2] = center[0];
    k[5] = center[1];
  }
  if (s == SV_OK) s = seen_size(c, i, &p, k, wh, err);
  if (s != SV_OK) return s;
  if (c->k < 0 && c->centers < 0) {
    k[2] = 0.5 * wh[0];
    k[5] = 0.5 * wh[1];
  }
  // One scale for both sides, by the long one; what is missing of the other was cut off.
  const double scale = p.width_px >= p.height_px ? p.width_px / wh[0] : p.height_px / wh[1];
  out->fit = (lab_net_fit){{scale, scale},
                           {0.5 * (wh[0] - p.width_px / scale), 0.5 * (wh[1] - p.height_px / scale)}};
  return SV_OK;
}

static sv_status read_pose(const scene *c, int i, sv_pose *out, sv_err *err) {
  double m[16];
  sv_status s = read_rows(&c->j, element(&c->j, c->poses, i), 3, 4, m, err);
  if (s == SV_OK) s = lab_net_pose(c->file, m, (size_t)i, out, err);
  if (s == SV_OK) *out = sv_pose_inv(out);
  return s;
}

// The pictures in the order of the file's names, which may be paths of another machine.
static sv_status order_pictures(scene *c, sv_err *err) {
  if (c->names < 0) return SV_OK; // in order of their names
  sv_names *have = &c->pictures.names;
  int at = sv_json_first(&c->j, c->names);
  for (int i = 0; i < have->n; i++, at = sv_json_next(&c->j, at)) {
    char path[SV_CAP_PATH];
    int k = i;
    sv_status s = sv_json_string(&c->j, at, path, sizeof path, err);
    if (s != SV_OK) return s;
    while (k < have->n && strcmp(have->names[k], sv_path_name(path)) != 0) k++;
    if (k == have->n)
      return sv_fail(err, SV_E_NOT_FOUND, "%s: picture %.100s is not in %s, or named twice", c->file,
                     sv_path_name(path), c->pictures.folder);
    char *name = have->names[k];
    have->names[k] = have->names[i];
    have->names[i] = name;
  }
  return SV_OK;
}

static sv_status read_scene(scene *c, lab_import *im, const lab_options *o, sv_err *err) {
  const sv_json *j = &c->j;
  c->names = get_either(j, "filelist", "image_names");
  c->poses = get_either(j, "cams2world", "poses");
  c->k = sv_json_get(j, 0, "intrinsics");
  c->focals = sv_json_get(j, 0, "focals");
  c->centers = sv_json_get(j, 0, "principal_points");
  c->shapes = sv_json_get(j, 0, "imshapes");
  c->n = sv_json_size(j, c->poses);
  if (c->n < 1) return sv_json_missing(j, 0, "cams2world", err);
  if (c->k < 0 && c->focals < 0) return sv_json_missing(j, 0, "intrinsics", err);
  if ((c->names >= 0 && sv_json_size(j, c->names) != c->n) ||
      (c->shapes >= 0 && sv_json_size(j, c->shapes) != c->n))
    return sv_fail(err, SV_E_FORMAT, "%s: has %d poses, and lists of other lengths beside them", c->file,
                   c->n);
  sv_status s = lab_net_list(&c->pictures, o, c->file, (size_t)c->n, err);
  if (s == SV_OK) s = order_pictures(c, err);
  for (int i = 0; s == SV_OK && i < c->n; i++) {
    lab_net_camera camera;
    s = read_lens(c, i, &camera, err);
    if (s == SV_OK) s = read_pose(c, i, &camera.cam_from_world, err);
    if (s == SV_OK) s = lab_net_add(im, &c->pictures, (size_t)i, &camera, err);
  }
  return s;
}

sv_status lab_import_dust3r(lab_import *im, const lab_options *o, sv_err *err) {
  scene c = {.file = o->input};
  void *text = NULL;
  size_t bytes = 0;
  int n_tok = 0;
  sv_status s = sv_file_read(o->input, &text, &bytes, err);
  if (s == SV_OK) s = sv_json_count(o->input, text, bytes, &n_tok, err);
  jsmntok_t *tok = s == SV_OK ? malloc(((size_t)n_tok + 1) * sizeof *tok) : NULL;
  if (s == SV_OK && !tok) s = sv_fail(err, SV_E_NOMEM, "%s: no memory for %d values", o->input, n_tok);
  const sv_file_data file = {o->input, text, bytes};
  if (s == SV_OK) s = sv_json_parse(&c.j, &file, tok, n_tok, err);
  if (s == SV_OK) s = read_scene(&c, im, o, err);
  sv_names_free(&c.pictures.names);
  free(tok);
  free(text);
  return s;
}
