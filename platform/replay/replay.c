// SPDX-License-Identifier: Apache-2.0
#include "platform/replay/replay.h"

#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "platform/linux/linux.h"
#include "src/base/str.h"

#define CAP_BUFFERS    64
#define MAX_FILE_BYTES (256u << 20)

// --- settings ------------------------------------------------------------------------------------
static bool read_count(const char *v, size_t n, int lo, int *out) {
  long long x;
  if (!sv_parse_int(v, n, &x) || x < lo || x > 1000000000) return false;
  *out = (int)x;
  return true;
}

static sv_status read_option(const char *p, size_t n, sv_replay_cfg *cfg, sv_err *err) {
  const char *eq = memchr(p, '=', n);
  size_t nk = eq ? (size_t)(eq - p) : n, nv = eq ? n - nk - 1 : 0;
  const char *v = eq ? eq + 1 : "";
  bool is_good = false;
  if (nk == 5 && !memcmp(p, "speed", 5)) {
    if (nv == 3 && !memcmp(v, "max", 3)) {
      cfg->speed = 0;
      is_good = true;
    } else if (nv == 8 && !memcmp(v, "realtime", 8)) {
      cfg->speed = 1;
      is_good = true;
    } else is_good = sv_parse_double(v, nv, &cfg->speed) && cfg->speed >= 0.001 && cfg->speed <= 1000;
  } else if (nk == 4 && !memcmp(p, "from", 4)) is_good = read_count(v, nv, 0, &cfg->from);
  else if (nk == 5 && !memcmp(p, "count", 5)) is_good = read_count(v, nv, 1, &cfg->count);
  else if (nk == 5 && !memcmp(p, "poses", 5) && nv > 0 && nv < sizeof cfg->poses) {
    memcpy(cfg->poses, v, nv);
    cfg->poses[nv] = 0;
    is_good = true;
  }
  if (is_good) return SV_OK;
  return sv_fail(err, SV_E_ARG,
                 "replay: \"%.*s\" is not an option; there are speed=max|realtime|0.001..1000, from=N, "
                 "count=N, poses=FILE",
                 (int)n, p);
}

sv_status sv_replay_parse(const char *spec, sv_replay_cfg *cfg, sv_err *err) {
  *cfg = (sv_replay_cfg){.speed = 0};
  size_t n = strcspn(spec, ",");
  if (n == 0 || n >= sizeof cfg->dir)
    return sv_fail(err, SV_E_ARG, "replay: expected a folder of 1 to %d characters",
                   (int)sizeof cfg->dir - 1);
  memcpy(cfg->dir, spec, n);
  for (const char *p = spec + n; *p == ',';) {
    size_t len = strcspn(++p, ",");
    sv_status s = read_option(p, len, cfg, err);
    if (s < 0) return s;
    p += len;
  }
  return SV_OK;
}

// --- start-up ------------------------------------------------------------------------------------
static int end_of(const sv_replay *r, int c) {
  int n = r->capture.cameras[c].n_frames, left = n - r->cfg.from;
  if (left <= 0) return r->cfg.from;
  return r->cfg.count && r->cfg.count < left ? r->cfg.from + r->cfg.count : n;
}

