// SPDX-License-Identifier: Apache-2.0
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/str.h"
#include "tools/import/depth_camera.h"

#define CALIBRATION  "calibration.txt"
#define DEPTH_UNIT_M 0.001 // of D400 cameras, unless told

enum { LEFT, RIGHT, COLOR, N_PICTURES, DEPTH = N_PICTURES, N_STREAMS };
static const char *const streams[N_STREAMS] = {"Infrared 1", "Infrared 2", "Color", "Depth"};
static const char *const names[N_PICTURES] = {"left", "right", "color"};

typedef struct {
  double time_s;
  char file[256];
} picture;

typedef struct {
  const lab_options *o;
  lab_session *se;
  sv_import_job job;
  char *text; // of the calibration
  picture *pictures[N_STREAMS];
  int n[N_STREAMS], cap[N_STREAMS];
  int stream_of[N_PICTURES]; // of each camera
  lab_clip clips[N_PICTURES];
  lab_clips all;
  sv_import_camera cams[N_PICTURES];
  int n_depths;
} job;

// --- files ---------------------------------------------------------------------------------------

// "x_Infrared 1_1700000000000.12345.png": the stream and its time.
static bool parse_name(const char *name, int *stream, double *time_s) {
  const char *end = sv_path_extension(name);
  const bool is_raw = sv_str_eq(end, ".raw");
  if (!is_raw && !sv_str_eq(end, ".png")) return false;
  for (int k = 0; k < N_STREAMS; k++) {
    char mark[32];
    snprintf(mark, sizeof mark, "_%s_", streams[k]);
    const char *at = strstr(name, mark);
    double ms;
    if (!at || is_raw != (k == DEPTH)) continue;
    at += strlen(mark);
    if (!sv_parse_double(at, (size_t)(end - at), &ms) || !(ms >= 0 && ms < 1e14)) continue;
    *stream = k;
    *time_s = ms * 1e-3;
    return true;
  }
  return false;
}

static int by_time(const void *a, const void *b) {
  const picture *x = a, *y = b;
  return x->time_s < y->time_s ? -1 : x->time_s > y->time_s;
}

static sv_status add_picture(job *j, const char *name, sv_err *err) {
  picture p;
  int k;
  if (!parse_name(name, &k, &p.time_s)) return SV_OK;
  if (!sv_copy(p.file, sizeof p.file, name)) return SV_OK;
  if (j->n[k] == j->cap[k]) {
    j->cap[k] = j->cap[k] ? 2 * j->cap[k] : 256;
    picture *more = realloc(j->pictures[k], (size_t)j->cap[k] * sizeof *more);
    if (!more) return sv_fail(err, SV_E_NOMEM, "%s: no memory for its list of files", j->o->input);
    j->pictures[k] = more;
  }
  j->pictures[k][j->n[k]++] = p;
  return SV_OK;
}

static sv_status find_pictures(job *j, sv_err *err) {
  sv_names files;
  sv_status s = sv_folder_list(j->o->input, &files, err);
  if (s != SV_OK) return s;
  for (int i = 0; s == SV_OK && i < files.n; i++) s = add_picture(j, files.names[i], err);
  sv_names_free(&files);
  for (int k = 0; k < N_STREAMS; k++)
    if (j->n[k]) qsort(j->pictures[k], (size_t)j->n[k], sizeof(picture), by_time);
  for (int k = 0; k < N_PICTURES; k++)
    if (j->n[k]) j->stream_of[j->all.n++] = k;
  return s != SV_OK || j->all.n ? s
                                : sv_fail(err, SV_E_NOT_FOUND,
                                          "%s: expected pictures of rs-convert -p: PREFIX_Color_TIME.png, "
                                          "PREFIX_Infrared 1_TIME.png",
                                          j->o->input);
}

// --- calibration ---------------------------------------------------------------------------------

// The numbers behind a key, within a section.
static bool numbers(const char *from, const char *end, const char *key, int n, double *out) {
  const char *p = strstr(from, key);
  if (!p || p >= end) return false;
  p += strlen(key);
  for (int i = 0; i < n; i++) {
    char *stop;
    out[i] = strtod(p, &stop);
    if (stop == p || stop > end || !isfinite(out[i])) return false;
    p = stop;
  }
  return true;
}

