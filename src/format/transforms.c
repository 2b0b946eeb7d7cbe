// SPDX-License-Identifier: Apache-2.0
#include "src/format/transforms.h"

#include <math.h>
#include <string.h>

#include "src/base/mathx.h"
#include "src/base/str.h"
#include "src/rig/limits.h"
#include "src/rig/sizes.h"

// The camera's keys, at the top level (for all frames) or in a frame (which wins).
enum { FL_X, FL_Y, CX, CY, ANGLE_X, ANGLE_Y, K1, K2, P1, P2, K3, K4, N_KEYS };
static const char *const keys[N_KEYS] = {
    "fl_x", "fl_y", "cx", "cy", "camera_angle_x", "camera_angle_y", "k1", "k2", "p1", "p2", "k3", "k4"};

typedef struct {
  double v[N_KEYS];
  unsigned has; // bit per key
  long long w, h;
  bool is_fisheye; // OPENCV_FISHEYE: k1 to k4 are Kannala and Brandt's
} camera;

#define HAS(cam, key) ((cam)->has >> (key)&1u)

static sv_status check_model(const sv_json *j, int i_object, camera *c, sv_err *err) {
  char model[40];
  int i = sv_json_get(j, i_object, "camera_model"), i_fish = sv_json_get(j, i_object, "is_fisheye");
  if (i_fish >= 0) {
    sv_status s = sv_json_bool(j, i_fish, &c->is_fisheye, err);
    if (s != SV_OK) return s;
  }
  sv_status s = sv_json_get_string(j, i_object, "camera_model", model, sizeof model, err);
  if (s < 0) return s;
  if (s == SV_END) return SV_OK;
  c->is_fisheye = sv_str_eq(model, "OPENCV_FISHEYE");
  if (c->is_fisheye || sv_str_eq(model, "OPENCV") || sv_str_eq(model, "PINHOLE") ||
      sv_str_eq(model, "SIMPLE_PINHOLE"))
    return SV_OK;
  return sv_json_fail(j, i, err, SV_E_UNSUPPORTED,
                      "camera model %s is not supported (PINHOLE, OPENCV and OPENCV_FISHEYE are)", model);
}

static sv_status read_camera(const sv_json *j, int i_object, camera *c, sv_err *err) {
  sv_status s = check_model(j, i_object, c, err);
  if (s != SV_OK) return s;
  unsigned own = 0;
  for (int k = 0; k < N_KEYS; k++) {
    s = sv_json_get_double(j, i_object, keys[k], &c->v[k], err);
    if (s < 0) return s;
    if (s == SV_OK) own |= 1u << k;
  }
  // a frame's angle overrides the top level's focal length; a frame's focal length overrides any
  // angle
  if ((own >> ANGLE_X & 1u) && !(own >> FL_X & 1u)) c->has &= ~(1u << FL_X | 1u << FL_Y);
  if (own >> ANGLE_X & 1u) c->has &= ~(1u << ANGLE_Y);
  c->has |= own;
  for (int k = 0; k < 2; k++) {
    s = sv_json_get_int(j, i_object, k ? "h" : "w", (sv_json_range){1, 32767}, k ? &c->h : &c->w, err);
    if (s < 0) return s;
  }
  for (int k = FL_X; k <= FL_Y; k++)
    if (HAS(c, k) && !(c->v[k] > 0))
      return sv_json_fail(j, i_object, err, SV_E_RANGE, "%s is %g, a positive number was expected", keys[k],
                          c->v[k]);
  for (int k = ANGLE_X; k <= ANGLE_Y; k++)
    if (HAS(c, k) && !(c->v[k] > 0 && c->v[k] < SV_PI))
      return sv_json_fail(j, i_object, err, SV_E_RANGE, "%s is %g, radians between 0 and pi were expected",
                          keys[k], c->v[k]);
  if (HAS(c, K4) && c->v[K4] != 0 && !c->is_fisheye)
    return sv_json_fail(j, i_object, err, SV_E_UNSUPPORTED, "a lens with an r^8 term (k4) is not supported");
  return SV_OK;
}