// Opens a camera's folder and learns its largest file. A missing file is found again when it is
// due.
static sv_status open_camera(sv_replay *r, int c, sv_err *err) {
  const sv_capture_camera *cc = &r->capture.cameras[c];
  char path[SV_CAPTURE_CAP_PATH + 264];
  sv_fmt(path, sizeof path, "%s/%s", r->cfg.dir, cc->folder);
  r->cameras[c].dir_fd = open(path, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (r->cameras[c].dir_fd < 0)
    return sv_fail(err, SV_E_NOT_FOUND, "%s: the camera's folder cannot be opened: %s", path,
                   sv_linux_reason(errno));
  for (int i = r->cfg.from; i < end_of(r, c); i++) {
    struct stat st;
    if (fstatat(r->cameras[c].dir_fd, cc->frames[i].file, &st, 0) < 0) continue;
    size_t bytes = (size_t)st.st_size;
    if (bytes > r->cap_file && bytes <= MAX_FILE_BYTES) r->cap_file = bytes;
  }
  return SV_OK;
}

int sv_replay_most_exposures(const sv_replay *r) {
  int least = -1;
  for (int c = 0; c < r->capture.n_cameras; c++) {
    int n = end_of(r, c) - r->cfg.from;
    if (least < 0 || n < least) least = n;
  }
  return least < 0 ? 0 : least;
}

sv_ns sv_replay_span_ns(const sv_replay *r) {
  sv_ns last_ns = 0;
  for (int c = 0; c < r->capture.n_cameras; c++) {
    if (r->cfg.from >= end_of(r, c)) return 0;
    const sv_ns ns = r->capture.cameras[c].frames[end_of(r, c) - 1].arrival_ns;
    if (c == 0 || ns < last_ns) last_ns = ns;
  }
  return last_ns > r->first_ns ? last_ns - r->first_ns : 0;
}

static sv_status take_buffers(sv_replay *r, sv_arena *arena) {
  sv_codec_cfg cc = {1, 1, true};
  for (int c = 0; c < r->capture.n_cameras; c++) {
    const sv_camera_caps *caps = &r->capture.cameras[c].caps;
    r->cameras[c].buffers = SV_TAKE(arena, uint8_t, caps->frame_bytes * (size_t)r->cfg.n_buffers);
    if (caps->width_px > cc.max_width_px) cc.max_width_px = caps->width_px;
    if (caps->height_px > cc.max_height_px) cc.max_height_px = caps->height_px;
  }
  r->file = SV_TAKE(arena, uint8_t, r->cap_file + 1); // one more tells a file that has grown
  return arena->status < 0 ? arena->status : sv_codec_init(&r->codec, &cc, arena);
}

static void find_first(sv_replay *r) {
  bool has_any = false;
  for (int c = 0; c < r->capture.n_cameras; c++) {
    if (r->cfg.from >= end_of(r, c)) continue;
    sv_ns t_ns = r->capture.cameras[c].frames[r->cfg.from].arrival_ns;
    if (!has_any || t_ns < r->first_ns) r->first_ns = t_ns;
    has_any = true;
  }
}

static sv_status init(sv_replay *r, sv_arena *arena, sv_err *err) {
  sv_arena_part_begin(arena, "replay");
  sv_status s = sv_capture_load(&r->capture, r->cfg.dir, arena, err);
  if (s >= 0 && *r->cfg.poses) s = sv_capture_load_poses(&r->capture, r->cfg.poses, arena, err);
  if (s < 0) {
    r->capture.n_cameras = 0;
    return s;
  }
  int n_cameras = r->capture.n_cameras;
  r->capture.n_cameras = 0; // until there is something to close
  r->cameras = SV_TAKE(arena, sv_replay_camera, n_cameras);
  if (arena->status < 0)
    return sv_fail(err, arena->status, "%s: the memory left does not hold its cameras", r->cfg.dir);
  for (int c = 0; c < n_cameras; c++) r->cameras[c] = (sv_replay_camera){.dir_fd = -1};
  r->capture.n_cameras = n_cameras;
  for (int c = 0; c < n_cameras && s == SV_OK; c++) s = open_camera(r, c, err);
  if (s < 0) return s;
  s = take_buffers(r, arena);
  if (s < 0)
    return sv_fail(err, s, "%s: the memory left does not hold %d frames of each of its %d cameras",
                   r->cfg.dir, r->cfg.n_buffers, n_cameras);
  find_first(r);
  r->virtual_ns = r->first_ns;
  r->started_ns = r->machine.now_ns(r->machine.self);
  return SV_OK;
}

sv_status sv_replay_init(sv_replay *r, const sv_replay_cfg *cfg, sv_arena *arena, sv_err *err) {
  memset(r, 0, sizeof *r);
  r->cfg = *cfg;
  r->machine = sv_linux_clock();
  if (!r->cfg.n_buffers) r->cfg.n_buffers = 8;
  if (r->cfg.n_buffers < 1 || r->cfg.n_buffers > CAP_BUFFERS || !(r->cfg.speed >= 0) || r->cfg.from < 0 ||
      r->cfg.count < 0)
    return sv_fail(err, SV_E_ARG, "replay: buffers (1 to %d), speed, from or count are out of range",
                   CAP_BUFFERS);
  sv_status s = init(r, arena, err);
  if (s < 0) sv_replay_close(r);
  return s;
}

void sv_replay_close(sv_replay *r) {
  for (int c = 0; c < r->capture.n_cameras; c++)
    if (r->cameras[c].dir_fd >= 0) close(r->cameras[c].dir_fd);
  r->capture.n_cameras = 0;
  sv_codec_close(&r->codec);
}

// --- clock ---------------------------------------------------------------------------------------
static sv_ns clock_now(void *self) {
  sv_replay *r = self;
  if (r->cfg.speed == 0) return r->virtual_ns;
  double since_ns = (double)(r->machine.now_ns(r->machine.self) - r->started_ns);
  return r->first_ns + (sv_ns)(since_ns * r->cfg.speed);
}

static void clock_sleep(void *self, sv_ns host_ns) {
  sv_replay *r = self;
  if (r->cfg.speed == 0) {
    if (host_ns > r->virtual_ns) r->virtual_ns = host_ns;
    return;
  }
  double wait_ns = (double)(host_ns - r->first_ns) / r->cfg.speed;
  if (wait_ns > 1e15) wait_ns = 1e15; // eleven days: a caller's "for ever"
  r->machine.sleep_until_ns(r->machine.self, r->started_ns + (sv_ns)wait_ns);
}

sv_clock sv_replay_clock(sv_replay *r) { return (sv_clock){r, clock_now, clock_sleep}; }

// --- source --------------------------------------------------------------------------------------
static sv_status source_caps(void *self, int c, sv_camera_caps *out) {
  sv_replay *r = self;
  if (c < 0 || c >= r->capture.n_cameras) return SV_E_ARG;
  *out = r->capture.cameras[c].caps;
  return SV_OK;
}

static sv_status source_start(void *self) {
  sv_replay *r = self;
  for (int c = 0; c < r->capture.n_cameras; c++) {
    r->cameras[c].i_next = r->cfg.from;
    r->cameras[c].stats = (sv_replay_stats){0};
  }
  r->first_err = (sv_err){0};
  r->has_event = false;
  r->virtual_ns = r->first_ns;
  r->started_ns = r->machine.now_ns(r->machine.self);
  r->is_running = true;
  return SV_OK;
}

// A stop takes all buffers back, as a driver does, also those that are still on loan.
static sv_status source_stop(void *self) {
  sv_replay *r = self;
  for (int c = 0; c < r->capture.n_cameras; c++) r->cameras[c].on_loan = 0;
  r->is_running = false;
  return SV_OK;
}

// The camera whose next frame came in first; -1 at the end.
static int next_camera(const sv_replay *r) {
  int best = -1;
  sv_ns best_ns = 0;
  for (int c = 0; c < r->capture.n_cameras; c++) {
    if (r->cameras[c].i_next >= end_of(r, c)) continue;
    sv_ns t_ns = r->capture.cameras[c].frames[r->cameras[c].i_next].arrival_ns;
    if (best < 0 || t_ns < best_ns) {
      best = c;
      best_ns = t_ns;
    }
  }
  return best;
}

static sv_status read_file(sv_replay *r, int c, const char *name, size_t *bytes) {
  // a pipe would hold it up
  int fd = openat(r->cameras[c].dir_fd, name, O_RDONLY | O_NONBLOCK | O_CLOEXEC);
  const char *folder = r->capture.cameras[c].folder;
  if (fd < 0)
    return sv_fail(&r->last_err, SV_E_NOT_FOUND, "%s/%s: cannot be read: %s", folder, name,
                   sv_linux_reason(errno));
  size_t got = 0;
  ssize_t n = 1;
  while (n != 0 && got < r->cap_file + 1) {
    n = read(fd, r->file + got, r->cap_file + 1 - got);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) break;
    got += (size_t)n;
  }
  close(fd);
  *bytes = got;
  if (n < 0) return sv_fail(&r->last_err, SV_E_IO, "%s/%s: reading failed", folder, name);
  if (got == 0) return sv_fail(&r->last_err, SV_E_FORMAT, "%s/%s: is empty", folder, name);
  if (got > r->cap_file)
    return sv_fail(&r->last_err, SV_E_RANGE, "%s/%s: has grown since the start", folder, name);
  return SV_OK;
}

