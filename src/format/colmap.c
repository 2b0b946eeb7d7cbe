// SPDX-License-Identifier: Apache-2.0
#include "src/format/colmap.h"

#include <math.h>
#include <string.h>

#include "src/base/str.h"
#include "src/format/bytes.h"
#include "src/rig/limits.h"

// COLMAP's models by number; kind is SV_N_MODELS for unsupported ones. map: target of each of the
// file's parameters (fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6); 16 means both fx and fy.
static const struct {
  const char *name;
  sv_model_kind kind;
  int n_params;
  uint8_t map[12];
} models[] = {
    {"SIMPLE_PINHOLE", SV_MODEL_PINHOLE, 3, {16, 2, 3}},
    {"PINHOLE", SV_MODEL_PINHOLE, 4, {0, 1, 2, 3}},
    {"SIMPLE_RADIAL", SV_MODEL_OPENCV4, 4, {16, 2, 3, 4}},
    {"RADIAL", SV_MODEL_OPENCV4, 5, {16, 2, 3, 4, 5}},
    {"OPENCV", SV_MODEL_OPENCV4, 8, {0, 1, 2, 3, 4, 5, 6, 7}},
    {"OPENCV_FISHEYE", SV_MODEL_KB4, 8, {0, 1, 2, 3, 4, 5, 6, 7}},
    {"FULL_OPENCV", SV_MODEL_OPENCV8, 12, {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11}},
    {"FOV", SV_N_MODELS, 5, {0}},
    {"SIMPLE_RADIAL_FISHEYE", SV_MODEL_KB4, 4, {16, 2, 3, 4}},
    {"RADIAL_FISHEYE", SV_MODEL_KB4, 5, {16, 2, 3, 4, 5}},
    {"THIN_PRISM_FISHEYE", SV_N_MODELS, 12, {0}},
};
#define N_COLMAP_MODELS ((int)(sizeof models / sizeof *models))

sv_status sv_colmap_open(sv_colmap *c, const char *name, const void *buf, size_t bytes, bool is_binary,
                         sv_err *err) {
  *c = (sv_colmap){.text = {.name = name, .buf = buf, .bytes = bytes}, .is_binary = is_binary};
  if (!is_binary) return SV_OK;
  if (bytes < 8) return sv_fail(err, SV_E_FORMAT, "%s: shorter than the 8 bytes of its count", name);
  c->n = sv_le64(c->text.buf);
  c->text.at = 8;
  return SV_OK;
}

#define CAP_PLACE 256

// Where in the file the reader is, for errors.
static const char *place_of(const sv_colmap *c, char out[CAP_PLACE]) {
  if (c->is_binary) sv_fmt(out, CAP_PLACE, "%s: record %llu", c->text.name, (unsigned long long)c->i);
  else sv_fmt(out, CAP_PLACE, "%s:%d", c->text.name, c->text.line);
  return out;
}

static sv_status fail_at(const sv_colmap *c, sv_err *err, sv_status s, const char *what) {
  char place[CAP_PLACE];
  return sv_fail(err, s, "%s: %s", place_of(c, place), what);
}

// --- text ----------------------------------------------------------------------------------------
static bool next_entry(sv_colmap *c, sv_word *out) { // skips comments and blank lines
  while (sv_text_line(&c->text, out)) {
    size_t i = 0;
    while (i < out->n && (out->t[i] == ' ' || out->t[i] == '\t')) i++;
    out->t += i;
    out->n -= i;
    if (out->n && out->t[0] != '#') return true;
  }
  return false;
}

static bool take_double(sv_word *line, double *v) {
  sv_word w = sv_word_next(line);
  return sv_parse_double(w.t, w.n, v);
}

static bool take_u32(sv_word *line, uint32_t *v) {
  sv_word w = sv_word_next(line);
  long long x;
  if (!sv_parse_int(w.t, w.n, &x) || x < 0 || x > UINT32_MAX) return false;
  *v = (uint32_t)x;
  return true;
}

// --- binary --------------------------------------------------------------------------------------
static const uint8_t *take(sv_colmap *c, uint64_t bytes) { // NULL when the file is too short
  if (bytes > c->text.bytes - c->text.at) return NULL;
  const uint8_t *p = c->text.buf + c->text.at;
  c->text.at += (size_t)bytes;
  return p;
}

