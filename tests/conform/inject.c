// SPDX-License-Identifier: Apache-2.0
#include "tests/conform/inject.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/videodev2.h>
#include <stdio.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <unistd.h>

#include "platform/codec/codec.h"

#define WIDTH     64
#define HEIGHT    48
#define PERIOD_NS (40 * SV_NS_PER_MS)

static bool fail(const char *what, const char *where) {
  fprintf(stderr, "source-faults: %s: %s: %s\n", where, what, strerror(errno));
  return false;
}

static int call(int fd, unsigned long request, void *arg) {
  int r;
  do r = ioctl(fd, request, arg);
  while (r < 0 && errno == EINTR);
  return r;
}

// --- controls ------------------------------------------------------------------------------------
// "Inject V4L2_BUF_FLAG_ERROR" -> "inject_v4l2_buf_flag_error".
static void plain_name(const char *from, char *to, size_t cap) {
  size_t n = 0;
  for (; *from && n + 1 < cap; from++) {
    char c = *from;
    if (c >= 'A' && c <= 'Z') c = (char)(c - 'A' + 'a');
    if ((c >= 'a' && c <= 'z') || (c >= '0' && c <= '9')) to[n++] = c;
    else if (n && to[n - 1] != '_') to[n++] = '_';
  }
  while (n && to[n - 1] == '_') n--;
  to[n] = 0;
}

bool inject_control(inject *j, const char *name, long value) {
  int fd = open(j->path[0], O_RDWR | O_NONBLOCK);
  if (fd < 0) return fail("cannot be opened", j->path[0]);
  struct v4l2_query_ext_ctrl q = {.id = V4L2_CTRL_FLAG_NEXT_CTRL};
  for (; call(fd, VIDIOC_QUERY_EXT_CTRL, &q) == 0; q.id |= V4L2_CTRL_FLAG_NEXT_CTRL) {
    char plain[64];
    plain_name(q.name, plain, sizeof plain);
    if (strcmp(plain, name) != 0) continue;
    struct v4l2_control c = {.id = q.id, .value = (int32_t)value};
    bool is_set = call(fd, VIDIOC_S_CTRL, &c) >= 0 || fail(name, j->path[0]);
    close(fd);
    return is_set;
  }
  close(fd);
  errno = ENOENT;
  return fail(name, j->path[0]);
}

// --- the node ------------------------------------------------------------------------------------
bool inject_unplug(inject *j) {
  char hidden[80];
  snprintf(hidden, sizeof hidden, "%s.away", j->path[0]);
  if (!inject_control(j, "disconnect", 1)) return false;
  return rename(j->path[0], hidden) == 0 || fail("cannot be renamed", j->path[0]);
}

bool inject_replug(inject *j) {
  char hidden[80];
  snprintf(hidden, sizeof hidden, "%s.away", j->path[0]);
  snprintf(j->path[0], sizeof j->path[0], "/dev/video60");
  return rename(hidden, j->path[0]) == 0 || fail("cannot be renamed", hidden);
}

void inject_restore(inject *j) {
  if (strcmp(j->path[0], j->first_path) != 0) (void)rename(j->path[0], j->first_path);
  memcpy(j->path[0], j->first_path, sizeof j->path[0]);
}

// --- frames for v4l2loopback ---------------------------------------------------------------------
static bool make_jpeg(inject *j, int i, int w, int h) {
  static _Alignas(64) uint8_t block[1 << 20];
  static uint8_t px[WIDTH * HEIGHT * 3];
  sv_arena a = sv_arena_make(block, sizeof block);
  sv_codec codec;
  sv_codec_cfg cfg = {WIDTH, HEIGHT, false};
  for (int k = 0; k < w * h * 3; k++) px[k] = (uint8_t)(40 + k / 3 % w * 2 + k % 3 * 20);
  sv_picture in = {w, h, (size_t)w * 3, SV_PIX_RGB8, px};
  bool is_good =
      sv_codec_init(&codec, &cfg, &a) >= 0 &&
      sv_codec_encode_jpeg(&codec, &in, (sv_jpeg_options){90, true},
                           (sv_codec_buffer){j->jpeg[i], sizeof j->jpeg[i]}, &j->jpeg_bytes[i], NULL) >= 0;
  sv_codec_close(&codec);
  return is_good;
}

