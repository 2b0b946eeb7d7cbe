// SPDX-License-Identifier: Apache-2.0
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/str.h"
#include "src/format/json.h"
#include "tools/import/depth_camera.h"

#define CALIBRATION "calib.json"
#define CAP_SOCKETS 4
#define CM          0.01 // DepthAI's unit of lengths

// Streams by the sockets of DepthAI's boards: CAM_A, CAM_B, CAM_C.
enum { N = 3 };
static const char *const names[N] = {"left", "right", "color"};
static const int sockets[N] = {1, 2, 0};

typedef struct {
  bool is_there, is_fisheye;
  int width_px, height_px, parent; // parent: socket that the pose is to, -1: none
  double k[9], dist[14];
  sv_pose parent_from_cam;
} socket_t;

typedef struct {
  const lab_options *o;
  lab_session *se;
  sv_import_job job;
  sv_json json;
  void *text;
  char path[SV_CAP_PATH]; // of the calibration
  jsmntok_t *tokens;
  socket_t socket[CAP_SOCKETS];
  int i_socket[N]; // of each clip
  char paths[N][SV_CAP_PATH];
  lab_clip clips[N];
  lab_clips all;
  sv_import_camera cams[N];
} job;

// --- calibration ---------------------------------------------------------------------------------

static sv_status read_matrix(const sv_json *j, int at, double out[9], sv_err *err) {
  if (sv_json_size(j, at) != 3) return sv_json_fail(j, at, err, SV_E_FORMAT, "expected a 3x3 matrix");
  sv_status s = SV_OK;
  int row = sv_json_first(j, at);
  for (int i = 0; s == SV_OK && i < 3; i++, row = sv_json_next(j, row))
    s = sv_json_doubles(j, row, out + 3 * i, 3, err);
  return s;
}

static sv_status read_int(const sv_json *j, int at, const char *key, sv_json_range range, int *out,
                          sv_err *err) {
  long long v = 0;
  sv_status s = sv_json_get_int(j, at, key, range, &v, err);
  *out = (int)v;
  return s == SV_END ? sv_json_missing(j, at, key, err) : s;
}

static sv_status read_extrinsics(const sv_json *j, int at, socket_t *c, sv_err *err) {
  static const char *const axes[3] = {"x", "y", "z"};
  sv_status s = read_int(j, at, "toCameraSocket", (sv_json_range){-1, 255}, &c->parent, err);
  if (s != SV_OK || c->parent < 0) return s;
  s = read_matrix(j, sv_json_get(j, at, "rotationMatrix"), c->parent_from_cam.r, err);
  const int t = sv_json_get(j, at, "translation");
  for (int i = 0; s == SV_OK && i < 3; i++) {
    s = sv_json_double(j, sv_json_get(j, t, axes[i]), &c->parent_from_cam.t[i], err);
    c->parent_from_cam.t[i] *= CM;
  }
  if (s == SV_OK && sv_rotation_error(c->parent_from_cam.r) > 1e-3)
    s = sv_json_fail(j, at, err, SV_E_FORMAT, "rotationMatrix is not a rotation");
  return s;
}

static sv_status read_camera(job *j, int at, sv_err *err) {
  const sv_json *js = &j->json;
  int socket = 0, kind = 0;
  const int first = sv_json_first(js, at), c = sv_json_next(js, first);
  long long v;
  sv_status s = sv_json_int(js, first, -1, 255, &v, err);
  if (s != SV_OK || v < 0 || v >= CAP_SOCKETS) return s;
  socket = (int)v;
  socket_t *to = &j->socket[socket];
  s = read_int(js, c, "width", (sv_json_range){1, 32768}, &to->width_px, err);
  if (s == SV_OK) s = read_int(js, c, "height", (sv_json_range){1, 32768}, &to->height_px, err);
  if (s == SV_OK) s = read_int(js, c, "cameraType", (sv_json_range){0, 255}, &kind, err);
  if (s == SV_OK) s = read_matrix(js, sv_json_get(js, c, "intrinsicMatrix"), to->k, err);
  const int d = sv_json_get(js, c, "distortionCoeff");
  if (s == SV_OK && sv_json_size(js, d) != 14)
    s = sv_json_fail(js, d, err, SV_E_FORMAT, "expected 14 numbers");
  if (s == SV_OK) s = sv_json_doubles(js, d, to->dist, 14, err);
  if (s == SV_OK) s = read_extrinsics(js, sv_json_get(js, c, "extrinsics"), to, err);
  to->is_fisheye = kind != 0;
  to->is_there = s == SV_OK && to->k[0] > 0 && to->k[4] > 0;
  return s;
}

static sv_status read_calibration(job *j, sv_err *err) {
  size_t bytes;
  int n;
  sv_status s = sv_path_join(j->path, sizeof j->path, j->o->input, CALIBRATION, err);
  if (s == SV_OK) s = sv_file_read(j->path, &j->text, &bytes, err);
  if (s == SV_OK) s = sv_json_count(j->path, j->text, bytes, &n, err);
  if (s != SV_OK) return s;
  j->tokens = malloc((size_t)n * sizeof *j->tokens);
  if (!j->tokens) return sv_fail(err, SV_E_NOMEM, "%s: no memory", j->path);
  const sv_file_data file = {j->path, j->text, bytes};
  s = sv_json_parse(&j->json, &file, j->tokens, n, err);
  if (s != SV_OK) return s;
  const int list = sv_json_get(&j->json, 0, "cameraData");
  if (list < 0) return sv_json_missing(&j->json, 0, "cameraData", err);
  for (int at = sv_json_first(&j->json, list); s == SV_OK && at >= 0; at = sv_json_next(&j->json, at))
    s = read_camera(j, at, err);
  return s;
}