// Decodes into a buffer; a picture that cannot be had is black, or what could be read of it.
static bool read_picture(sv_replay *r, int c, const char *name, uint8_t *rgb) {
  const sv_camera_caps *caps = &r->capture.cameras[c].caps;
  sv_picture out = {caps->width_px, caps->height_px, caps->frame_bytes / (size_t)caps->height_px,
                    caps->format, rgb};
  size_t bytes = 0;
  sv_status s = read_file(r, c, name, &bytes);
  if (s == SV_OK) {
    sv_err err;
    s = sv_codec_decode(&r->codec, r->file, bytes, &out, &err);
    if (s < 0) sv_fail(&r->last_err, s, "%s/%s: %s", r->capture.cameras[c].folder, name, err.text);
  }
  if (s == SV_OK) return true;
  if (s != SV_E_CORRUPT) memset(rgb, 0, caps->frame_bytes);
  return false;
}

// Who asks for events reads the first sentence, which no later file changes.
static void note_bad(sv_replay *r, const sv_frame *f) {
  r->cameras[f->i_camera].stats.n_errors++;
  if (r->first_err.status < 0) return;
  r->first_err = r->last_err;
  r->first_bad =
      (sv_camera_event){SV_CAMERA_FILE, f->i_camera, f->arrival_ns, f->sequence, r->first_err.text};
  r->has_event = true;
}