static bool open_feeder(inject_feeder *f, const char *path) {
  struct v4l2_format fmt = {.type = V4L2_BUF_TYPE_VIDEO_OUTPUT};
  struct v4l2_requestbuffers req = {
      .count = INJECT_CAP_BUFFERS, .type = V4L2_BUF_TYPE_VIDEO_OUTPUT, .memory = V4L2_MEMORY_MMAP};
  f->fd = open(path, O_RDWR | O_NONBLOCK);
  if (f->fd < 0) return fail("cannot be opened", path);
  fmt.fmt.pix = (struct v4l2_pix_format){.width = WIDTH,
                                         .height = HEIGHT,
                                         .pixelformat = V4L2_PIX_FMT_MJPEG,
                                         .field = V4L2_FIELD_NONE,
                                         .sizeimage = sizeof((inject *)0)->jpeg[0]};
  if (call(f->fd, VIDIOC_S_FMT, &fmt) < 0) return fail("no MJPG", path);
  if (call(f->fd, VIDIOC_REQBUFS, &req) < 0) return fail("no buffers", path);
  f->n = req.count < INJECT_CAP_BUFFERS ? req.count : INJECT_CAP_BUFFERS;
  for (unsigned i = 0; i < f->n; i++) {
    struct v4l2_buffer b = {.index = i, .type = req.type, .memory = req.memory};
    if (call(f->fd, VIDIOC_QUERYBUF, &b) < 0) return fail("no buffer", path);
    f->bytes = b.length;
    f->map[i] = mmap(NULL, b.length, PROT_READ | PROT_WRITE, MAP_SHARED, f->fd, b.m.offset);
    if (f->map[i] == MAP_FAILED) return fail("a buffer cannot be mapped", path);
  }
  int type = V4L2_BUF_TYPE_VIDEO_OUTPUT;
  return call(f->fd, VIDIOC_STREAMON, &type) >= 0 || fail("does not start", path);
}

static void put(inject_feeder *f, const uint8_t *data, size_t bytes, sv_ns stamp_ns) {
  struct v4l2_buffer b = {
      .index = f->i_next % f->n, .type = V4L2_BUF_TYPE_VIDEO_OUTPUT, .memory = V4L2_MEMORY_MMAP};
  if (f->i_next++ >= f->n) { // the oldest comes back at once
    struct v4l2_buffer old = {.type = b.type, .memory = b.memory};
    if (call(f->fd, VIDIOC_DQBUF, &old) == 0) b.index = old.index;
  }
  if (b.index >= f->n || bytes > f->bytes) return;
  memcpy(f->map[b.index], data, bytes);
  b.bytesused = (uint32_t)bytes;
  b.field = V4L2_FIELD_NONE;
  b.flags = V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC;
  b.timestamp.tv_sec = stamp_ns / SV_NS_PER_S;
  b.timestamp.tv_usec = stamp_ns % SV_NS_PER_S / SV_NS_PER_US;
  (void)call(f->fd, VIDIOC_QBUF, &b);
}

sv_ns inject_feed(inject *j, sv_ns now_ns) {
  if (!j->is_feeding) return INT64_MAX;
  if (!j->next_ns || now_ns - j->next_ns > SV_NS_PER_S) j->next_ns = now_ns;
  while (j->next_ns <= now_ns) {
    for (int i = 0; i < j->n_cameras; i++) {
      inject_kind kind = i ? INJECT_GOOD : j->kind;
      int k = kind == INJECT_OTHER_SIZE;
      if (kind != INJECT_SILENCE)
        put(&j->feeder[i], j->jpeg[k], kind == INJECT_SHORT ? j->jpeg_bytes[k] / 2 : j->jpeg_bytes[k],
            j->next_ns);
    }
    j->next_ns += PERIOD_NS;
  }
  return j->next_ns;
}

static bool become(inject *j, inject_kind kind) {
  j->kind = kind;
  return true;
}
bool inject_short(inject *j) { return become(j, INJECT_SHORT); }
bool inject_other_size(inject *j) { return become(j, INJECT_OTHER_SIZE); }
bool inject_silence(inject *j) { return become(j, INJECT_SILENCE); }
bool inject_good(inject *j) { return become(j, INJECT_GOOD); }

// --- all of it -----------------------------------------------------------------------------------
bool inject_open(inject *j, const char *cameras, bool is_feeding) {
  memset(j, 0, sizeof *j);
  for (const char *p = cameras; *p;) {
    size_t n = strcspn(p, ",");
    if (*p == '/' && n < sizeof j->path[0] && j->n_cameras < INJECT_CAP_CAMERAS)
      memcpy(j->path[j->n_cameras++], p, n);
    p += n + (p[n] == ',');
  }
  memcpy(j->first_path, j->path[0], sizeof j->first_path);
  if (!is_feeding) return true;
  if (!make_jpeg(j, 0, WIDTH, HEIGHT) || !make_jpeg(j, 1, WIDTH / 2, HEIGHT / 2)) return false;
  j->is_feeding = true;
  for (int i = 0; i < j->n_cameras; i++)
    if (!open_feeder(&j->feeder[i], j->path[i])) return false;
  return true;
}

void inject_close(inject *j) {
  for (int i = 0; j->is_feeding && i < j->n_cameras; i++) {
    for (unsigned k = 0; k < j->feeder[i].n; k++) munmap(j->feeder[i].map[k], j->feeder[i].bytes);
    close(j->feeder[i].fd);
  }
  j->is_feeding = false;
}