static void fill_model(sv_transforms_frame *f, const camera *c) {
  sv_camera_model *m = &f->model;
  *m = (sv_camera_model){.kind = SV_MODEL_PINHOLE, .width_px = (int)c->w, .height_px = (int)c->h};
  bool has_fl = HAS(c, FL_X);
  m->p[0] = has_fl ? c->v[FL_X] : 0;
  m->p[1] = HAS(c, FL_Y) ? c->v[FL_Y] : 0;
  f->camera_angle_x_rad = !has_fl && HAS(c, ANGLE_X) ? c->v[ANGLE_X] : 0;
  f->camera_angle_y_rad = !has_fl && HAS(c, ANGLE_Y) ? c->v[ANGLE_Y] : 0;
  f->has_cx = HAS(c, CX);
  f->has_cy = HAS(c, CY);
  m->p[2] = f->has_cx ? c->v[CX] : 0;
  m->p[3] = f->has_cy ? c->v[CY] : 0;
  static const int order[5] = {K1, K2, P1, P2, K3}, fisheye[4] = {K1, K2, K3, K4};
  if (c->is_fisheye) {
    m->kind = SV_MODEL_KB4;
    for (int i = 0; i < 4; i++) m->p[4 + i] = HAS(c, fisheye[i]) ? c->v[fisheye[i]] : 0;
    return;
  }
  for (int i = 0; i < 5; i++) {
    double v = HAS(c, order[i]) ? c->v[order[i]] : 0;
    m->p[4 + i] = v;
    if (v != 0 && i < 4 && m->kind == SV_MODEL_PINHOLE) m->kind = SV_MODEL_OPENCV4;
    if (v != 0 && i == 4) m->kind = SV_MODEL_OPENCV5;
  }
}

// The nearest rotation to a matrix that nearly is one: r <- r (3 I - r^T r) / 2 converges
// quadratically.
static void orthonormalise(double r[9]) {
  for (int it = 0; it < 5; it++) {
    double a[9];
    for (int i = 0; i < 3; i++)
      for (int k = 0; k < 3; k++) {
        double s = 0;
        for (int m = 0; m < 3; m++) s += r[m * 3 + i] * r[m * 3 + k];
        a[i * 3 + k] = (i == k ? 1.5 : 0) - 0.5 * s;
      }
    sv_mul33(r, r, a);
  }
}

static sv_status read_pose(const sv_json *j, int i_frame, sv_pose *cam_from_world, sv_err *err) {
  double m[4][4];
  int i = sv_json_get(j, i_frame, "transform_matrix"), n = sv_json_size(j, i);
  if (i < 0) return sv_json_missing(j, i_frame, "transform_matrix", err);
  if (!sv_json_is_array(j, i) || (n != 3 && n != 4))
    return sv_json_fail(j, i, err, SV_E_FORMAT, "3 or 4 rows of 4 numbers were expected");
  int row = sv_json_first(j, i);
  for (int k = 0; k < n; k++, row = sv_json_next(j, row)) {
    sv_status s = sv_json_doubles(j, row, m[k], 4, err);
    if (s != SV_OK) return s;
  }
  if (n == 4 && (fabs(m[3][0]) + fabs(m[3][1]) + fabs(m[3][2]) > 1e-6 || fabs(m[3][3] - 1) > 1e-6))
    return sv_json_fail(j, i, err, SV_E_FORMAT, "the last row is not 0 0 0 1");
  // world_from_cam; OpenGL's y and z point the other way
  sv_pose w = {{0}, {m[0][3], m[1][3], m[2][3]}};
  for (int a = 0; a < 3; a++)
    for (int b = 0; b < 3; b++) w.r[a * 3 + b] = b == 0 ? m[a][b] : -m[a][b];
  double e = sv_rotation_error(w.r);
  if (!(e <= 1e-3))
    return sv_json_fail(j, i, err, SV_E_FORMAT, "not a rotation: off by %g, at most 0.001 was expected", e);
  orthonormalise(w.r);
  *cam_from_world = sv_pose_inv(&w);
  return sv_limits_check_pose(cam_from_world, j->name, err);
}

