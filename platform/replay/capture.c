// SPDX-License-Identifier: Apache-2.0
#include "platform/replay/capture.h"

#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define JSMN_STATIC
#define JSMN_STRICT
#define JSMN_PARENT_LINKS // without them the time grows with the square of the number of frames
#include <jsmn.h>

#include "platform/linux/linux.h"
#include "platform/replay/capture_writer.h"
#include "src/base/mathx.h"
#include "src/base/str.h"
#include "src/base/vec.h"
#include "src/rig/limits.h"

#define MAX_JSON_BYTES (512u << 20)
#define MAX_SIDE_PX    32768
#define MOST_BRACKETS  16
#define MAX_NS         (INT64_MAX / 8) // also keeps numbers within 18 digits
#define MAX_DEPTH      32

typedef struct {
  char *text;
  const char *where;
  jsmntok_t *tokens;
  int n_tokens;
  sv_err *err;
} json_t;

// --- small parts ---------------------------------------------------------------------------------
static bool is_key(const json_t *j, int t, const char *key) {
  size_t n = (size_t)(j->tokens[t].end - j->tokens[t].start);
  return j->tokens[t].type == JSMN_STRING && n == strlen(key) &&
         !memcmp(j->text + j->tokens[t].start, key, n);
}

// The token after t and all that it holds. Tokens stand in the order of the text.
static int next_token(const json_t *j, int t) {
  int end = j->tokens[t].end;
  for (t++; t < j->n_tokens && j->tokens[t].start < end; t++) {
  }
  return t;
}

// The value of a key of object t, or -1.
static int find(const json_t *j, int t, const char *key) {
  int k = t + 1;
  for (int i = 0; i < j->tokens[t].size && k + 1 < j->n_tokens; i++) {
    if (is_key(j, k, key)) return k + 1;
    k = next_token(j, k + 1);
  }
  return -1;
}

static int line_of(const json_t *j, int t) {
  int line = 1;
  for (int i = 0; i < j->tokens[t].start; i++) line += j->text[i] == '\n';
  return line;
}

static sv_status bad(const json_t *j, int t, const char *key, const char *expected) {
  return sv_fail(j->err, SV_E_FORMAT, "%s: line %d: \"%s\" is missing or wrong, expected %s", j->where,
                 line_of(j, t), key, expected);
}

static bool read_double(const json_t *j, int t, double *out) {
  const jsmntok_t *k = &j->tokens[t];
  return k->type == JSMN_PRIMITIVE && sv_parse_double(j->text + k->start, (size_t)(k->end - k->start), out);
}

static bool read_doubles(const json_t *j, int t, int n, double *out) {
  if (t < 0 || j->tokens[t].type != JSMN_ARRAY || j->tokens[t].size != n) return false;
  for (int i = 0; i < n; i++)
    if (t + 1 + i >= j->n_tokens || !read_double(j, t + 1 + i, &out[i])) return false;
  return true;
}

// A whole number in [lo, hi]; absent: `otherwise`. lo > otherwise makes the key necessary.
typedef struct {
  const char *key;
  int64_t lo, hi, otherwise;
  const char *expected; // for messages
} int_key;

static sv_status get_int(const json_t *j, int t, const int_key *k, int64_t *out) {
  int v = find(j, t, k->key);
  long long x = k->otherwise;
  if (v >= 0 &&
      (j->tokens[v].type != JSMN_PRIMITIVE ||
       !sv_parse_int(j->text + j->tokens[v].start, (size_t)(j->tokens[v].end - j->tokens[v].start), &x)))
    return bad(j, v, k->key, k->expected);
  if (x < k->lo || x > k->hi) return bad(j, v >= 0 ? v : t, k->key, k->expected);
  *out = x;
  return SV_OK;
}

// A plain string: no escapes, no control bytes. Terminated in place, over its closing quote.
static bool get_text(const json_t *j, int v, const char **out) {
  const jsmntok_t *k = &j->tokens[v];
  if (k->type != JSMN_STRING) return false;
  for (int i = k->start; i < k->end; i++)
    if (j->text[i] == '\\' || (unsigned char)j->text[i] < 0x20) return false;
  j->text[k->end] = 0;
  *out = j->text + k->start;
  return true;
}