static const char *section_end(const char *p) {
  const char *a = strstr(p, "Intrinsic of"), *b = strstr(p, "Extrinsic");
  if (!a || (b && b < a)) a = b;
  return a ? a : p + strlen(p);
}

static sv_status read_lens(job *j, int stream, int w, int h, sv_import_camera *c, sv_err *err) {
  char head[64];
  double f[2], center[2];
  snprintf(head, sizeof head, "Intrinsic of \"%s\" / %dx%d", streams[stream], w, h);
  const char *p = strstr(j->text, head);
  if (!p) return sv_fail(err, SV_E_NOT_FOUND, "%s/" CALIBRATION ": has no section '%s'", j->o->input, head);
  p += strlen(head);
  const char *end = section_end(p), *model = strstr(p, "Distortion:");
  if (!numbers(p, end, "PPX:", 1, &center[0]) || !numbers(p, end, "PPY:", 1, &center[1]) ||
      !numbers(p, end, "Fx:", 1, &f[0]) || !numbers(p, end, "Fy:", 1, &f[1]) ||
      !numbers(p, end, "Coeffs:", 5, c->dist) || !model || model >= end || !(f[0] > 0 && f[1] > 0))
    return sv_fail(err, SV_E_FORMAT,
                   "%s/" CALIBRATION ": '%s': expected PPX, PPY, Fx, Fy, Distortion and 5 Coeffs",
                   j->o->input, head);
  const bool is_distorted =
      c->dist[0] != 0 || c->dist[1] != 0 || c->dist[2] != 0 || c->dist[3] != 0 || c->dist[4] != 0;
  model += strcspn(model, "\n") < 12 ? 0 : 11;
  model += strspn(model, " \t");
  // The other models of the library map pixels the other way round.
  if (is_distorted && strncmp(model, "Brown Conrady", 13) != 0)
    return sv_fail(err, SV_E_UNSUPPORTED,
                   "%s/" CALIBRATION ": '%s' has the distortion '%.*s'; only Brown Conrady is read",
                   j->o->input, head, (int)strcspn(model, "\r\n"), model);
  c->calib_width_px = w;
  c->calib_height_px = h;
  c->fx = f[0];
  c->fy = f[1];
  c->cx = center[0];
  c->cy = center[1];
  return SV_OK;
}

// to_from_from of two streams.
static sv_status read_pose(job *j, int from, int to, sv_pose *out, sv_err *err) {
  *out = sv_pose_identity();
  if (from == to) return SV_OK;
  char head[80];
  snprintf(head, sizeof head, "Extrinsic from \"%s\"", streams[from]);
  for (const char *p = strstr(j->text, head); p; p = strstr(p + 1, head)) {
    const char *name = p + strlen(head), *end = section_end(p + 1);
    name += strspn(name, " \t");
    if (strncmp(name, "To", 2) != 0) continue;
    name += 2;
    name += strspn(name, " \t");
    const size_t n = strlen(streams[to]);
    if (name[0] != '"' || strncmp(name + 1, streams[to], n) != 0 || name[n + 1] != '"') continue;
    if (numbers(name, end, "Rotation Matrix:", 9, out->r) &&
        numbers(name, end, "Translation Vector:", 3, out->t))
      return SV_OK;
    break;
  }
  return sv_fail(err, SV_E_NOT_FOUND,
                 "%s/" CALIBRATION
                 ": no rotation and translation from \"%s\" to \"%s\" (rs-enumerate-devices -c)",
                 j->o->input, streams[from], streams[to]);
}

static sv_status make_cameras(job *j, sv_err *err) {
  for (int k = 0; k < j->all.n; k++) {
    const int stream = j->stream_of[k];
    sv_import_camera *c = &j->cams[k];
    char path[SV_CAP_PATH];
    sv_bitmap b = {0};
    snprintf(c->name, sizeof c->name, "%s", names[stream]);
    sv_status s = sv_path_join(path, sizeof path, j->o->input, j->pictures[stream][0].file, err);
    if (s == SV_OK) s = sv_bitmap_read(path, &b, err);
    if (s == SV_OK) s = read_lens(j, stream, b.width_px, b.height_px, c, err);
    sv_bitmap_free(&b);
    if (s == SV_OK) s = read_pose(j, j->stream_of[0], stream, &c->cam_from_world, err);
    if (s != SV_OK) return s;
  }
  return SV_OK;
}

