// SPDX-License-Identifier: Apache-2.0
#include "platform/linux/device_calls.h"

#include <errno.h>
#include <fcntl.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <unistd.h>

int sv_linux_device_open(void *self, const char *path) {
  (void)self;
  int fd = open(path, O_RDWR | O_NONBLOCK | O_CLOEXEC);
  return fd < 0 ? -errno : fd;
}

int sv_linux_device_close(void *self, int fd) {
  (void)self;
  return close(fd) < 0 ? -errno : 0;
}

int sv_linux_device_ioctl(void *self, int fd, unsigned long request, void *arg) {
  int r;
  (void)self;
  do r = ioctl(fd, request, arg);
  while (r < 0 && errno == EINTR);
  return r < 0 ? -errno : r;
}

void *sv_linux_device_map(void *self, int fd, size_t bytes, int64_t offset) {
  (void)self;
  void *p = mmap(NULL, bytes, PROT_READ | PROT_WRITE, MAP_SHARED, fd, (off_t)offset);
  return p == MAP_FAILED ? NULL : p;
}

int sv_linux_device_unmap(void *self, void *p, size_t bytes) {
  (void)self;
  return munmap(p, bytes) < 0 ? -errno : 0;
}