// A path below the capture's folder.
static bool is_below(const char *p) {
  if (!p[0] || p[0] == '/') return false;
  for (const char *q = p; q; q = strchr(q, '/') ? strchr(q, '/') + 1 : NULL)
    if (!strncmp(q, "..", 2) && (q[2] == '/' || !q[2])) return false;
  return strlen(p) < 256;
}

// --- the parts of the file -----------------------------------------------------------------------
static sv_status read_frame(const json_t *j, int t, int i, sv_capture_frame *f) {
  if (j->tokens[t].type != JSMN_OBJECT) return bad(j, t, "frames", "a list of objects");
  int v = find(j, t, "file");
  *f = (sv_capture_frame){0};
  if (v < 0 || !get_text(j, v, &f->file) || !is_below(f->file))
    return bad(j, t, "file", "a plain path below the camera's folder");
  static const char whole_ns[] = "a whole number of nanoseconds";
  int64_t seq = 0;
  sv_status s =
      get_int(j, t, &(int_key){"sequence", 0, UINT32_MAX, i, "a whole number from 0 to 4294967295"}, &seq);
  f->sequence = (uint32_t)seq;
  if (s == SV_OK)
    s = get_int(j, t, &(int_key){"camera_ns", -MAX_NS, MAX_NS, INT64_MIN, whole_ns}, &f->camera_ns);
  if (s == SV_OK)
    s = get_int(j, t, &(int_key){"arrival_ns", -MAX_NS, MAX_NS, f->camera_ns, whole_ns}, &f->arrival_ns);
  if (s == SV_OK) s = get_int(j, t, &(int_key){"exposure_ns", 0, MAX_NS, 0, whole_ns}, &f->exposure_ns);
  return s;
}

static sv_status read_frames(const json_t *j, int t, sv_capture_camera *c, sv_capture_frame **pool) {
  c->frames = *pool;
  int k = t + 1;
  for (int i = 0; i < j->tokens[t].size && k < j->n_tokens; i++) {
    sv_status s = read_frame(j, k, i, &c->frames[i]);
    if (s < 0) return s;
    if (i && c->frames[i].arrival_ns < c->frames[i - 1].arrival_ns)
      return bad(j, k, "arrival_ns", "frames in order of arrival");
    k = next_token(j, k);
  }
  c->n_frames = j->tokens[t].size;
  *pool += c->n_frames;
  return SV_OK;
}

// One of several words; absent: `otherwise`.
typedef struct {
  const char *key;
  const char *const *words;
  int n, otherwise;
  const char *expected; // for messages
} choice_key;

static sv_status read_choice(const json_t *j, int t, const choice_key *k, int *out) {
  int v = find(j, t, k->key);
  *out = k->otherwise;
  if (v < 0) return SV_OK;
  for (int i = 0; i < k->n; i++)
    if (is_key(j, v, k->words[i])) {
      *out = i;
      return SV_OK;
    }
  return bad(j, v, k->key, k->expected);
}

// What the frames show of the sensor, as the camera reported it.
static sv_status read_area(const json_t *j, int t, sv_sensor_area *out) {
  const int v = find(j, t, "sensor"), w = find(j, t, "area");
  double s[2], a[4];
  if (v < 0 && w < 0) return SV_OK;
  if (!read_doubles(j, v, 2, s) || !(s[0] >= 1 && s[1] >= 1 && s[0] <= MAX_SIDE_PX && s[1] <= MAX_SIDE_PX))
    return bad(j, v < 0 ? t : v, "sensor", "the sensor's width and height, 1 to 32768 px");
  if (!read_doubles(j, w, 4, a) ||
      !(a[0] >= 0 && a[1] >= 0 && a[2] >= 1 && a[3] >= 1 && a[0] + a[2] <= s[0] && a[1] + a[3] <= s[1]))
    return bad(j, w < 0 ? t : w, "area", "x, y, width and height inside of the sensor");
  *out = (sv_sensor_area){(int)s[0], (int)s[1], a[0], a[1], a[2], a[3]};
  return SV_OK;
}

