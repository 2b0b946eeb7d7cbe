// SPDX-License-Identifier: Apache-2.0
// Source strings -> cameras, clock, rig and, where it is known, the scene's place.
#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <unistd.h>

#include "boards/board_main.h"
#include "src/base/mathx.h"

#define DEFAULT_FOV_DEG 60.0 // of a webcam or a phone, more or less
#define CAP_SPEC        1024

static sv_status read_caps(board_source *s, sv_arena *arena, sv_err *err) {
  s->caps = SV_TAKE(arena, sv_camera_caps, s->source.n_cameras);
  if (!s->caps) return sv_fail(err, SV_E_NOMEM, "no room for %d cameras", s->source.n_cameras);
  for (int i = 0; i < s->source.n_cameras; i++) {
    sv_status r = s->source.caps(s->source.self, i, &s->caps[i]);
    if (r < 0) return sv_fail(err, r, "camera %d does not report its capabilities: %s", i, sv_status_text(r));
  }
  return SV_OK;
}

static sv_status open_sim(board_source *s, const char *spec, int n_exposures, sv_arena *arena, sv_err *err) {
  sv_sim_config cfg = sv_sim_defaults();
  sv_status r = sv_sim_parse(&cfg, spec, err);
  if (r < 0) return r;
  // Unless told otherwise, the rig's round has one stop for each exposure.
  if (n_exposures > 0 && !strstr(spec, "exposures=")) cfg.n_exposures = n_exposures;
  cfg.response = s->response;
  r = sv_sim_init(&s->u.sim, &cfg, arena, err);
  if (r < 0) return r;
  s->source = sv_sim_source(&s->u.sim);
  s->clock = sv_sim_clock(&s->u.sim);
  s->rig = sv_sim_rig(&s->u.sim);
  double c[3], radius;
  sv_sim_scene_bounds(&s->u.sim, c, &radius);
  s->has_bounds = !cfg.has_unknown_poses; // without poses nobody knows where that is
  s->bounds = (sv_bounds){{(float)c[0], (float)c[1], (float)c[2]}, (float)radius};
  return SV_OK;
}

// sv_file_reader over a folder, by plain reads.
static sv_status read_in_folder(void *self, const char *name, void *buf, size_t cap, size_t *bytes,
                                sv_err *err) {
  const char *dir = self;
  char path[2 * SV_CAPTURE_CAP_PATH];
  if (strchr(name, '/')) return sv_fail(err, SV_E_ARG, "%s: a name with a folder is not allowed here", name);
  sv_fmt(path, sizeof path, "%s/%s", dir, name);
  int fd = open(path, O_RDONLY | O_CLOEXEC);
  if (fd < 0)
    return sv_fail(err, SV_E_NOT_FOUND, "%s: the file cannot be opened: %s", path, sv_linux_reason(errno));
  size_t at = 0;
  ssize_t n = 0;
  while (at < cap && (n = read(fd, (char *)buf + at, cap - at)) > 0) at += (size_t)n;
  close(fd);
  if (n < 0) return sv_fail(err, SV_E_IO, "%s: reading failed", path);
  if (at == cap)
    return sv_fail(err, SV_E_NOMEM, "%s: larger than the %zu bytes expected of it", path, cap - 1);
  *bytes = at;
  return SV_OK;
}

static sv_status read_rig(board_source *s, sv_arena *arena, sv_err *err) {
  sv_status r = sv_rig_init(&s->rig_read, SV_CAP_SUB_VIEWS, arena);
  if (r < 0) return sv_fail(err, r, "no room for a rig");
  sv_arena scratch = sv_arena_sub(arena, 1 << 20);
  sv_file_reader files = {s->rig_dir, read_in_folder};
  sv_coverage_names *names = SV_TAKE(&scratch, sv_coverage_names, 1);
  if (!names) return sv_fail(err, SV_E_NOMEM, "no room for a rig");
  memset(names, 0, sizeof *names);
  r = sv_rig_read_coverage(&s->rig_read, names, &files, s->source.n_cameras, &scratch, err);
  s->rig = &s->rig_read;
  return r < 0 ? r : coverage_read(&s->rig_read, names, &files, s->rig_dir, arena, err);
}

