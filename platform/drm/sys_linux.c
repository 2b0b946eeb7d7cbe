// SPDX-License-Identifier: Apache-2.0
#include <errno.h>
#include <unistd.h>

#include "platform/drm/sys.h"
#include "platform/linux/device_calls.h"

static int64_t sys_read(void *self, int fd, void *to, size_t cap) {
  (void)self;
  const ssize_t n = read(fd, to, cap);
  return n < 0 ? -errno : n;
}

sv_drm_sys sv_drm_linux(void) {
  return (sv_drm_sys){NULL,
                      sv_linux_device_open,
                      sv_linux_device_close,
                      sv_linux_device_ioctl,
                      sv_linux_device_map,
                      sv_linux_device_unmap,
                      sys_read};
}