static sv_status read_camera(const json_t *j, int t, sv_capture_camera *c, sv_capture_frame **pool) {
  static const char *const clocks[] = {"camera", "monotonic", "boottime", "realtime"};
  static const char *const stamps[] = {"start", "middle", "end"};
  static const char *const lights[] = {"free", "told", "locked", "shared", "told_shared"};
  if (j->tokens[t].type != JSMN_OBJECT) return bad(j, t, "cameras", "a list of objects");
  *c = (sv_capture_camera){.caps = {.format = SV_PIX_RGB8}};
  const char *name = "";
  int v = find(j, t, "name"), clock = 0, stamp = 0, light = 0;
  if (v < 0 || !get_text(j, v, &name) || !sv_copy(c->caps.name, sizeof c->caps.name, name))
    return bad(j, t, "name", "a plain string of up to 47 bytes");
  v = find(j, t, "folder");
  if (v < 0 || !get_text(j, v, &c->folder) || !is_below(c->folder))
    return bad(j, t, "folder", "a plain path below the capture's folder");
  v = find(j, t, "depth");
  if (v >= 0 && (!get_text(j, v, &c->depth) || !is_below(c->depth)))
    return bad(j, v, "depth", "a plain path below the capture's folder");
  int64_t w = 0, h = 0;
  sv_status s = get_int(j, t, &(int_key){"width", 1, MAX_SIDE_PX, 0, "1 to 32768 px"}, &w);
  if (s == SV_OK) s = get_int(j, t, &(int_key){"height", 1, MAX_SIDE_PX, 0, "1 to 32768 px"}, &h);
  if (s == SV_OK)
    s = read_choice(
        j, t,
        &(choice_key){"clock", clocks, 4, SV_CLOCK_MONOTONIC, "camera, monotonic, boottime or realtime"},
        &clock);
  if (s == SV_OK)
    s = read_choice(j, t, &(choice_key){"stamp", stamps, 3, SV_STAMP_START, "start, middle or end"}, &stamp);
  if (s == SV_OK)
    s = read_choice(j, t, &(choice_key){"light", lights, 5, 0, "free, told, locked, shared or told_shared"},
                    &light);
  if (s < 0) return s;
  v = find(j, t, "fps");
  if (v >= 0 && (!read_double(j, v, &c->caps.fps) || c->caps.fps < 0 || c->caps.fps > 1e6))
    return bad(j, v, "fps", "frames per second, 0 when unknown");
  c->caps.width_px = (int)w;
  c->caps.height_px = (int)h;
  c->caps.clock = (sv_clock_id)clock;
  c->caps.stamp = (sv_stamp_source)stamp;
  c->caps.is_exposure_told = light > 0;
  c->caps.is_light_locked = light == 2 || light == 3;
  c->caps.is_light_shared = light > 2;
  int64_t bits = 8, n_brackets = 0;
  s = get_int(j, t, &(int_key){"brackets", 0, MOST_BRACKETS, 0, "0 to 16"}, &n_brackets);
  if (s < 0) return s;
  c->caps.n_brackets = (int)n_brackets;
  s = get_int(j, t, &(int_key){"bits", 8, 16, 8, "8 or 16"}, &bits);
  if (s == SV_OK && bits != 8 && bits != 16) s = bad(j, find(j, t, "bits"), "bits", "8 or 16");
  if (s < 0) return s;
  if ((s = read_area(j, t, &c->caps.area)) < 0) return s;
  if (bits == 16) c->caps.format = SV_PIX_RGB16;
  c->caps.frame_bytes = (size_t)w * (size_t)h * 3 * (size_t)(bits / 8);
  v = find(j, t, "frames");
  if (v < 0 || j->tokens[v].type != JSMN_ARRAY) return bad(j, t, "frames", "a list");
  return read_frames(j, v, c, pool);
}

static sv_status read_pose(const json_t *j, int t, sv_capture_pose *p) {
  double v[7];
  if (j->tokens[t].type != JSMN_OBJECT) return bad(j, t, "poses", "a list of objects");
  sv_status s = get_int(
      j, t, &(int_key){"time_ns", -MAX_NS, MAX_NS, INT64_MIN, "a whole number of nanoseconds"}, &p->time_ns);
  if (s < 0) return s;
  double n = 0;
  if (read_doubles(j, find(j, t, "rig_from_world"), 7, v))
    n = v[0] * v[0] + v[1] * v[1] + v[2] * v[2] + v[3] * v[3];
  if (!(n > 0.99 && n < 1.01))
    return bad(j, t, "rig_from_world", "a unit quaternion w,x,y,z and a translation");
  memcpy(p->q_wxyz, v, sizeof p->q_wxyz);
  memcpy(p->t_m, v + 4, sizeof p->t_m);
  sv_pose pose = {.t = {v[4], v[5], v[6]}};
  sv_quat_to_mat(pose.r, v);
  return sv_limits_check_pose(&pose, j->where, j->err);
}