static sv_status open_replay(board_source *s, const char *spec, sv_arena *arena, sv_err *err) {
  sv_replay_cfg cfg;
  sv_status r = sv_replay_parse(spec, &cfg, err);
  if (r < 0) return r;
  r = sv_replay_init(&s->u.replay, &cfg, arena, err);
  if (r < 0) return r;
  const sv_capture *c = &s->u.replay.capture;
  s->source = sv_replay_source(&s->u.replay);
  s->clock = sv_replay_clock(&s->u.replay);
  if (c->has_scene) {
    double centre[3], radius;
    sv_capture_scene(c, centre, &radius);
    s->has_bounds = true;
    for (int i = 0; i < 3; i++) s->bounds.centre[i] = (float)centre[i];
    s->bounds.radius = (float)radius;
  }
  if (c->rig[0]) sv_fmt(s->rig_dir, sizeof s->rig_dir, "%s/%s", cfg.dir, c->rig);
  return SV_OK;
}

// The line itself is opened later, when the rig is read, which may name it.
static void use_trigger(board_source *s, sv_camera_options *o) {
  o->trigger = sv_pulses_trigger(&s->pulses);
  if (!s->trigger.period_ns && o->fps > 0) s->trigger.period_ns = (sv_ns)(1e9 / o->fps + 0.5);
  const sv_ns quiet_ns = 3 * s->trigger.period_ns; // no stall: nothing was to come
  if (o->stall_ns < quiet_ns) o->stall_ns = quiet_ns;
}

static sv_status open_v4l2(board_source *s, const char *spec, sv_arena *arena, sv_err *err) {
  sv_camera_options o;
  sv_v4l2_sys sys = sv_v4l2_linux();
  s->clock = sv_linux_clock();
  sv_status r = sv_camera_parse("v4l2", spec, &o, err);
  if (r >= 0) use_trigger(s, &o);
  o.response = s->response;
  if (r >= 0) r = sv_v4l2_init(&s->u.v4l2, &o, &sys, &s->clock, arena, err);
  if (r >= 0) s->source = sv_v4l2_source(&s->u.v4l2);
  return r;
}

static sv_status open_libcamera(board_source *s, const char *spec, sv_err *err) {
  sv_camera_options o;
  s->clock = sv_linux_clock();
  sv_status r = sv_camera_parse("libcamera", spec, &o, err);
  if (r >= 0) use_trigger(s, &o);
  o.response = s->response;
  if (r >= 0) r = sv_libcamera_open(&s->u.libcamera, &o, &s->clock, err);
  if (r >= 0) s->source = sv_libcamera_source(s->u.libcamera);
  return r;
}

// --- options of all sources ----------------------------------------------------------------------
typedef struct {
  char spec[CAP_SPEC]; // without them
  int cols, rows;      // 0: no tiles
  double fov_deg;
  sv_trigger trigger;
} common_options;

static bool read_tiles(const char *v, size_t n, common_options *o) {
  const char *x = memchr(v, 'x', n);
  long long c, r;
  if (!x || !sv_parse_int(v, (size_t)(x - v), &c) || !sv_parse_int(x + 1, n - (size_t)(x - v) - 1, &r))
    return false;
  if (c < 1 || r < 1 || c > SV_TILED_CAP_TILES || r > SV_TILED_CAP_TILES) return false;
  o->cols = (int)c;
  o->rows = (int)r;
  return true;
}

static sv_status take_options(const char *spec, common_options *o, sv_err *err) {
  size_t at = 0;
  *o = (common_options){.fov_deg = DEFAULT_FOV_DEG};
  if (strlen(spec) >= sizeof o->spec)
    return sv_fail(err, SV_E_ARG, "the source string is longer than %zu characters", sizeof o->spec - 1);
  for (const char *p = spec; *p;) {
    size_t n = strcspn(p + (*p == ','), ",") + (*p == ',');
    const char *word = p + (*p == ',');
    size_t len = n - (size_t)(word - p);
    bool is_tiles = len > 6 && !memcmp(word, "tiles=", 6), is_fov = len > 4 && !memcmp(word, "fov=", 4);
    if (is_tiles && !read_tiles(word + 6, len - 6, o))
      return sv_fail(err, SV_E_ARG, "source option %.*s: expected tiles=CxR, columns and rows", (int)len,
                     word);
    if (is_fov &&
        (!sv_parse_double(word + 4, len - 4, &o->fov_deg) || !(o->fov_deg >= 5 && o->fov_deg <= 150)))
      return sv_fail(err, SV_E_ARG, "source option %.*s: expected a width of view of 5 to 150 degrees",
                     (int)len, word);
    const sv_status r = trigger_option(&o->trigger, word, len, err);
    if (r < 0) return r;
    if (!is_tiles && !is_fov && r == SV_AGAIN) {
      memcpy(o->spec + at, p, n);
      at += n;
    }
    p += n;
  }
  o->spec[at] = 0;
  return SV_OK;
}