// Fills in the next frame of camera c. DROPPED when it has no free buffer.
static sv_status deliver(sv_replay *r, int c, sv_frame *f) {
  sv_replay_camera *rc = &r->cameras[c];
  const sv_capture_frame *cf = &r->capture.cameras[c].frames[rc->i_next++];
  const sv_camera_caps *caps = &r->capture.cameras[c].caps;
  int i = 0;
  while (i < r->cfg.n_buffers && (rc->on_loan >> i & 1)) i++;
  if (i == r->cfg.n_buffers) {
    rc->stats.n_starved++;
    return SV_DROPPED;
  }
  uint8_t *rgb = rc->buffers + caps->frame_bytes * (size_t)i;
  *f = (sv_frame){.i_camera = c,
                  .sequence = cf->sequence,
                  .camera_ns = cf->camera_ns,
                  .arrival_ns = cf->arrival_ns,
                  .exposure_ns = cf->exposure_ns,
                  .width_px = caps->width_px,
                  .height_px = caps->height_px,
                  .stride_bytes = (int)(caps->frame_bytes / (size_t)caps->height_px),
                  .format = caps->format,
                  .data = rgb,
                  .data_bytes = caps->frame_bytes,
                  .is_error = !read_picture(r, c, cf->file, rgb),
                  .i_buffer = i};
  rc->on_loan |= (uint64_t)1 << i;
  rc->stats.n_delivered++;
  if (f->is_error) note_bad(r, f);
  return SV_OK;
}

static sv_status source_dequeue(void *self, sv_frame *f, sv_ns until_ns) {
  sv_replay *r = self;
  if (!r->is_running) return SV_END;
  for (;;) {
    int c = next_camera(r);
    if (c < 0) return SV_END;
    sv_ns due_ns = r->capture.cameras[c].frames[r->cameras[c].i_next].arrival_ns;
    if (clock_now(r) < due_ns) clock_sleep(r, due_ns < until_ns ? due_ns : until_ns);
    if (clock_now(r) < due_ns) return SV_AGAIN; // not before until_ns, or a signal came
    if (deliver(r, c, f) == SV_OK) return SV_OK;
  }
}

static sv_status source_requeue(void *self, const sv_frame *f) {
  sv_replay *r = self;
  if (f->i_camera < 0 || f->i_camera >= r->capture.n_cameras || f->i_buffer < 0 ||
      f->i_buffer >= r->cfg.n_buffers)
    return SV_E_ARG;
  uint64_t bit = (uint64_t)1 << f->i_buffer;
  if (!(r->cameras[f->i_camera].on_loan & bit)) return SV_E_ARG; // handed back twice
  r->cameras[f->i_camera].on_loan &= ~bit;
  return SV_OK;
}

static sv_status source_pose(void *self, sv_ns host_ns, sv_pose *rig_from_world) {
  return sv_capture_pose_at(&((sv_replay *)self)->capture, host_ns, rig_from_world);
}

static sv_status source_event(void *self, sv_camera_event *e) {
  sv_replay *r = self;
  if (!r->has_event) return SV_AGAIN;
  r->has_event = false;
  *e = r->first_bad;
  return SV_OK;
}

sv_source sv_replay_source(sv_replay *r) {
  return (sv_source){.self = r,
                     .n_cameras = r->capture.n_cameras,
                     .caps = source_caps,
                     .start = source_start,
                     .dequeue = source_dequeue,
                     .requeue = source_requeue,
                     .stop = source_stop,
                     .rig_pose = source_pose,
                     .event = source_event};
}