static sv_status cut(const sv_colmap *c, sv_err *err) {
  return sv_fail(err, SV_E_FORMAT, "%s: announces %llu entries, but ends in entry %llu", c->text.name,
                 (unsigned long long)c->n, (unsigned long long)c->i);
}

static sv_status end_of_binary(const sv_colmap *c, sv_err *err) {
  if (c->text.at != c->text.bytes)
    return sv_fail(err, SV_E_FORMAT, "%s: %zu bytes after the last entry", c->text.name,
                   c->text.bytes - c->text.at);
  return SV_END;
}

// --- cameras -------------------------------------------------------------------------------------
static sv_status make_camera(const sv_colmap *c, int model, const uint64_t size[2], const double *params,
                             sv_camera_model *m, sv_err *err) {
  *m = (sv_camera_model){.kind = models[model].kind};
  for (int i = 0; i < 2; i++)
    if (size[i] < 1 || size[i] > SV_CAP_IMAGE_SIDE_PX)
      return fail_at(c, err, SV_E_RANGE, "an image size outside 1 to 32767 px");
  m->width_px = (int)size[0];
  m->height_px = (int)size[1];
  for (int i = 0; i < models[model].n_params; i++) {
    int to = models[model].map[i];
    m->p[to == 16 ? 0 : to] = params[i];
    if (to == 16) m->p[1] = params[i];
  }
  char place[CAP_PLACE];
  return sv_limits_check_camera(m, place_of(c, place), err);
}

static sv_status unsupported(const sv_colmap *c, const char *name, size_t n, sv_err *err) {
  char text[160];
  sv_fmt(text, sizeof text,
         "camera model %.*s is not supported; undistort to PINHOLE, or use a model up to FULL_OPENCV",
         (int)(n > 40 ? 40 : n), name);
  return fail_at(c, err, SV_E_UNSUPPORTED, text);
}

static sv_status text_camera(sv_colmap *c, sv_colmap_camera *out, sv_err *err) {
  sv_word line;
  uint32_t size[2];
  double params[12];
  int model = 0;
  if (!next_entry(c, &line)) return SV_END;
  bool ok = take_u32(&line, &out->id);
  sv_word name = sv_word_next(&line);
  ok = ok && take_u32(&line, &size[0]) && take_u32(&line, &size[1]);
  if (!ok) return fail_at(c, err, SV_E_FORMAT, "CAMERA_ID MODEL WIDTH HEIGHT PARAMS... was expected");
  while (model < N_COLMAP_MODELS &&
         !(strlen(models[model].name) == name.n && memcmp(models[model].name, name.t, name.n) == 0))
    model++;
  if (model == N_COLMAP_MODELS || models[model].kind == SV_N_MODELS)
    return unsupported(c, name.t, name.n, err);
  for (int i = 0; i < models[model].n_params; i++)
    if (!take_double(&line, &params[i]))
      return fail_at(c, err, SV_E_FORMAT, "a camera parameter is missing or malformed");
  if (sv_word_next(&line).n)
    return fail_at(c, err, SV_E_FORMAT, "too many parameters for the camera's model");
  return make_camera(c, model, (uint64_t[2]){size[0], size[1]}, params, &out->model, err);
}

sv_status sv_colmap_next_camera(sv_colmap *c, sv_colmap_camera *out, sv_err *err) {
  if (!c->is_binary) return text_camera(c, out, err);
  if (c->i == c->n) return end_of_binary(c, err);
  const uint8_t *p = take(c, 24);
  if (!p) return cut(c, err);
  out->id = sv_le32(p);
  uint32_t model = sv_le32(p + 4);
  uint64_t size[2] = {sv_le64(p + 8), sv_le64(p + 16)};
  if (model >= (uint32_t)N_COLMAP_MODELS) return unsupported(c, "with a number above 10", 22, err);
  if (models[model].kind == SV_N_MODELS)
    return unsupported(c, models[model].name, strlen(models[model].name), err);
  double params[12];
  p = take(c, 8u * (unsigned)models[model].n_params);
  if (!p) return cut(c, err);
  for (int i = 0; i < models[model].n_params; i++) params[i] = sv_lef64(p + 8 * i);
  sv_status s = make_camera(c, (int)model, size, params, &out->model, err);
  c->i++;
  return s;
}