// Up to the socket whose pose is to none.
static sv_pose root_from(const job *j, int socket, int *root) {
  sv_pose p = sv_pose_identity();
  for (int i = 0; i < CAP_SOCKETS; i++) {
    const socket_t *c = &j->socket[socket];
    if (c->parent < 0 || c->parent >= CAP_SOCKETS || !j->socket[c->parent].is_there) break;
    p = sv_pose_mul(&c->parent_from_cam, &p);
    socket = c->parent;
  }
  *root = socket;
  return p;
}

// --- the cameras ---------------------------------------------------------------------------------

// Videos have the sensor's width; what their shape does not hold was cut off about the middle, as
// DepthAI does it.
static void fit_lens(const socket_t *from, const int size[2], sv_import_camera *c) {
  const double k = fmax((double)size[0] / from->width_px, (double)size[1] / from->height_px);
  c->calib_width_px = size[0];
  c->calib_height_px = size[1];
  c->fx = from->k[0] * k;
  c->fy = from->k[4] * k;
  // Pixel centers at integers in both.
  c->cx = (from->k[2] + 0.5) * k - 0.5 - 0.5 * (from->width_px * k - size[0]);
  c->cy = (from->k[5] + 0.5) * k - 0.5 - 0.5 * (from->height_px * k - size[1]);
  memcpy(c->dist, from->dist, sizeof c->dist);
}

static sv_status make_camera(job *j, int k, sv_err *err) {
  const socket_t *from = &j->socket[j->i_socket[k]];
  int size[2], root, first_root;
  if (!from->is_there)
    return sv_fail(err, SV_E_NOT_FOUND, "%s: has no camera of socket %d (%s)", j->path, j->i_socket[k],
                   j->cams[k].name);
  bool is_tilted = false;
  for (int i = 8; i < 14; i++) is_tilted |= from->dist[i] != 0;
  if (from->is_fisheye || is_tilted)
    return sv_fail(err, SV_E_UNSUPPORTED,
                   "%s: the lens of %s is a fisheye or has thin prism or tilt terms, which are not read",
                   j->path, j->cams[k].name);
  sv_status s = lab_media_size(&j->clips[k].stream, size, err);
  if (s != SV_OK) return s;
  fit_lens(from, size, &j->cams[k]);
  const sv_pose mine = root_from(j, j->i_socket[k], &root), first = root_from(j, j->i_socket[0], &first_root);
  if (root != first_root)
    return sv_fail(err, SV_E_NOT_FOUND, "%s: tells no pose between %s and %s", j->path, j->cams[0].name,
                   j->cams[k].name);
  const sv_pose back = sv_pose_inv(&mine);
  j->cams[k].cam_from_world = sv_pose_mul(&back, &first);
  return SV_OK;
}

static sv_status find_clips(job *j, sv_err *err) {
  static const char *const ends[] = {"mp4", "mjpeg", "h264", "h265", "avi", "mkv"};
  for (int i = 0; i < N; i++)
    for (size_t e = 0; e < sizeof ends / sizeof *ends; e++) {
      char name[40];
      const int k = j->all.n;
      snprintf(name, sizeof name, "%s.%s", names[i], ends[e]);
      sv_status s = sv_path_join(j->paths[k], sizeof j->paths[k], j->o->input, name, err);
      if (s != SV_OK) return s;
      if (!sv_path_exists(j->paths[k])) continue;
      j->clips[k].stream = (lab_media_stream){j->paths[k], "0:v:0", NULL, &j->se->console};
      snprintf(j->cams[k].name, sizeof j->cams[k].name, "%s", names[i]);
      j->i_socket[k] = sockets[i];
      if ((s = lab_media_scan(&j->clips[k].stream, &j->clips[k].frames, err)) != SV_OK) return s;
      j->all.n++;
      break;
    }
  return j->all.n ? SV_OK
                  : sv_fail(err, SV_E_NOT_FOUND,
                            "%s: expected left, right or color as .mp4, .mjpeg, .h264 or .h265", j->o->input);
}

static sv_status run(job *j, sv_err *err) {
  sv_status s = sv_import_begin(&j->job, err);
  if (s == SV_OK) s = read_calibration(j, err);
  if (s == SV_OK) s = find_clips(j, err);
  for (int k = 0; s == SV_OK && k < j->all.n; k++) s = make_camera(j, k, err);
  if (s == SV_OK) s = lab_clips_pair(&j->all, j->o->every_s, err);
  if (s == SV_OK) s = lab_clips_write(&j->job, &j->all, j->cams, err);
  if (s == SV_OK) s = sv_import_write(&j->job, "oak", j->all.fps, j->cams, j->all.n, err);
  else
    for (int k = 0; k < N; k++) free(j->cams[k].times_ns);
  if (s == SV_OK) lab_say(j->se, "%s: %d exposures of %d cameras", j->o->out, j->all.n_exposures, j->all.n);
  return s;
}

sv_status lab_import_oak(const lab_options *o, lab_session *se, sv_err *err) {
  job *j = calloc(1, sizeof *j);
  if (!j) return sv_fail(err, SV_E_NOMEM, "%s: no memory", o->input);
  *j = (job){.o = o, .se = se, .job = {o->input, o->out, se->console}};
  j->all.clips = j->clips;
  const sv_status s = run(j, err);
  lab_clips_free(&j->all);
  free(j->tokens);
  free(j->text);
  free(j);
  return s;
}