static sv_status get_path(const sv_json *j, int i_object, const char *key, char *out, sv_err *err) {
  sv_status s = sv_json_get_string(j, i_object, key, out, SV_TRANSFORMS_CAP_PATH, err);
  if (s != SV_OK) return s;
  size_t skip = 0, n = strlen(out);
  while (out[skip] == '.' && out[skip + 1] == '/') skip += 2;
  memmove(out, out + skip, n - skip + 1);
  return SV_OK;
}

static bool ends_in_image(const char *path) {
  static const char *const ext[] = {".png", ".jpg", ".jpeg"};
  size_t n = strlen(path);
  for (int i = 0; i < 3; i++) {
    size_t m = strlen(ext[i]), k = 0;
    if (n < m) continue;
    while (k < m && (path[n - m + k] | 32) == (ext[i][k] | 32)) k++; // letters of either case
    if (k == m) return true;
  }
  return false;
}

static sv_status read_prior(const sv_json *j, int i_frame, sv_transforms_frame *f, sv_err *err) {
  sv_status s = get_path(j, i_frame, "depth_prior", f->prior_path, err);
  if (s == SV_OK) f->prior_kind = SV_TRANSFORMS_DEPTH;
  if (s != SV_END) return s;
  s = get_path(j, i_frame, "disparity_prior", f->prior_path, err);
  if (s == SV_OK) f->prior_kind = SV_TRANSFORMS_DISPARITY;
  return s == SV_END ? SV_OK : s;
}

static sv_status read_depth(const sv_json *j, int i_frame, sv_transforms_frame *f, sv_err *err) {
  static const struct {
    const char *key;
    sv_depth_kind kind;
  } forms[] = {
      {"depth_path", SV_DEPTH_Z}, {"depth_file_path", SV_DEPTH_Z}, {"ray_distance_path", SV_DEPTH_RAY}};
  for (int k = 0; k < 3 && !f->depth_kind; k++) {
    sv_status s = get_path(j, i_frame, forms[k].key, f->depth_path, err);
    if (s < 0) return s;
    if (s == SV_OK) f->depth_kind = forms[k].kind;
  }
  if (!f->depth_kind) return SV_OK;
  double unit = 0;
  sv_status s = sv_json_get_double(
      j, 0, f->depth_kind == SV_DEPTH_RAY ? "ray_distance_unit" : "depth_unit_scale_factor", &unit, err);
  if (s == SV_END && f->depth_kind == SV_DEPTH_Z) {
    s = sv_json_get_double(j, 0, "depth_scale", &unit, err); // steps a unit
    if (s == SV_OK) unit = unit > 0 ? 1 / unit : -1;
  }
  if (s < 0) return s;
  if (s == SV_OK && !(unit > 0 && unit < 1e12))
    return sv_json_fail(j, 0, err, SV_E_RANGE, "the unit of depth is not a positive number");
  f->depth_unit = unit;
  return SV_OK;
}