// --- images --------------------------------------------------------------------------------------
static sv_status make_pose(const sv_colmap *c, const double v[7], sv_pose *out, sv_err *err) {
  double n = v[0] * v[0] + v[1] * v[1] + v[2] * v[2] + v[3] * v[3];
  if (!(n > 0.98 && n < 1.02)) return fail_at(c, err, SV_E_RANGE, "the quaternion is not of length 1");
  for (int i = 0; i < 3; i++) out->t[i] = v[4 + i];
  sv_quat_to_mat(out->r, v);
  char place[CAP_PLACE];
  return sv_limits_check_pose(out, place_of(c, place), err);
}

static sv_status set_name(const sv_colmap *c, sv_colmap_image *out, const char *t, size_t n, sv_err *err) {
  if (!n) return fail_at(c, err, SV_E_FORMAT, "the image has no name");
  if (n >= sizeof out->name) return fail_at(c, err, SV_E_RANGE, "the image's name is longer than 199 bytes");
  if (memchr(t, 0, n)) return fail_at(c, err, SV_E_FORMAT, "the image's name holds a NUL");
  memcpy(out->name, t, n);
  out->name[n] = 0;
  return SV_OK;
}

static sv_status text_image(sv_colmap *c, sv_colmap_image *out, sv_err *err) {
  sv_word line, points;
  double v[7];
  if (!next_entry(c, &line)) return SV_END;
  bool ok = take_u32(&line, &out->id);
  for (int i = 0; i < 7; i++) ok = ok && take_double(&line, &v[i]);
  if (!ok || !take_u32(&line, &out->camera_id))
    return fail_at(c, err, SV_E_FORMAT, "IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME was expected");
  while (line.n && (*line.t == ' ' || *line.t == '\t')) {
    line.t++;
    line.n--;
  }
  // the rest of the line: names may hold spaces
  sv_status s = set_name(c, out, line.t, line.n, err);
  if (s == SV_OK) s = make_pose(c, v, &out->cam_from_world, err);
  // its 2D points are on the next line, which may be empty
  (void)sv_text_line(&c->text, &points);
  return s;
}

sv_status sv_colmap_next_image(sv_colmap *c, sv_colmap_image *out, sv_err *err) {
  if (!c->is_binary) return text_image(c, out, err);
  if (c->i == c->n) return end_of_binary(c, err);
  const uint8_t *p = take(c, 64);
  double v[7];
  if (!p) return cut(c, err);
  out->id = sv_le32(p);
  out->camera_id = sv_le32(p + 60);
  for (int i = 0; i < 7; i++) v[i] = sv_lef64(p + 4 + 8 * i);
  const uint8_t *name = c->text.buf + c->text.at, *end = memchr(name, 0, c->text.bytes - c->text.at);
  if (!end) return cut(c, err);
  c->text.at += (size_t)(end - name) + 1;
  sv_status s = set_name(c, out, (const char *)name, (size_t)(end - name), err);
  if (s == SV_OK) s = make_pose(c, v, &out->cam_from_world, err);
  if (s != SV_OK) return s;
  p = take(c, 8);
  if (!p) return cut(c, err);
  uint64_t n2d = sv_le64(p);
  if (n2d > c->text.bytes / 24 || !take(c, n2d * 24)) return cut(c, err);
  c->i++;
  return SV_OK;
}

// --- points --------------------------------------------------------------------------------------
static sv_status check_point(const sv_colmap *c, const sv_colmap_point *p, sv_err *err) {
  for (int i = 0; i < 3; i++)
    if (!(fabs(p->xyz[i]) < 1e12)) return fail_at(c, err, SV_E_RANGE, "a coordinate is not finite");
  return SV_OK;
}