static sv_status read_poses(const json_t *j, int t, sv_capture *c) {
  if (j->tokens[t].type != JSMN_ARRAY) return bad(j, t, "poses", "a list");
  int k = t + 1;
  for (int i = 0; i < j->tokens[t].size && k < j->n_tokens; i++) {
    sv_status s = read_pose(j, k, &c->poses[i]);
    if (s < 0) return s;
    if (i && c->poses[i].time_ns <= c->poses[i - 1].time_ns)
      return bad(j, k, "time_ns", "poses in order of time");
    k = next_token(j, k);
  }
  c->n_poses = j->tokens[t].size;
  const int sigma = find(j, 0, "scale_sigma");
  c->scale_sigma = 0;
  if (sigma >= 0 && (!read_double(j, sigma, &c->scale_sigma) || !(c->scale_sigma >= 0 && c->scale_sigma < 1)))
    return bad(j, sigma, "scale_sigma", "a share from 0 to 1");
  return SV_OK;
}

void sv_capture_scene(const sv_capture *c, double centre[3], double *radius) {
  double half[3];
  for (int i = 0; i < 3; i++) {
    centre[i] = 0.5 * (c->scene_max_m[i] + c->scene_min_m[i]);
    half[i] = 0.5 * (c->scene_max_m[i] - c->scene_min_m[i]);
  }
  *radius = sv_norm3(half);
}

static sv_status read_head(const json_t *j, sv_capture *c) {
  if (j->n_tokens < 1 || j->tokens[0].type != JSMN_OBJECT)
    return sv_fail(j->err, SV_E_FORMAT, "%s: expected one JSON object", j->where);
  int64_t version;
  sv_status s = get_int(j, 0, &(int_key){"version", 1, 1, 0, "1, the only version there is"}, &version);
  if (s < 0) return s;
  int v = find(j, 0, "name");
  if (v >= 0 && !get_text(j, v, &c->name)) return bad(j, v, "name", "a plain string");
  v = find(j, 0, "rig");
  if (v >= 0 && (!get_text(j, v, &c->rig) || c->rig[0] == '/')) return bad(j, v, "rig", "a relative path");
  v = find(j, 0, "scene");
  if (v < 0) return SV_OK;
  c->has_scene = j->tokens[v].type == JSMN_OBJECT &&
                 read_doubles(j, find(j, v, "min_m"), 3, c->scene_min_m) &&
                 read_doubles(j, find(j, v, "max_m"), 3, c->scene_max_m);
  if (!c->has_scene) return bad(j, v, "scene", "min_m and max_m, three numbers each");
  double centre[3], radius;
  sv_capture_scene(c, centre, &radius);
  return sv_limits_check_scene(centre, radius, j->where, j->err);
}

static sv_status read_all(const json_t *j, sv_capture *c, sv_capture_frame *pool) {
  sv_status s = read_head(j, c);
  if (s < 0) return s;
  int v = find(j, 0, "cameras");
  if (v < 0 || j->tokens[v].type != JSMN_ARRAY || j->tokens[v].size < 1 ||
      j->tokens[v].size > SV_CAP_SUB_VIEWS)
    return bad(j, v < 0 ? 0 : v, "cameras", "a list of 1 to 256 cameras");
  int k = v + 1, n = j->tokens[v].size;
  for (int i = 0; i < n && k < j->n_tokens; i++) {
    s = read_camera(j, k, &c->cameras[i], &pool);
    if (s < 0) return s;
    c->n_cameras++;
    c->n_frames += c->cameras[i].n_frames;
    k = next_token(j, k);
  }
  v = find(j, 0, "poses");
  return v < 0 ? SV_OK : read_poses(j, v, c);
}