static sv_status read_labels(const sv_json *j, int i_frame, sv_transforms_frame *f, sv_err *err) {
  long long exposure = -1, sub_view = -1;
  double rect[4];
  f->time = -1;
  // group_id and view_id: as the paper's synthetic data call them
  sv_status s = sv_json_get_int(j, i_frame, "exposure", (sv_json_range){-1, 1000000000}, &exposure, err);
  if (s == SV_END)
    s = sv_json_get_int(j, i_frame, "group_id", (sv_json_range){-1, 1000000000}, &exposure, err);
  const sv_json_range sub_views = {-1, SV_CAP_SUB_VIEWS - 1};
  if (s >= 0) s = sv_json_get_int(j, i_frame, "sub_view", sub_views, &sub_view, err);
  if (s == SV_END) s = sv_json_get_int(j, i_frame, "view_id", sub_views, &sub_view, err);
  if (s >= 0) s = sv_json_get_string(j, i_frame, "camera", f->camera, sizeof f->camera, err);
  if (s >= 0) s = sv_json_get_string(j, i_frame, "split", f->split, sizeof f->split, err);
  if (s >= 0) s = sv_json_get_double(j, i_frame, "time", &f->time, err);
  if (s < 0) return s;
  if (s == SV_OK && !(f->time >= 0 && f->time <= 1))
    return sv_json_fail(j, sv_json_get(j, i_frame, "time"), err, SV_E_RANGE, "%g is outside 0 to 1", f->time);
  f->exposure = (int)exposure;
  f->sub_view = (int)sub_view;
  int i = sv_json_get(j, i_frame, "footprint");
  if (i < 0) return SV_OK;
  s = sv_json_doubles(j, i, rect, 4, err);
  if (s != SV_OK) return s;
  for (int k = 0; k < 4; k++)
    if (!(rect[k] >= (k < 2 ? 0 : 1) && rect[k] <= 32767 && rect[k] == floor(rect[k])))
      return sv_json_fail(j, i, err, SV_E_RANGE, "x, y, width and height in whole pixels were expected");
  f->footprint = (sv_footprint){
      .x0_px = (int)rect[0], .y0_px = (int)rect[1], .width_px = (int)rect[2], .height_px = (int)rect[3]};
  return SV_OK;
}

static sv_status read_frame(const sv_json *j, int i_frame, const camera *common, sv_transforms_frame *f,
                            sv_err *err) {
  memset(f, 0, sizeof *f);
  if (!sv_json_is_object(j, i_frame))
    return sv_json_fail(j, i_frame, err, SV_E_FORMAT, "a frame is not an object");
  sv_status s = get_path(j, i_frame, "file_path", f->file_path, err);
  if (s < 0) return s;
  if (s == SV_END || !f->file_path[0]) return sv_json_missing(j, i_frame, "file_path", err);
  f->has_extension = ends_in_image(f->file_path);
  if ((s = get_path(j, i_frame, "mask_path", f->mask_path, err)) < 0) return s;
  if ((s = get_path(j, i_frame, "coverage_path", f->coverage_path, err)) < 0) return s;
  camera c = *common;
  s = read_camera(j, i_frame, &c, err);
  if (s != SV_OK) return s;
  if (!HAS(&c, FL_X) && !HAS(&c, ANGLE_X))
    return sv_json_fail(j, i_frame, err, SV_E_NOT_FOUND, "neither fl_x nor camera_angle_x is given");
  fill_model(f, &c);
  s = read_pose(j, i_frame, &f->cam_from_world, err);
  if (s == SV_OK) s = read_labels(j, i_frame, f, err);
  if (s == SV_OK) s = read_depth(j, i_frame, f, err);
  if (s == SV_OK) s = read_prior(j, i_frame, f, err);
  return s;
}

sv_status sv_transforms_open(sv_transforms *t, const sv_file_data *file, jsmntok_t *tok, int cap_tok,
                             sv_err *err) {
  memset(t, 0, sizeof *t);
  sv_status s = sv_json_parse(&t->json, file, tok, cap_tok, err);
  if (s != SV_OK) return s;
  const sv_json *j = &t->json;
  if (!sv_json_is_object(j, 0))
    return sv_json_fail(j, 0, err, SV_E_FORMAT, "an object was expected, not an array");
  int i = sv_json_get(j, 0, "frames");
  if (i < 0) return sv_json_missing(j, 0, "frames", err);
  if (!sv_json_is_array(j, i)) return sv_json_fail(j, i, err, SV_E_FORMAT, "an array of frames was expected");
  t->n_frames = sv_json_size(j, i);
  if (t->n_frames == 0) return sv_json_fail(j, i, err, SV_E_NOT_FOUND, "there are no frames");
  camera c = {0};
  s = read_camera(j, 0, &c, err);
  if (s == SV_OK) s = get_path(j, 0, "ply_file_path", t->ply_file_path, err);
  char unit[16] = "";
  if (s >= 0) s = sv_json_get_string(j, 0, "world_unit", unit, sizeof unit, err);
  t->unit.is_metric = strcmp(unit, "m") == 0;
  double sigma = 0;
  if (s >= 0) s = sv_json_get_double(j, 0, "world_scale_sigma", &sigma, err);
  if (sigma > 0 && sigma < 1) t->unit.scale_sigma = (float)sigma;
  return s < 0 ? s : SV_OK;
}

