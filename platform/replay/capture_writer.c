// SPDX-License-Identifier: Apache-2.0
#include "platform/replay/capture_writer.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h> // SEEK_*
#include <string.h>
#include <strings.h>
#include <sys/file.h> // flock
#include <sys/stat.h>
#include <unistd.h>

#include "src/base/str.h"

#define COPY_BYTES (64u << 10)
#define LINE_BYTES 1024

// Sidecars hold the lines of one list of capture.json as they will stand there, the separating
// comma at the start of all lines but the first; a line counts when its newline is there.
static void sidecar_name(char out[32], int i_camera) { sv_fmt(out, 32, "frames.%d.part", i_camera); }
#define POSES_SIDECAR "poses.part"

// All that may be there: an older capture may have had more cameras.
static void remove_sidecars(int dir_fd) {
  char name[32];
  for (int i = 0; i < SV_CAP_SUB_VIEWS; i++) {
    sidecar_name(name, i);
    unlinkat(dir_fd, name, 0);
    // The first one is the sign that there is something to recover. Once it is gone for good, what
    // a kill or a power cut leaves of the others harms nobody.
    if (i == 0) fsync(dir_fd);
  }
  unlinkat(dir_fd, POSES_SIDECAR, 0);
}

// --- memory --------------------------------------------------------------------------------------
static bool cfg_is_good(const sv_capture_writer_cfg *c) {
  if (!c->dir || c->n_cameras < 1 || c->n_cameras > SV_CAP_SUB_VIEWS || !c->caps || c->quality < 0 ||
      c->quality > 100 || c->save_period < 0)
    return false;
  for (int i = 0; i < c->n_cameras; i++)
    if (c->caps[i].width_px < 1 || c->caps[i].height_px < 1 || c->caps[i].width_px > 32768 ||
        c->caps[i].height_px > 32768)
      return false;
  return true;
}

static sv_codec_cfg codec_cfg(const sv_capture_writer_cfg *cfg) {
  sv_codec_cfg c = {1, 1, false};
  for (int i = 0; i < cfg->n_cameras; i++) {
    if (cfg->caps[i].width_px > c.max_width_px) c.max_width_px = cfg->caps[i].width_px;
    if (cfg->caps[i].height_px > c.max_height_px) c.max_height_px = cfg->caps[i].height_px;
  }
  return c;
}

static void carve(sv_capture_writer *w, const sv_capture_writer_cfg *cfg, sv_arena *a) {
  sv_arena_part_begin(a, "capture writer");
  sv_codec_cfg cc = codec_cfg(cfg);
  w->cameras = SV_TAKE(a, sv_capture_writer_camera, cfg->n_cameras);
  w->caps = SV_TAKE(a, sv_camera_caps, cfg->n_cameras);
  w->cap_encoded = (size_t)cc.max_width_px * (size_t)cc.max_height_px * 3 + 4096;
  for (int i = 0; i < cfg->n_cameras; i++) {
    const sv_camera_caps *c = &cfg->caps[i];
    size_t cap = c->format == SV_PIX_RGB16 ? sv_codec_png_cap(c->width_px, c->height_px, c->format) : 0;
    if (cap > w->cap_encoded) w->cap_encoded = cap;
  }
  w->encoded = SV_TAKE(a, uint8_t, w->cap_encoded);
  w->cap_copy = COPY_BYTES;
  w->copy = SV_TAKE(a, uint8_t, w->cap_copy);
}

size_t sv_capture_writer_bytes(const sv_capture_writer_cfg *cfg) {
  if (!cfg_is_good(cfg)) return 0;
  sv_capture_writer w = {0};
  sv_arena dry = sv_arena_dry();
  carve(&w, cfg, &dry);
  sv_codec_cfg cc = codec_cfg(cfg);
  return dry.used_bytes + sv_codec_bytes(&cc);
}

