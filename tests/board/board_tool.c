// SPDX-License-Identifier: Apache-2.0
// What the tests on the virtual board need beside subview itself, without a heap or a library:
//
//   board_tool control DEVICE NAME VALUE          sets a V4L2 control by the name that v4l2-ctl
//                                                 gives it
//   board_tool list [DRIVER]                      "DEVICE DRIVER CARD" of each video device (of
//                                                 this driver)
//   board_tool feed SECONDS FPS DEVICE:OFFSET_US...   plays frames into v4l2loopback devices, all
//   due at the same
//                                                 instants, each stamped so many microseconds later
#include <errno.h>
#include <fcntl.h>
#include <linux/videodev2.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <time.h>
#include <unistd.h>

#define CAP_FEEDS 4
#define N_BUFFERS 16 // as many as the loopback has (init)
#define WIDTH     64 // small: what is measured is time, and emulated processors are slow
#define HEIGHT    48

static int fail(const char *what, const char *where) {
  fprintf(stderr, "board_tool: %s: %s: %s\n", where, what, strerror(errno));
  return 1;
}

static int call(int fd, unsigned long request, void *arg) {
  int r;
  do r = ioctl(fd, request, arg);
  while (r < 0 && errno == EINTR);
  return r;
}

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

static int set_control(const char *device, const char *name, long value) {
  int fd = open(device, O_RDWR | O_NONBLOCK);
  if (fd < 0) return fail("cannot be opened", device);
  struct v4l2_query_ext_ctrl q = {.id = V4L2_CTRL_FLAG_NEXT_CTRL};
  for (; call(fd, VIDIOC_QUERY_EXT_CTRL, &q) == 0; q.id |= V4L2_CTRL_FLAG_NEXT_CTRL) {
    char plain[64];
    plain_name(q.name, plain, sizeof plain);
    if (strcmp(plain, name) != 0) continue;
    struct v4l2_control c = {.id = q.id, .value = (int32_t)value};
    int r = call(fd, VIDIOC_S_CTRL, &c) < 0 ? fail(name, device) : 0;
    close(fd);
    return r;
  }
  close(fd);
  errno = ENOENT;
  return fail(name, device);
}

static int list(const char *driver) {
  for (int i = 0; i < 64; i++) {
    char device[32];
    struct v4l2_capability cap;
    snprintf(device, sizeof device, "/dev/video%d", i);
    int fd = open(device, O_RDWR | O_NONBLOCK);
    if (fd < 0) continue;
    if (call(fd, VIDIOC_QUERYCAP, &cap) == 0 && (!driver || !strcmp(driver, (const char *)cap.driver)))
      printf("%s %s %s\n", device, cap.driver, cap.card);
    close(fd);
  }
  return 0;
}

// --- feeding v4l2loopback ------------------------------------------------------------------------

typedef struct {
  const char *device;
  int fd;
  long offset_us;
  uint8_t *map[N_BUFFERS];
  size_t bytes;
  unsigned n; // buffers
} feed;

static int open_feed(feed *f) {
  struct v4l2_format fmt = {.type = V4L2_BUF_TYPE_VIDEO_OUTPUT};
  struct v4l2_requestbuffers req = {
      .count = N_BUFFERS, .type = V4L2_BUF_TYPE_VIDEO_OUTPUT, .memory = V4L2_MEMORY_MMAP};
  f->fd = open(f->device, O_RDWR | O_NONBLOCK);
  if (f->fd < 0) return fail("cannot be opened", f->device);
  fmt.fmt.pix.width = WIDTH;
  fmt.fmt.pix.height = HEIGHT;
  fmt.fmt.pix.pixelformat = V4L2_PIX_FMT_YUYV;
  fmt.fmt.pix.field = V4L2_FIELD_NONE;
  fmt.fmt.pix.bytesperline = WIDTH * 2;
  fmt.fmt.pix.sizeimage = WIDTH * HEIGHT * 2;
  if (call(f->fd, VIDIOC_S_FMT, &fmt) < 0) return fail("no YUYV", f->device);
  if (call(f->fd, VIDIOC_REQBUFS, &req) < 0) return fail("no buffers", f->device);
  f->n = req.count < N_BUFFERS ? req.count : N_BUFFERS;
  for (unsigned i = 0; i < f->n; i++) {
    struct v4l2_buffer b = {.index = i, .type = req.type, .memory = req.memory};
    if (call(f->fd, VIDIOC_QUERYBUF, &b) < 0) return fail("no buffer", f->device);
    f->bytes = b.length;
    f->map[i] = mmap(NULL, b.length, PROT_READ | PROT_WRITE, MAP_SHARED, f->fd, b.m.offset);
    if (f->map[i] == MAP_FAILED) return fail("a buffer cannot be mapped", f->device);
  }
  int type = V4L2_BUF_TYPE_VIDEO_OUTPUT;
  return call(f->fd, VIDIOC_STREAMON, &type) < 0 ? fail("does not start", f->device) : 0;
}