// --- exposures -----------------------------------------------------------------------------------

static sv_status pair(job *j, sv_err *err) {
  for (int k = 0; k < j->all.n; k++) {
    const int stream = j->stream_of[k];
    lab_media_frames *f = &j->clips[k].frames;
    j->clips[k].stream.path = j->o->input;
    f->times_s = calloc((size_t)j->n[stream], sizeof *f->times_s);
    if (!f->times_s) return sv_fail(err, SV_E_NOMEM, "%s: no memory for its times", j->o->input);
    for (int i = 0; i < j->n[stream]; i++) f->times_s[f->n++] = j->pictures[stream][i].time_s;
  }
  j->all.clips = j->clips;
  return lab_clips_pair(&j->all, j->o->every_s, err);
}

static sv_status copy_picture(job *j, int k, int i, sv_err *err) {
  char from[SV_CAP_PATH], to[SV_CAP_PATH], name[80];
  void *data;
  size_t bytes;
  snprintf(name, sizeof name, "%.40s/%06d.png", j->cams[k].name, i);
  sv_status s = sv_path_join(from, sizeof from, j->o->input,
                             j->pictures[j->stream_of[k]][j->clips[k].kept[i]].file, err);
  if (s == SV_OK) s = sv_path_join(to, sizeof to, j->o->out, name, err);
  if (s == SV_OK) s = sv_file_read(from, &data, &bytes, err);
  if (s != SV_OK) return s;
  s = sv_file_write(to, data, bytes, err);
  free(data);
  return s;
}

static sv_status copy_camera(job *j, int k, sv_err *err) {
  sv_import_camera *c = &j->cams[k];
  const lab_media_frames *f = &j->clips[k].frames;
  c->is_made = true;
  c->n_times = j->all.n_exposures;
  c->times_ns = calloc((size_t)c->n_times, sizeof(sv_ns));
  if (!c->times_ns) return sv_fail(err, SV_E_NOMEM, "%s: no memory for its times", j->o->input);
  sv_status s = lab_clips_clear(&j->job, c->name, err);
  for (int i = 0; s == SV_OK && i < c->n_times; i++) {
    // Captures count from near 0.
    const double t = f->times_s[j->clips[k].kept[i]] - j->clips[0].frames.times_s[j->clips[0].kept[0]];
    c->times_ns[i] = SV_NS_PER_S + (sv_ns)llrint(t * 1e9);
    s = copy_picture(j, k, i, err);
  }
  return s;
}

// --- depth ---------------------------------------------------------------------------------------

// A raw file of 16 bits a pixel, rows from the top -> meters as PFM, rows from the bottom.
static sv_status convert_depth(job *j, const char *file, const char *to, sv_err *err) {
  const sv_import_camera *c = &j->cams[0];
  const size_t w = (size_t)c->calib_width_px, h = (size_t)c->calib_height_px;
  const double unit_m = j->o->unit_m > 0 ? j->o->unit_m : DEPTH_UNIT_M;
  char path[SV_CAP_PATH], head[48];
  void *data = NULL;
  size_t bytes;
  sv_status s = sv_path_join(path, sizeof path, j->o->input, file, err);
  if (s == SV_OK) s = sv_file_read(path, &data, &bytes, err);
  if (s == SV_OK && bytes != 2 * w * h)
    s = sv_fail(err, SV_E_FORMAT, "%s: %zu bytes, expected %dx%d depths of 16 bits as the left picture has",
                path, bytes, c->calib_width_px, c->calib_height_px);
  const int n_head = snprintf(head, sizeof head, "Pf\n%zu %zu\n-1.0\n", w, h);
  uint8_t *out = s == SV_OK ? malloc((size_t)n_head + 4 * w * h) : NULL;
  if (s == SV_OK && !out) s = sv_fail(err, SV_E_NOMEM, "%s: no memory", path);
  if (s == SV_OK) {
    const uint8_t *raw = data;
    memcpy(out, head, (size_t)n_head);
    for (size_t i = 0; i < w * h; i++) {
      const size_t from = (h - 1 - i / w) * w + i % w;
      const float m = (float)((raw[2 * from] | raw[2 * from + 1] << 8) * unit_m);
      memcpy(out + (size_t)n_head + 4 * i, &m, sizeof m);
    }
    s = sv_file_write(to, out, (size_t)n_head + 4 * w * h, err);
  }
  free(out);
  free(data);
  return s;
}