static sv_status text_point(sv_colmap *c, sv_colmap_point *out, sv_err *err) {
  sv_word line;
  if (!next_entry(c, &line)) return SV_END;
  uint32_t rgb[3] = {0};
  sv_word id = sv_word_next(&line);
  long long v;
  bool ok = sv_parse_int(id.t, id.n, &v) && v >= 0;
  for (int i = 0; i < 3; i++) ok = ok && take_double(&line, &out->xyz[i]);
  for (int i = 0; i < 3; i++) ok = ok && take_u32(&line, &rgb[i]) && rgb[i] <= 255;
  if (!ok || !take_double(&line, &out->error_px))
    return fail_at(c, err, SV_E_FORMAT, "POINT3D_ID X Y Z R G B ERROR TRACK... was expected");
  out->id = (uint64_t)v;
  out->n_track = 0;
  for (uint32_t a; line.n;) {
    if (!take_u32(&line, &a) || !take_u32(&line, &a))
      return fail_at(c, err, SV_E_FORMAT, "pairs of IMAGE_ID POINT2D_IDX were expected");
    out->n_track++;
  }
  for (int i = 0; i < 3; i++) out->rgb[i] = (uint8_t)rgb[i];
  return check_point(c, out, err);
}

sv_status sv_colmap_next_point(sv_colmap *c, sv_colmap_point *out, sv_err *err) {
  if (!c->is_binary) return text_point(c, out, err);
  if (c->i == c->n) return end_of_binary(c, err);
  const uint8_t *p = take(c, 51);
  if (!p) return cut(c, err);
  out->id = sv_le64(p);
  for (int i = 0; i < 3; i++) {
    out->xyz[i] = sv_lef64(p + 8 + 8 * i);
    out->rgb[i] = p[32 + i];
  }
  out->error_px = sv_lef64(p + 35);
  uint64_t n = sv_le64(p + 43);
  if (n > c->text.bytes / 8 || !take(c, n * 8)) return cut(c, err);
  out->n_track = (uint32_t)n;
  sv_status s = check_point(c, out, err);
  c->i++;
  return s;
}

// --- rigs ----------------------------------------------------------------------------------------
// pose: quaternion and translation, NULL when the file has none.
static sv_status add_sensor(const sv_colmap *c, sv_colmap_rig *g, bool is_camera, uint32_t id,
                            const double *pose, sv_err *err) {
  if (!is_camera) return SV_OK;
  if (g->n_cameras == SV_COLMAP_CAP_DATA) return fail_at(c, err, SV_E_FULL, "a rig of more than 256 cameras");
  for (int i = 0; i < g->n_cameras; i++)
    if (g->cameras[i].camera_id == id)
      return fail_at(c, err, SV_E_FORMAT, "a camera appears twice in the rig");
  int i = g->n_cameras++;
  g->cameras[i].camera_id = id;
  g->cameras[i].has_pose = pose != NULL;
  g->cameras[i].cam_from_rig = sv_pose_identity();
  return pose ? make_pose(c, pose, &g->cameras[i].cam_from_rig, err) : SV_OK;
}

static const double reference_pose[7] = {1};

static bool take_sensor(sv_word *line, bool *is_camera, uint32_t *id) {
  sv_word type = sv_word_next(line);
  *is_camera = sv_word_is(type, "CAMERA");
  return type.n && take_u32(line, id);
}

static sv_status text_rig(sv_colmap *c, sv_colmap_rig *out, sv_err *err) {
  sv_word line;
  uint32_t n = 0, id, has_pose;
  bool is_camera;
  double v[7];
  if (!next_entry(c, &line)) return SV_END;
  if (!take_u32(&line, &out->id) || !take_u32(&line, &n))
    return fail_at(c, err, SV_E_FORMAT, "RIG_ID NUM_SENSORS REF_SENSOR_TYPE REF_SENSOR_ID ... was expected");
  out->n_cameras = 0;
  for (uint32_t i = 0; i < n; i++) {
    bool ok = take_sensor(&line, &is_camera, &id);
    has_pose = 1;
    if (i) ok = ok && take_u32(&line, &has_pose) && has_pose <= 1;
    for (int k = 0; i && has_pose && k < 7; k++) ok = ok && take_double(&line, &v[k]);
    if (!ok)
      return fail_at(c, err, SV_E_FORMAT,
                     i ? "SENSOR_TYPE SENSOR_ID HAS_POSE [QW QX QY QZ TX TY TZ] was expected for each sensor"
                       : "REF_SENSOR_TYPE REF_SENSOR_ID was expected after the number of sensors");
    sv_status s = add_sensor(c, out, is_camera, id, !i ? reference_pose : has_pose ? v : NULL, err);
    if (s != SV_OK) return s;
  }
  if (sv_word_next(&line).n) return fail_at(c, err, SV_E_FORMAT, "more sensors than NUM_SENSORS says");
  return SV_OK;
}