// --- memory --------------------------------------------------------------------------------------
// Upper bounds by a glance at the text: each token but the first follows one of { [ , : and each
// frame, pose and camera opens a brace.
static bool count(const char *text, size_t bytes, size_t *n_tokens, size_t *n_objects) {
  size_t depth = 0;
  *n_tokens = 1;
  *n_objects = 0;
  for (size_t i = 0; i < bytes; i++) {
    char c = text[i];
    *n_tokens += c == '{' || c == '[' || c == ',' || c == ':';
    *n_objects += c == '{';
    if (c == '{' || c == '[') depth++;
    else if ((c == '}' || c == ']') && depth) depth--;
    if (depth > MAX_DEPTH) return false;
  }
  return true;
}

sv_status sv_capture_parse(sv_capture *c, char *text, size_t bytes, const char *where, sv_arena *arena,
                           sv_err *err) {
  *c = (sv_capture){.name = "", .rig = ""};
  size_t n_tokens, n_objects;
  if (bytes > MAX_JSON_BYTES || !count(text, bytes, &n_tokens, &n_objects))
    return sv_fail(err, SV_E_FORMAT, "%s: nested deeper than %d levels or larger than %u bytes", where,
                   MAX_DEPTH, MAX_JSON_BYTES);
  size_t n_cameras = n_objects < SV_CAP_SUB_VIEWS ? n_objects : SV_CAP_SUB_VIEWS;
  c->cameras = SV_TAKE(arena, sv_capture_camera, n_cameras);
  sv_capture_frame *pool = SV_TAKE(arena, sv_capture_frame, n_objects);
  c->poses = SV_TAKE(arena, sv_capture_pose, n_objects);
  size_t mark = sv_arena_mark(arena);
  json_t j = {text, where, SV_TAKE(arena, jsmntok_t, n_tokens), 0, err};
  if (arena->status < 0)
    return sv_fail(err, arena->status, "%s: its %zu frames and %zu tokens do not fit into the memory left",
                   where, n_objects, n_tokens);
  jsmn_parser parser;
  jsmn_init(&parser);
  j.n_tokens = jsmn_parse(&parser, text, bytes, j.tokens, (unsigned)n_tokens);
  sv_status s;
  if (j.n_tokens < 0) s = sv_fail(err, SV_E_FORMAT, "%s: not valid JSON near byte %u", where, parser.pos);
  else s = read_all(&j, c, pool);
  sv_arena_reset(arena, mark);
  return s;
}

static sv_status read_text(int fd, const char *path, char **text, size_t *bytes, sv_arena *arena,
                           sv_err *err) {
  struct stat st;
  if (fstat(fd, &st) < 0 || !S_ISREG(st.st_mode) || (uint64_t)st.st_size > MAX_JSON_BYTES)
    return sv_fail(err, SV_E_IO, "%s: not a regular file of up to %u bytes", path, MAX_JSON_BYTES);
  *bytes = (size_t)st.st_size;
  *text = SV_TAKE(arena, char, *bytes + 1);
  if (arena->status < 0)
    return sv_fail(err, arena->status, "%s: its %zu bytes do not fit into the memory left", path, *bytes);
  for (size_t got = 0; got < *bytes;) {
    ssize_t n = read(fd, *text + got, *bytes - got);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return sv_fail(err, SV_E_IO, "%s: reading failed after %zu bytes", path, got);
    got += (size_t)n;
  }
  (*text)[*bytes] = 0;
  return SV_OK;
}

sv_status sv_capture_load(sv_capture *c, const char *dir, sv_arena *arena, sv_err *err) {
  char path[SV_CAPTURE_CAP_PATH + 16];
  if (strlen(dir) >= SV_CAPTURE_CAP_PATH)
    return sv_fail(err, SV_E_ARG, "%.80s...: the path is too long", dir);
  sv_status s = sv_capture_recover(dir, err);
  if (s < 0) return s;
  sv_fmt(path, sizeof path, "%s/capture.json", dir);
  int fd = open(path, O_RDONLY | O_CLOEXEC);
  if (fd < 0 && errno == ENOENT) return sv_capture_of_pictures(c, dir, arena, err);
  if (fd < 0) return sv_fail(err, SV_E_NOT_FOUND, "%s: cannot be opened: %s", path, sv_linux_reason(errno));
  char *text = NULL;
  size_t bytes = 0;
  s = read_text(fd, path, &text, &bytes, arena, err);
  close(fd);
  return s < 0 ? s : sv_capture_parse(c, text, bytes, path, arena, err);
}