// --- files ---------------------------------------------------------------------------------------
static sv_status io_failed(const sv_capture_writer *w, const char *what, int e, sv_err *err) {
  return sv_fail(err, SV_E_IO, "%s: %s cannot be written: %s", w->store.dir, what, sv_linux_reason(e));
}

// One line. What a failed write has left of it is cut off before the next one; until then readers
// skip it, as it has no newline.
static sv_status append(sv_capture_writer *w, sv_capture_sidecar *c, const char *line, size_t n,
                        sv_err *err) {
  int e = c->is_torn && ftruncate(c->fd, (off_t)c->n_bytes) < 0 ? errno : 0;
  if (!e) e = sv_linux_write_all(c->fd, line, n, NULL);
  c->is_torn = e != 0;
  if (e) return io_failed(w, "a list of frames", e, err);
  c->n_bytes += (int64_t)n;
  return SV_OK;
}

static bool is_line_end(int fd, off_t at) {
  char c;
  return pread(fd, &c, 1, at - 1) == 1 && c == '\n';
}

// Copies the whole lines of a sidecar from byte `at` on into the file being saved; none when no
// line begins there.
static sv_status copy_lines(sv_linux_store *store, int fd, off_t at, uint8_t *buf, size_t cap, sv_err *err) {
  sv_store s = sv_linux_store_port(store);
  struct stat st;
  if (fstat(fd, &st) < 0) return sv_fail(err, SV_E_IO, "%s: a sidecar cannot be read", store->dir);
  off_t end = st.st_size;
  while (end > 0 && !is_line_end(fd, end)) end--; // a power cut may leave half a line
  if (at > 0 && !is_line_end(fd, at)) return SV_OK;
  while (at < end) {
    size_t want = end - at < (off_t)cap ? (size_t)(end - at) : cap;
    ssize_t n = pread(fd, buf, want, at);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return sv_fail(err, SV_E_IO, "%s: a sidecar cannot be read", store->dir);
    sv_status status = s.write(s.self, buf, (size_t)n, err);
    if (status < 0) return status;
    at += n;
  }
  return SV_OK;
}

// Pictures, sidecars and folders: they must be on the disk before a capture.json that lists them
// for good.
static sv_status sync_all(const sv_linux_store *store, sv_err *err) {
  if (syncfs(store->dir_fd) == 0) return SV_OK;
  return sv_fail(err, SV_E_IO, "%s: the pictures could not be synced: %s", store->dir,
                 sv_linux_reason(errno));
}

static sv_status put_text(sv_linux_store *store, const char *text, sv_err *err) {
  sv_store s = sv_linux_store_port(store);
  return s.write(s.self, text, strlen(text), err);
}

// --- capture.json --------------------------------------------------------------------------------
static sv_status put_head(sv_capture_writer *w, sv_err *err) {
  char line[LINE_BYTES];
  sv_str s = sv_str_make(line, sizeof line);
  sv_str_add(&s, "{\n\"version\":1,\n");
  if (w->name[0]) sv_str_add(&s, "\"name\":\"%s\",\n", w->name);
  if (w->rig[0]) sv_str_add(&s, "\"rig\":\"%s\",\n", w->rig);
  const double *m = w->scene_m;
  if (w->cfg.scene_m)
    sv_str_add(&s, "\"scene\":{\"min_m\":[%.17g,%.17g,%.17g],\"max_m\":[%.17g,%.17g,%.17g]},\n", m[0], m[1],
               m[2], m[3], m[4], m[5]);
  sv_str_add(&s, "\"cameras\":[\n");
  return put_text(&w->store, line, err);
}