sv_status sv_transforms_read(const sv_transforms *t, sv_transforms_frame *frames, int cap, sv_err *err) {
  const sv_json *j = &t->json;
  camera common = {0};
  sv_status s = read_camera(j, 0, &common, err);
  if (s != SV_OK) return s;
  if (t->n_frames > cap)
    return sv_fail(err, SV_E_NOMEM, "%s: has %d frames, there is room for %d", j->name, t->n_frames, cap);
  int i = sv_json_first(j, sv_json_get(j, 0, "frames"));
  for (int k = 0; k < t->n_frames; k++, i = sv_json_next(j, i)) {
    s = read_frame(j, i, &common, &frames[k], err);
    if (s != SV_OK) return s;
  }
  return SV_OK;
}

static double focal(double angle_rad, int size_px) { return 0.5 * size_px / sv_tan(0.5 * angle_rad); }

sv_status sv_transforms_finish(sv_transforms_frame *f, int width_px, int height_px, sv_err *err) {
  sv_camera_model *m = &f->model;
  if (width_px < 1 || height_px < 1 || width_px > 32767 || height_px > 32767)
    return sv_fail(err, SV_E_RANGE, "%s: an image of %dx%d is not supported", f->file_path, width_px,
                   height_px);
  const bool is_other =
      (m->width_px && m->width_px != width_px) || (m->height_px && m->height_px != height_px);
  sv_image_map map;
  // Folders of images made smaller (images_2) come with the camera of the full size.
  if (is_other && !(m->width_px && m->height_px && sv_model_resize(m, width_px, height_px, &map)))
    return sv_fail(err, SV_E_FORMAT,
                   "%s: the image is %dx%d, the transforms file says %dx%d, which is another shape",
                   f->file_path, width_px, height_px, m->width_px, m->height_px);
  double fx = m->p[0] > 0 ? m->p[0] : focal(f->camera_angle_x_rad, width_px);
  double fy = m->p[1] > 0                 ? m->p[1]
              : f->camera_angle_y_rad > 0 ? focal(f->camera_angle_y_rad, height_px)
                                          : fx;
  m->width_px = width_px;
  m->height_px = height_px;
  m->p[0] = fx;
  m->p[1] = fy;
  if (!f->has_cx) m->p[2] = 0.5 * width_px;
  if (!f->has_cy) m->p[3] = 0.5 * height_px;
  f->has_cx = f->has_cy = true;
  return sv_limits_check_camera(m, f->file_path, err);
}

sv_status sv_transforms_find_measurement(const sv_transforms *t, bool is_linear, int exposure,
                                         sv_transforms_measurement *out, sv_err *err) {
  const sv_json *j = &t->json;
  int i = sv_json_first(j, sv_json_get(j, 0, is_linear ? "composites_linear" : "composites"));
  for (; i >= 0; i = sv_json_next(j, i)) {
    long long e = -1;
    double max_overlap = 0;
    sv_status s = sv_json_get_int(j, i, "exposure", (sv_json_range){0, 1000000000}, &e, err);
    if (s < 0) return s;
    if (e != exposure) continue;
    s = sv_json_get_double(j, i, "M_max", &max_overlap, err);
    if (s == SV_END) return sv_json_missing(j, i, "M_max", err);
    if (s < 0) return s;
    if (!(max_overlap > 0 && max_overlap <= SV_CAP_SUB_VIEWS))
      return sv_json_fail(j, sv_json_get(j, i, "M_max"), err, SV_E_RANGE, "%g is outside 0 to %d",
                          max_overlap, SV_CAP_SUB_VIEWS);
    s = get_path(j, i, "file_path", out->file_path, err);
    out->max_overlap = max_overlap;
    return s == SV_END ? sv_json_missing(j, i, "file_path", err) : s;
  }
  return SV_END;
}