static sv_status parse_poses(sv_capture *c, const char *path, char *text, size_t bytes, sv_arena *arena,
                             sv_err *err) {
  size_t n_tokens, n_objects;
  int64_t version;
  if (!count(text, bytes, &n_tokens, &n_objects))
    return sv_fail(err, SV_E_FORMAT, "%s: nested deeper than %d levels", path, MAX_DEPTH);
  sv_capture with = *c; // the old poses stay when these are refused
  with.poses = SV_TAKE(arena, sv_capture_pose, n_objects + 1);
  size_t mark = sv_arena_mark(arena);
  json_t j = {text, path, SV_TAKE(arena, jsmntok_t, n_tokens), 0, err};
  if (arena->status < 0)
    return sv_fail(err, arena->status, "%s: its %zu poses do not fit into the memory left", path, n_objects);
  jsmn_parser parser;
  jsmn_init(&parser);
  j.n_tokens = jsmn_parse(&parser, text, bytes, j.tokens, (unsigned)n_tokens);
  sv_status s = SV_OK;
  if (j.n_tokens < 1 || j.tokens[0].type != JSMN_OBJECT)
    s = sv_fail(err, SV_E_FORMAT, "%s: expected one JSON object with \"poses\"", path);
  if (s == SV_OK)
    s = get_int(&j, 0, &(int_key){"version", 1, 1, 0, "1, the only version there is"}, &version);
  int v = s == SV_OK ? find(&j, 0, "poses") : -1;
  if (s == SV_OK && (v < 0 || j.tokens[v].type != JSMN_ARRAY || j.tokens[v].size < 1))
    s = bad(&j, v < 0 ? 0 : v, "poses", "a list of at least one pose");
  if (s == SV_OK) s = read_poses(&j, v, &with);
  sv_arena_reset(arena, mark);
  if (s == SV_OK) *c = with;
  return s;
}

sv_status sv_capture_load_poses(sv_capture *c, const char *path, sv_arena *arena, sv_err *err) {
  char *text = NULL;
  size_t bytes = 0;
  int fd = open(path, O_RDONLY | O_CLOEXEC);
  if (fd < 0) return sv_fail(err, SV_E_NOT_FOUND, "%s: cannot be opened: %s", path, sv_linux_reason(errno));
  sv_status s = read_text(fd, path, &text, &bytes, arena, err);
  close(fd);
  return s < 0 ? s : parse_poses(c, path, text, bytes, arena, err);
}

// --- poses ---------------------------------------------------------------------------------------
static void slerp(double out[4], const double a[4], const double b_in[4], double u) {
  double dot = 0, b[4], wa = 1 - u, wb = u;
  for (int i = 0; i < 4; i++) dot += a[i] * b_in[i];
  for (int i = 0; i < 4; i++) b[i] = dot < 0 ? -b_in[i] : b_in[i]; // the short way round
  if (dot < 0) dot = -dot;
  if (dot < 0.9999) { // nearer than that, the straight line is the arc
    double angle = sv_acos(dot), sine = sv_sin(angle);
    wa = sv_sin((1 - u) * angle) / sine;
    wb = sv_sin(u * angle) / sine;
  }
  for (int i = 0; i < 4; i++) out[i] = wa * a[i] + wb * b[i];
}

sv_status sv_capture_pose_at(const sv_capture *c, sv_ns t_ns, sv_pose *rig_from_world) {
  if (!c->n_poses) return SV_E_NOT_FOUND;
  int lo = 0, hi = c->n_poses - 1; // the last pose at or before t, by halving
  while (lo < hi) {
    int mid = (lo + hi + 1) / 2;
    if (c->poses[mid].time_ns <= t_ns) lo = mid;
    else hi = mid - 1;
  }
  const sv_capture_pose *a = &c->poses[lo], *b = lo + 1 < c->n_poses ? a + 1 : a;
  double u =
      b == a || t_ns <= a->time_ns ? 0 : (double)(t_ns - a->time_ns) / (double)(b->time_ns - a->time_ns);
  double q[4];
  slerp(q, a->q_wxyz, b->q_wxyz, u);
  sv_quat_to_mat(rig_from_world->r, q);
  for (int i = 0; i < 3; i++) rig_from_world->t[i] = (1 - u) * a->t_m[i] + u * b->t_m[i];
  return SV_OK;
}