static sv_status put_camera(sv_capture_writer *w, int i, sv_err *err) {
  static const char *const clocks[] = {"camera", "monotonic", "boottime", "realtime"};
  static const char *const stamps[] = {"start", "middle", "end"};
  const sv_camera_caps *c = &w->caps[i];
  const char *light = c->is_light_locked    ? c->is_light_shared ? "shared" : "locked"
                      : c->is_exposure_told ? c->is_light_shared ? "told_shared" : "told"
                                            : "free";
  char line[LINE_BYTES];
  char area[160] = "";
  if (c->area.sensor_width_px)
    sv_fmt(area, sizeof area, "\"sensor\":[%d,%d],\"area\":[%.17g,%.17g,%.17g,%.17g],",
           c->area.sensor_width_px, c->area.sensor_height_px, c->area.x0_px, c->area.y0_px, c->area.width_px,
           c->area.height_px);
  sv_fmt(line, sizeof line,
         "{\"name\":\"%s\",\"folder\":\"%s\",\"width\":%d,\"height\":%d,\"fps\":%.17g,\"bits\":%d,\"clock\":"
         "\"%s\","
         "\"stamp\":\"%s\",\"light\":\"%s\",\"brackets\":%d,%s"
         "\"frames\":[\n",
         c->name, w->cameras[i].folder, c->width_px, c->height_px, c->fps, c->format == SV_PIX_RGB16 ? 16 : 8,
         clocks[c->clock], stamps[c->stamp], light, c->n_brackets, area);
  sv_status s = put_text(&w->store, line, err);
  if (s == SV_OK) s = copy_lines(&w->store, w->cameras[i].list.fd, 0, w->copy, w->cap_copy, err);
  if (s == SV_OK) s = put_text(&w->store, i + 1 < w->cfg.n_cameras ? "]},\n" : "]}\n", err);
  return s;
}

sv_status sv_capture_writer_save(sv_capture_writer *w, sv_err *err) {
  if (!w->is_open) return sv_fail(err, SV_E_ARG, "capture: the writer is not open");
  sv_store store = sv_linux_store_port(&w->store);
  sv_status s = store.begin(store.self, "capture.json", err);
  if (s == SV_OK) s = put_head(w, err);
  for (int i = 0; i < w->cfg.n_cameras && s == SV_OK; i++) s = put_camera(w, i, err);
  if (s == SV_OK) s = put_text(&w->store, "],\n\"poses\":[\n", err);
  if (s == SV_OK) s = copy_lines(&w->store, w->poses.fd, 0, w->copy, w->cap_copy, err);
  if (s == SV_OK) s = put_text(&w->store, "]\n}\n", err);
  if (s < 0) {
    store.abandon(store.self);
    return s;
  }
  w->n_unsaved = 0;
  return store.commit(store.self, err);
}

// --- open and close ------------------------------------------------------------------------------
// What may stand in a folder's name and unescaped in JSON.
static void plain(char *out, size_t cap, const char *in, bool is_path) {
  size_t n = 0;
  for (; *in && n + 1 < cap; in++) {
    char c = *in;
    bool is_kept = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-' ||
                   c == '_' || (c == '.' && (n || is_path)) || (is_path && c == '/');
    out[n++] = is_kept ? c : '_';
  }
  out[n] = 0;
}

static bool ends_with(const char *text, const char *end) {
  size_t n = strlen(text), m = strlen(end);
  return n >= m && !strcasecmp(text + n - m, end);
}

// By another camera or by the capture itself. On memory cards "Left" and "left" are often the same
// folder.
static bool is_taken(const sv_capture_writer *w, int i, const char *folder) {
  static const char *const own[] = {"", "capture.json", "poses.json", "rig"};
  for (size_t k = 0; k < sizeof own / sizeof *own; k++)
    if (!strcasecmp(folder, own[k])) return true;
  for (int k = 0; k < i; k++)
    if (!strcasecmp(folder, w->cameras[k].folder)) return true;
  return ends_with(folder, ".part") || ends_with(folder, ".tmp");
}

static void choose_folder(sv_capture_writer *w, int i) {
  char *folder = w->cameras[i].folder;
  plain(folder, sizeof w->cameras[i].folder, w->caps[i].name, false);
  for (int n = i; is_taken(w, i, folder); n++) sv_fmt(folder, sizeof w->cameras[i].folder, "camera.%d", n);
  plain(w->caps[i].name, sizeof w->caps[i].name, folder, false);
}

