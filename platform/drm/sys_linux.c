// SPDX-License-Identifier: Apache-2.0
#include <errno.h>
#include <fcntl.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <unistd.h>

#include "platform/drm/sys.h"

static int sys_open(void *self, const char *path) {
  (void)self;
  int fd = open(path, O_RDWR | O_NONBLOCK | O_CLOEXEC);
  return fd < 0 ? -errno : fd;
}

static int sys_close(void *self, int fd) {
  (void)self;
  return close(fd) < 0 ? -errno : 0;
}

static int sys_ioctl(void *self, int fd, unsigned long request, void *arg) {
  int r;
  (void)self;
  do r = ioctl(fd, request, arg);
  while (r < 0 && errno == EINTR);
  return r < 0 ? -errno : r;
}

static void *sys_map(void *self, int fd, size_t bytes, int64_t offset) {
  (void)self;
  void *p = mmap(NULL, bytes, PROT_READ | PROT_WRITE, MAP_SHARED, fd, (off_t)offset);
  return p == MAP_FAILED ? NULL : p;
}

static int sys_unmap(void *self, void *p, size_t bytes) {
  (void)self;
  return munmap(p, bytes) < 0 ? -errno : 0;
}

static int64_t sys_read(void *self, int fd, void *to, size_t cap) {
  (void)self;
  const ssize_t n = read(fd, to, cap);
  return n < 0 ? -errno : n;
}

sv_drm_sys sv_drm_linux(void) {
  return (sv_drm_sys){NULL, sys_open, sys_close, sys_ioctl, sys_map, sys_unmap, sys_read};
}
