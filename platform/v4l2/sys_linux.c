// SPDX-License-Identifier: Apache-2.0
#include <errno.h>
#include <string.h>
#include <sys/mman.h>

#include "platform/linux/device_calls.h"
#include "platform/v4l2/sys.h"

static int sys_detach(void *self, void *p, size_t bytes) {
  (void)self;
  void *copy = mmap(NULL, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  if (copy == MAP_FAILED) return -errno;
  memcpy(copy, p, bytes);
  if (mremap(copy, bytes, bytes, MREMAP_MAYMOVE | MREMAP_FIXED, p) != MAP_FAILED) return 0;
  int e = errno;
  munmap(copy, bytes);
  return -e;
}

static int sys_poll(void *self, struct pollfd *fds, int n, int timeout_ms) {
  (void)self;
  int r = poll(fds, (nfds_t)n, timeout_ms);
  return r < 0 ? -errno : r;
}

sv_v4l2_sys sv_v4l2_linux(void) {
  return (sv_v4l2_sys){NULL,
                       sv_linux_device_open,
                       sv_linux_device_close,
                       sv_linux_device_ioctl,
                       sv_linux_device_map,
                       sv_linux_device_unmap,
                       sys_detach,
                       sys_poll};
}