static int open_sidecar(const sv_capture_writer *w, const char *name) {
  return openat(w->store.dir_fd, name, O_RDWR | O_CREAT | O_TRUNC | O_APPEND | O_NOFOLLOW | O_CLOEXEC, 0666);
}

static sv_status open_camera(sv_capture_writer *w, int i, sv_err *err) {
  sv_capture_writer_camera *c = &w->cameras[i];
  char name[32];
  choose_folder(w, i);
  if (mkdirat(w->store.dir_fd, c->folder, 0777) < 0 && errno != EEXIST)
    return io_failed(w, c->folder, errno, err);
  c->dir_fd = openat(w->store.dir_fd, c->folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (c->dir_fd < 0) return io_failed(w, c->folder, errno, err);
  sidecar_name(name, i);
  c->list.fd = open_sidecar(w, name);
  return c->list.fd < 0 ? io_failed(w, name, errno, err) : SV_OK;
}

static void close_all(sv_capture_writer *w) {
  for (int i = 0; i < w->cfg.n_cameras; i++) {
    if (w->cameras[i].list.fd >= 0) close(w->cameras[i].list.fd);
    if (w->cameras[i].dir_fd >= 0) close(w->cameras[i].dir_fd);
  }
  if (w->poses.fd >= 0) close(w->poses.fd);
  sv_linux_store_close(&w->store);
  sv_codec_close(&w->codec);
  w->is_open = false;
}

static sv_status open_files(sv_capture_writer *w, sv_err *err) {
  sv_status s = sv_linux_store_open(&w->store, w->cfg.dir, err);
  if (s == SV_OK) s = sv_linux_store_lock(&w->store, err);
  for (int i = 0; i < w->cfg.n_cameras && s == SV_OK; i++) s = open_camera(w, i, err);
  if (s < 0) return s;
  w->poses.fd = open_sidecar(w, POSES_SIDECAR);
  if (w->poses.fd < 0) return io_failed(w, POSES_SIDECAR, errno, err);
  w->is_open = true;
  // from here on a kill leaves a capture
  w->saved = sv_capture_writer_save(w, &w->save_err);
  if (w->saved < 0) w->n_unsaved = (uint64_t)w->cfg.save_period - 1; // or with the first frame
  return SV_OK;
}

sv_status sv_capture_writer_open(sv_capture_writer *w, const sv_capture_writer_cfg *cfg, sv_arena *arena,
                                 sv_err *err) {
  memset(w, 0, sizeof *w);
  w->poses.fd = -1;
  sv_linux_store_init(&w->store);
  if (!cfg_is_good(cfg)) return sv_fail(err, SV_E_ARG, "capture: the writer's settings are out of range");
  carve(w, cfg, arena);
  if (arena->status < 0)
    return sv_fail(err, arena->status, "capture: the memory left does not hold the writer's buffers");
  sv_codec_cfg cc = codec_cfg(cfg);
  sv_status s = sv_codec_init(&w->codec, &cc, arena);
  if (s < 0) return sv_fail(err, s, "capture: the memory left does not hold the encoder");
  w->cfg = *cfg;
  if (!w->cfg.quality) w->cfg.quality = 95;
  if (!w->cfg.save_period) w->cfg.save_period = 100;
  plain(w->name, sizeof w->name, cfg->name ? cfg->name : "", false);
  plain(w->rig, sizeof w->rig, cfg->rig ? cfg->rig : "", true);
  if (cfg->scene_m) memcpy(w->scene_m, cfg->scene_m, sizeof w->scene_m);
  for (int i = 0; i < cfg->n_cameras; i++) {
    w->caps[i] = cfg->caps[i];
    w->cameras[i] = (sv_capture_writer_camera){.list.fd = -1, .dir_fd = -1};
  }
  s = open_files(w, err);
  w->cfg.caps = w->caps;
  w->cfg.dir = w->store.dir;
  if (s < 0) close_all(w);
  return s;
}

sv_status sv_capture_writer_finish(sv_capture_writer *w, sv_err *err) {
  if (!w->is_open) return sv_fail(err, SV_E_ARG, "capture: the writer is not open");
  sv_status s = w->is_finished ? SV_OK : sync_all(&w->store, err);
  if (s == SV_OK && !w->is_finished) s = sv_capture_writer_save(w, err);
  w->is_finished = s == SV_OK;
  return s;
}

sv_status sv_capture_writer_close(sv_capture_writer *w, sv_err *err) {
  if (!w->is_open) return SV_OK;
  sv_status s = sv_capture_writer_finish(w, err);
  if (s == SV_OK) remove_sidecars(w->store.dir_fd); // otherwise they are all there is
  close_all(w);
  return s;
}

// --- frames and poses ----------------------------------------------------------------------------
static sv_status picture_bytes(sv_capture_writer *w, const sv_frame *f, const uint8_t **data, size_t *bytes,
                               sv_err *err) {
  *data = f->data;
  *bytes = f->data_bytes;
  if (f->format == SV_PIX_JPEG || f->format == SV_PIX_PNG) return SV_OK;
  sv_picture in = {f->width_px, f->height_px, (size_t)f->stride_bytes, f->format,
                   (uint8_t *)(uintptr_t)f->data};
  *data = w->encoded;
  if (f->format == SV_PIX_RGB16)
    return sv_codec_encode_png(&w->codec, &in, w->encoded, w->cap_encoded, bytes, err);
  return sv_codec_encode_jpeg(&w->codec, &in, (sv_jpeg_options){w->cfg.quality, !w->cfg.is_chroma_halved},
                              (sv_codec_buffer){w->encoded, w->cap_encoded}, bytes, err);
}

static sv_status put_picture(sv_capture_writer *w, int dir_fd, const char *name, const uint8_t *data,
                             size_t bytes, sv_err *err) {
  int fd = openat(dir_fd, name, O_WRONLY | O_CREAT | O_TRUNC | O_NOFOLLOW | O_CLOEXEC, 0666);
  if (fd < 0) return io_failed(w, name, errno, err);
  int e = sv_linux_write_all(fd, data, bytes, NULL);
  // Some file systems tell only here that there was no room.
  if (close(fd) < 0 && errno != EINTR && !e) e = errno;
  return e ? io_failed(w, name, e, err) : SV_OK;
}

sv_status sv_capture_writer_add(sv_capture_writer *w, const sv_frame *f, sv_err *err) {
  w->is_finished = false;
  if (!w->is_open || f->i_camera < 0 || f->i_camera >= w->cfg.n_cameras)
    return sv_fail(err, SV_E_ARG, "capture: the writer is not open, or has no camera %d", f->i_camera);
  sv_capture_writer_camera *c = &w->cameras[f->i_camera];
  const sv_camera_caps *caps = &w->caps[f->i_camera];
  if (f->is_error) return SV_DROPPED;
  if (f->width_px != caps->width_px || f->height_px != caps->height_px)
    return sv_fail(err, SV_E_ARG, "capture: a frame of %s is %dx%d, expected %dx%d", c->folder, f->width_px,
                   f->height_px, caps->width_px, caps->height_px);
  if ((f->format == SV_PIX_RGB16) != (caps->format == SV_PIX_RGB16))
    return sv_fail(err, SV_E_ARG, "capture: a frame of %s has another pixel format than its camera tells",
                   c->folder);
  const uint8_t *data;
  size_t bytes;
  char name[32], line[LINE_BYTES];
  sv_status s = picture_bytes(w, f, &data, &bytes, err);
  if (s < 0) return s;
  sv_fmt(name, sizeof name, "%06llu.%s", (unsigned long long)c->n_frames,
         f->format == SV_PIX_PNG || f->format == SV_PIX_RGB16 ? "png" : "jpg");
  s = put_picture(w, c->dir_fd, name, data, bytes, err);
  if (s < 0) return s;
  // The line goes after the picture: what is listed is there.
  size_t n = sv_fmt(
      line, sizeof line,
      "%s{\"file\":\"%s\",\"sequence\":%u,\"camera_ns\":%lld,\"arrival_ns\":%lld,\"exposure_ns\":%lld}\n",
      c->n_frames ? "," : "", name, f->sequence, (long long)f->camera_ns, (long long)f->arrival_ns,
      (long long)f->exposure_ns);
  if ((s = append(w, &c->list, line, n, err)) < 0) return s;
  c->n_frames++;
  w->n_frames++;
  if (++w->n_unsaved < (uint64_t)w->cfg.save_period) return SV_OK;
  w->n_unsaved = 0; // after a failure the next try comes as many frames later
  w->saved = sv_capture_writer_save(w, &w->save_err);
  return SV_OK;
}

sv_status sv_capture_writer_add_pose(sv_capture_writer *w, sv_ns time_ns, const sv_pose *p, sv_err *err) {
  if (!w->is_open) return sv_fail(err, SV_E_ARG, "capture: the writer is not open");
  double q[4];
  char line[LINE_BYTES];
  w->is_finished = false;
  sv_quat_from_mat(q, p->r);
  size_t n =
      sv_fmt(line, sizeof line,
             "%s{\"time_ns\":%lld,\"rig_from_world\":[%.17g,%.17g,%.17g,%.17g,%.17g,%.17g,%.17g]}\n",
             w->n_poses ? "," : "", (long long)time_ns, q[0], q[1], q[2], q[3], p->t[0], p->t[1], p->t[2]);
  sv_status s = append(w, &w->poses, line, n, err);
  if (s == SV_OK) w->n_poses++;
  return s;
}

// --- recovery ------------------------------------------------------------------------------------
typedef struct {
  int fd;
  char buf[2048], line[LINE_BYTES + 256];
  size_t n, at;
} lines_t;

// The next line with its newline; false at the end or when a line is longer than the writer makes
// them.
static bool next_line(lines_t *l) {
  size_t len = 0;
  for (;;) {
    if (l->at == l->n) {
      ssize_t n = read(l->fd, l->buf, sizeof l->buf);
      if (n < 0 && errno == EINTR) continue;
      if (n <= 0) return false;
      l->n = (size_t)n;
      l->at = 0;
    }
    if (len + 1 >= sizeof l->line) return false;
    char c = l->buf[l->at++];
    l->line[len++] = c;
    l->line[len] = 0;
    if (c == '\n') return true;
  }
}

// What a sidecar has beyond the first `at` bytes, which are in capture.json already.
static sv_status put_rest(sv_linux_store *store, const char *name, off_t at, sv_err *err) {
  uint8_t buf[1024];
  int fd = openat(store->dir_fd, name, O_RDONLY | O_CLOEXEC);
  if (fd < 0 && errno == ENOENT) return SV_OK; // a writer that was killed while it removed them
  if (fd < 0)
    return sv_fail(err, SV_E_IO, "%s/%s: cannot be read: %s", store->dir, name, sv_linux_reason(errno));
  sv_status s = copy_lines(store, fd, at, buf, sizeof buf, err);
  close(fd);
  return s;
}

// capture.json again, its lists continued with what the sidecars have beyond them. The lists are
// kept: capture.json is synced when it is saved, the sidecars are not, so after a power cut they
// may be the shorter ones.
static sv_status rewrite(sv_linux_store *store, lines_t *l, sv_err *err) {
  sv_status s = SV_OK;
  int i_camera = 0;
  off_t n_body_bytes = 0;
  char name[32] = ""; // of the sidecar that continues the present list
  bool is_whole = false;
  while (s == SV_OK && next_line(l)) {
    if (name[0] && l->line[0] == ']') {
      s = put_rest(store, name, n_body_bytes, err);
      name[0] = 0;
    }
    if (s == SV_OK) s = put_text(store, l->line, err);
    n_body_bytes += (off_t)strlen(l->line);
    if (ends_with(l->line, "\"frames\":[\n")) {
      sidecar_name(name, i_camera++);
      n_body_bytes = 0;
    } else if (sv_str_eq(l->line, "\"poses\":[\n")) {
      strcpy(name, POSES_SIDECAR);
      n_body_bytes = 0;
    }
    is_whole = sv_str_eq(l->line, "}\n");
  }
  if (s == SV_OK && !is_whole)
    s = sv_fail(err, SV_E_FORMAT,
                "%s/capture.json: not as the writer leaves it, so frames.*.part cannot be folded in",
                store->dir);
  return s;
}

static sv_status fold_in(sv_linux_store *store, sv_linux_lock lock, sv_err *err) {
  lines_t l = {.fd = openat(store->dir_fd, "capture.json", O_RDONLY | O_CLOEXEC)};
  if (l.fd < 0) return SV_OK; // killed before the first save: there is nothing
  sv_store s = sv_linux_store_port(store);
  sv_status status = s.begin(s.self, "capture.json", err);
  if (status == SV_OK) status = rewrite(store, &l, err);
  if (status == SV_OK) status = sync_all(store, err);
  if (status == SV_OK) status = s.commit(s.self, err);
  else s.abandon(s.self);
  close(l.fd);
  // Once is enough: with the sidecars there, each load would write again, and undo what was edited
  // since.
  if (status == SV_OK && lock == SV_LINUX_LOCK_OURS) remove_sidecars(store->dir_fd);
  return status;
}

static sv_status recover_locked(const char *dir, const char *first_sidecar, sv_err *err) {
  sv_linux_store store;
  sv_status s = sv_linux_store_open(&store, dir, err);
  sv_linux_lock lock = s == SV_OK ? sv_linux_folder_lock(store.dir_fd) : SV_LINUX_LOCK_IN_USE;
  // A writer that lives keeps its sidecars. On a medium that cannot be written the last save has to
  // do, and where another process has recovered meanwhile nothing is left to be done.
  if (lock != SV_LINUX_LOCK_IN_USE && faccessat(store.dir_fd, ".", W_OK, 0) == 0 &&
      access(first_sidecar, F_OK) == 0)
    s = fold_in(&store, lock, err);
  sv_linux_store_close(&store);
  return s;
}

sv_status sv_capture_recover(const char *dir, sv_err *err) {
  char path[SV_CAPTURE_CAP_PATH + 32];
  sv_fmt(path, sizeof path, "%s/frames.0.part", dir);
  int fd = open(path, O_RDONLY | O_CLOEXEC);
  if (fd < 0) return SV_OK;
  int r;
  do r = flock(fd, LOCK_EX); // of several that load it, one recovers and the others wait
  while (r < 0 && errno == EINTR);
  sv_status s = recover_locked(dir, path, err);
  close(fd);
  return s;
}

// --- what is there -------------------------------------------------------------------------------
static bool has_text(int fd, const char *text) {
  char buf[4096];
  const size_t keep = strlen(text) - 1; // of the last piece: the text may lie across two
  size_t had = 0;
  for (;;) {
    const ssize_t n = read(fd, buf + had, sizeof buf - had);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return false;
    const size_t in = had + (size_t)n;
    if (memmem(buf, in, text, keep + 1)) return true;
    had = in < keep ? in : keep;
    memmove(buf, buf + in - had, had);
  }
}

bool sv_capture_has_frames(const char *dir) {
  static const char *const lists[] = {"capture.json", "frames.0.part"};
  bool has_frames = false;
  for (int i = 0; i < 2 && !has_frames; i++) {
    char path[SV_CAPTURE_CAP_PATH + 32];
    sv_fmt(path, sizeof path, "%s/%s", dir, lists[i]);
    const int fd = open(path, O_RDONLY | O_CLOEXEC);
    if (fd < 0) continue;
    has_frames = has_text(fd, "\"file\"");
    close(fd);
  }
  return has_frames;
}