// A single camera that nobody has calibrated: square pixels, the principal point in the middle, no
// distortion.
static sv_status assume_rig(board_source *s, double fov_deg, sv_arena *arena, sv_err *err) {
  const sv_camera_caps *c = &s->caps[0];
  if (sv_rig_init(&s->rig_read, 1, arena) < 0) return sv_fail(err, SV_E_NOMEM, "no room for a rig");
  double f = 0.5 * c->width_px / sv_tan(0.5 * fov_deg * SV_PI / 180);
  sv_copy(s->rig_read.name, sizeof s->rig_read.name, "assumed");
  s->rig_read.sub_views[0] = (sv_sub_view){.name = "camera",
                                           .model = {.kind = SV_MODEL_PINHOLE,
                                                     .width_px = c->width_px,
                                                     .height_px = c->height_px,
                                                     .p = {f, f, 0.5 * c->width_px, 0.5 * c->height_px}},
                                           .cam_from_rig = sv_pose_identity()};
  s->rig_read.n_sub_views = 1;
  s->rig = &s->rig_read;
  sv_fmt(s->note, sizeof s->note,
         "no rig is given: a pinhole lens that sees %g degrees in width is assumed (fov=DEG in the source "
         "string "
         "changes it, --rig DIR names a calibrated one)",
         fov_deg);
  return SV_OK;
}

static sv_status find_no_rig(board_source *s, const char *spec, double fov_deg, sv_arena *arena,
                             sv_err *err) {
  if (s->source.n_cameras == 1) return assume_rig(s, fov_deg, arena, err);
  return sv_fail(
      err, SV_E_NOT_FOUND,
      "source \"%s\" has %d cameras and no rig; give a folder with --rig (rig.json and .cameramodel files, "
      "as subview-calibrate writes them)",
      spec, s->source.n_cameras);
}

static sv_status decode(void *self, const uint8_t *data, size_t bytes, const sv_decoded *to, sv_err *err) {
  sv_picture out = {to->width_px, to->height_px, to->stride_bytes, SV_PIX_RGB8, to->rgb};
  return sv_codec_decode(self, data, bytes, &out, err);
}

static sv_status open_decoder(board_source *s, sv_arena *arena, sv_err *err) {
  sv_codec_cfg cfg = {0};
  for (int i = 0; i < s->source.n_cameras; i++) {
    const sv_camera_caps *c = &s->caps[i];
    if (sv_pixel(c->format)->layout != SV_LAYOUT_CODED) continue;
    int w = c->coded_width_px ? c->coded_width_px : c->width_px;
    int h = c->coded_height_px ? c->coded_height_px : c->height_px;
    if (w > cfg.max_width_px) cfg.max_width_px = w;
    if (h > cfg.max_height_px) cfg.max_height_px = h;
  }
  if (!cfg.max_width_px) return SV_OK;
  sv_status r = sv_codec_init(&s->codec, &cfg, arena);
  s->decoder = (sv_decoder){&s->codec, decode};
  return r < 0 ? sv_fail(err, r, "no room to decode images of %dx%d px", cfg.max_width_px, cfg.max_height_px)
               : r;
}