static int put(feed *f, long k, int64_t due_us) {
  struct v4l2_buffer b = {
      .index = (unsigned)(k % f->n), .type = V4L2_BUF_TYPE_VIDEO_OUTPUT, .memory = V4L2_MEMORY_MMAP};
  int64_t stamp_us = due_us + f->offset_us;
  if (k >= (long)f->n) { // the oldest comes back; the loopback gives it at once
    struct v4l2_buffer old = {.type = b.type, .memory = b.memory};
    if (call(f->fd, VIDIOC_DQBUF, &old) == 0) b.index = old.index;
  }
  if (b.index >= f->n || f->bytes < WIDTH * HEIGHT * 2) {
    errno = ERANGE;
    return fail("gives a buffer that it does not have", f->device);
  }
  for (size_t i = 0; i < WIDTH * HEIGHT * 2; i += 2) { // a ramp that moves, without colour
    f->map[b.index][i] = (uint8_t)(i / 2 + (size_t)k);
    f->map[b.index][i + 1] = 128;
  }
  b.bytesused = WIDTH * HEIGHT * 2;
  b.field = V4L2_FIELD_NONE;
  b.flags = V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC;
  b.timestamp.tv_sec = stamp_us / 1000000;
  b.timestamp.tv_usec = stamp_us % 1000000;
  return call(f->fd, VIDIOC_QBUF, &b) < 0 ? fail("takes no frame", f->device) : 0;
}

static feed feeds[CAP_FEEDS];

static int play(double seconds, double fps, int n, char **specs) {
  feed *f = feeds;
  if (n > CAP_FEEDS || !(fps > 0)) return 2;
  for (int i = 0; i < n; i++) {
    char *colon = strrchr(specs[i], ':');
    if (!colon) return 2;
    *colon = 0;
    f[i].device = specs[i];
    f[i].offset_us = atol(colon + 1);
    if (open_feed(&f[i])) return 1;
  }
  struct timespec now;
  clock_gettime(CLOCK_MONOTONIC, &now);
  int64_t start_us = (int64_t)now.tv_sec * 1000000 + now.tv_nsec / 1000;
  for (long k = 0; (double)k < seconds * fps; k++) {
    int64_t due_us = start_us + (int64_t)((double)k * 1e6 / fps);
    struct timespec due = {.tv_sec = due_us / 1000000, .tv_nsec = due_us % 1000000 * 1000};
    clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &due, NULL);
    for (int i = 0; i < n; i++)
      if (put(&f[i], k, due_us)) return 1;
    if (k == 2) {
      printf("feeding\n");
      fflush(stdout);
    }
  }
  return 0;
}

int main(int argc, char **argv) {
  if (argc == 5 && !strcmp(argv[1], "control")) return set_control(argv[2], argv[3], atol(argv[4]));
  if (argc >= 2 && argc <= 3 && !strcmp(argv[1], "list")) return list(argc > 2 ? argv[2] : NULL);
  if (argc >= 5 && !strcmp(argv[1], "feed")) return play(atof(argv[2]), atof(argv[3]), argc - 4, argv + 4);
  fprintf(
      stderr,
      "usage: board_tool control DEVICE NAME VALUE | list [DRIVER] | feed SECONDS FPS DEVICE:OFFSET_US...\n");
  return 2;
}