// Depth is that of the left imager of these cameras: frames of the same time.
static sv_status take_depth(job *j, sv_err *err) {
  sv_import_camera *c = &j->cams[0];
  sv_pose to_left;
  if (!j->n[DEPTH]) return SV_OK;
  if (j->stream_of[0] != LEFT) {
    lab_say(j->se, "depth is left out: it belongs to the stream Infrared 1, which was not recorded");
    return SV_OK;
  }
  sv_status s = read_pose(j, DEPTH, LEFT, &to_left, err);
  if (s == SV_OK &&
      (fabs(to_left.t[0]) > 1e-4 || sv_rotation_error(to_left.r) > 1e-4 || to_left.r[0] < 0.9999))
    s = sv_fail(err, SV_E_UNSUPPORTED, "%s/" CALIBRATION ": depth is not that of the stream Infrared 1",
                j->o->input);
  if (s == SV_OK) s = lab_clips_clear(&j->job, "left_depth", err);
  for (int i = 0, d = 0; s == SV_OK && i < j->all.n_exposures; i++) {
    const double t = j->clips[0].frames.times_s[j->clips[0].kept[i]];
    char to[SV_CAP_PATH], name[40];
    while (d + 1 < j->n[DEPTH] && j->pictures[DEPTH][d].time_s < t - 1e-3) d++;
    if (fabs(j->pictures[DEPTH][d].time_s - t) > 1e-3) continue;
    snprintf(name, sizeof name, "left_depth/%06d.pfm", i);
    s = sv_path_join(to, sizeof to, j->o->out, name, err);
    if (s == SV_OK) s = convert_depth(j, j->pictures[DEPTH][d].file, to, err);
    j->n_depths += s == SV_OK;
  }
  if (j->n_depths) snprintf(c->depth, sizeof c->depth, "left_depth");
  return s;
}

// --- all of it -----------------------------------------------------------------------------------

static sv_status run(job *j, sv_err *err) {
  sv_status s = sv_import_begin(&j->job, err);
  if (s == SV_OK && !(j->text = sv_import_text(j->o->input, CALIBRATION, err))) s = err->status;
  if (s == SV_OK) s = find_pictures(j, err);
  if (s == SV_OK) s = make_cameras(j, err);
  if (s == SV_OK) s = pair(j, err);
  for (int k = 0; s == SV_OK && k < j->all.n; k++) s = copy_camera(j, k, err);
  if (s == SV_OK) s = take_depth(j, err);
  if (s == SV_OK) s = sv_import_write(&j->job, "realsense", j->all.fps, j->cams, j->all.n, err);
  else
    for (int k = 0; k < N_PICTURES; k++) free(j->cams[k].times_ns);
  if (s == SV_OK)
    lab_say(j->se, "%s: %d exposures of %d cameras, %d with depth", j->o->out, j->all.n_exposures, j->all.n,
            j->n_depths);
  return s;
}

sv_status lab_import_realsense(const lab_options *o, lab_session *se, sv_err *err) {
  job *j = calloc(1, sizeof *j);
  if (!j) return sv_fail(err, SV_E_NOMEM, "%s: no memory", o->input);
  *j = (job){.o = o, .se = se, .job = {o->input, o->out, se->console}};
  j->all.clips = j->clips;
  const sv_status s = run(j, err);
  lab_clips_free(&j->all);
  for (int k = 0; k < N_STREAMS; k++) free(j->pictures[k]);
  free(j->text);
  free(j);
  return s;
}