sv_status sv_colmap_next_rig(sv_colmap *c, sv_colmap_rig *out, sv_err *err) {
  if (!c->is_binary) return text_rig(c, out, err);
  if (c->i == c->n) return end_of_binary(c, err);
  const uint8_t *p = take(c, 8);
  double v[7];
  if (!p) return cut(c, err);
  out->id = sv_le32(p);
  out->n_cameras = 0;
  uint32_t n = sv_le32(p + 4);
  for (uint32_t i = 0; i < n; i++) {
    p = take(c, i ? 9 : 8); // the reference sensor is only named
    if (!p) return cut(c, err);
    const uint8_t *pose = i && p[8] ? take(c, 56) : NULL;
    if (i && p[8] && !pose) return cut(c, err);
    for (int k = 0; pose && k < 7; k++) v[k] = sv_lef64(pose + 8 * k);
    const double *at = !i ? reference_pose : pose ? v : NULL;
    sv_status s = add_sensor(c, out, sv_le32(p) == 0, sv_le32(p + 4), at, err); // type 0: camera
    if (s != SV_OK) return s;
  }
  c->i++;
  return SV_OK;
}

// --- frames --------------------------------------------------------------------------------------
static sv_status add_data(const sv_colmap *c, sv_colmap_frame *f, bool is_camera, uint32_t sensor,
                          uint64_t id, sv_err *err) {
  if (!is_camera) return SV_OK;
  if (f->n_images == SV_COLMAP_CAP_DATA) return fail_at(c, err, SV_E_FULL, "a frame of more than 256 images");
  f->images[f->n_images].camera_id = sensor;
  f->images[f->n_images++].image_id = id;
  return SV_OK;
}

static sv_status text_frame(sv_colmap *c, sv_colmap_frame *out, sv_err *err) {
  sv_word line;
  double v[7];
  uint32_t n = 0, sensor;
  if (!next_entry(c, &line)) return SV_END;
  bool ok = take_u32(&line, &out->id) && take_u32(&line, &out->rig_id);
  for (int i = 0; i < 7; i++) ok = ok && take_double(&line, &v[i]);
  if (!ok || !take_u32(&line, &n))
    return fail_at(c, err, SV_E_FORMAT, "FRAME_ID RIG_ID QW QX QY QZ TX TY TZ NUM_DATA_IDS ... was expected");
  sv_status s = make_pose(c, v, &out->rig_from_world, err);
  out->n_images = 0;
  for (uint32_t i = 0; i < n && s == SV_OK; i++) {
    bool is_camera;
    long long id = -1;
    if (!take_sensor(&line, &is_camera, &sensor))
      return fail_at(c, err, SV_E_FORMAT, "SENSOR_TYPE SENSOR_ID DATA_ID was expected for each of its data");
    sv_word data = sv_word_next(&line);
    if (!sv_parse_int(data.t, data.n, &id) || id < 0)
      return fail_at(c, err, SV_E_FORMAT, "SENSOR_TYPE SENSOR_ID DATA_ID was expected for each of its data");
    s = add_data(c, out, is_camera, sensor, (uint64_t)id, err);
  }
  return s;
}

sv_status sv_colmap_next_frame(sv_colmap *c, sv_colmap_frame *out, sv_err *err) {
  if (!c->is_binary) return text_frame(c, out, err);
  if (c->i == c->n) return end_of_binary(c, err);
  const uint8_t *p = take(c, 68);
  double v[7];
  if (!p) return cut(c, err);
  out->id = sv_le32(p);
  out->rig_id = sv_le32(p + 4);
  out->n_images = 0;
  for (int i = 0; i < 7; i++) v[i] = sv_lef64(p + 8 + 8 * i);
  uint32_t n = sv_le32(p + 64);
  sv_status s = make_pose(c, v, &out->rig_from_world, err);
  for (uint32_t i = 0; i < n && s == SV_OK; i++) {
    p = take(c, 16);
    if (!p) return cut(c, err);
    s = add_data(c, out, sv_le32(p) == 0, sv_le32(p + 4), sv_le64(p + 8), err); // type 0: camera
  }
  c->i++;
  return s;
}