static sv_status open_kind(board_source *s, const char *spec, int n_exposures, sv_arena *arena, sv_err *err) {
  if (!strncmp(spec, "sim:", 4)) {
    s->kind = SOURCE_SIM;
    s->is_virtual = true;
    return open_sim(s, spec + 4, n_exposures, arena, err);
  }
  if (!strncmp(spec, "replay:", 7)) {
    s->kind = SOURCE_REPLAY;
    sv_status r = open_replay(s, spec + 7, arena, err);
    s->is_virtual = r >= 0 && s->u.replay.cfg.speed == 0;
    return r;
  }
  if (!strncmp(spec, "v4l2:", 5)) {
    s->kind = SOURCE_V4L2;
    return open_v4l2(s, spec + 5, arena, err);
  }
  if (!strncmp(spec, "libcamera:", 10)) {
    s->kind = SOURCE_LIBCAMERA;
    return open_libcamera(s, spec + 10, err);
  }
  return sv_fail(err, SV_E_ARG, "source \"%s\": expected " SOURCE_KINDS, spec);
}

// How sensitive the cameras are, for lock=shared: the mean of a camera's sub-views.
static void read_responses(board_source *s, int n_tiles) {
  double sum[SV_CAMERA_CAP_CAMERAS] = {0};
  int n[SV_CAMERA_CAP_CAMERAS] = {0};
  for (int i = 0; i < s->rig->n_sub_views; i++) {
    const sv_sub_view *v = &s->rig->sub_views[i];
    const int c = v->i_camera / n_tiles;
    if (c >= SV_CAMERA_CAP_CAMERAS) continue;
    sum[c] += sv_photometry_response(&v->photometric);
    n[c]++;
  }
  for (int c = 0; c < SV_CAMERA_CAP_CAMERAS; c++)
    if (n[c]) s->response[c] = (float)(sum[c] / n[c]);
}

sv_status source_open(board_source *s, const source_cfg *cfg, sv_arena *arena, sv_err *err) {
  const char *spec = cfg->spec, *rig_path = cfg->rig_path;
  common_options o;
  memset(s, 0, sizeof *s);
  for (int i = 0; i < SV_CAMERA_CAP_CAMERAS; i++) s->response[i] = 1;
  sv_arena_part_begin(arena, "source");
  sv_status r = take_options(spec, &o, err);
  s->trigger = o.trigger;
  if (r >= 0) r = open_kind(s, o.spec, cfg->n_exposures, arena, err);
  if (r >= 0 && o.trigger.kind != SV_LINE_NONE && s->kind != SOURCE_V4L2 && s->kind != SOURCE_LIBCAMERA)
    r = sv_fail(
        err, SV_E_UNSUPPORTED,
        "trigger= is for cameras (v4l2:, libcamera:); the simulator has a trigger line of its own, and a "
        "capture folder cannot have one");
  if (r >= 0 && o.cols) {
    sv_source inner = s->source;
    r = sv_tiled_init(&s->tiled, &inner, o.cols, o.rows, arena, err);
    s->source = sv_tiled_source(&s->tiled);
    s->rig = NULL; // that of the whole pictures
  }
  if (r >= 0) r = read_caps(s, arena, err);
  if (r >= 0) r = open_decoder(s, arena, err);
  if (r < 0) return r;
  sv_arena_part_begin(arena, "rig");
  if (rig_path) sv_copy(s->rig_dir, sizeof s->rig_dir, rig_path);
  if (o.cols && !rig_path) s->rig_dir[0] = 0;
  if (s->rig_dir[0]) r = read_rig(s, arena, err);
  else if (!s->rig && cfg->needs_rig) r = find_no_rig(s, spec, o.fov_deg, arena, err);
  if (r >= 0 && s->rig) read_responses(s, o.cols ? o.cols * o.rows : 1);
  if (r >= 0 && s->rig) r = sizes_fit(s, cfg, arena, err);
  if (r >= 0 && s->rig && cfg->reads_shutters) r = shutters_read(s, arena, err);
  if (r >= 0 && cfg->is_triggered) r = trigger_open(s, err);
  return r;
}

bool source_tells_poses(const board_source *s) {
  sv_pose pose;
  return s->source.rig_pose && s->source.rig_pose(s->source.self, 0, &pose) >= 0;
}

void source_close(board_source *s) {
  if (s->kind == SOURCE_REPLAY) sv_replay_close(&s->u.replay);
  if (s->kind == SOURCE_V4L2) sv_v4l2_close(&s->u.v4l2);
  if (s->kind == SOURCE_LIBCAMERA) sv_libcamera_close(s->u.libcamera);
  trigger_close(s); // after the cameras, which use it
  sv_codec_close(&s->codec);
}
