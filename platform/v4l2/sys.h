// SPDX-License-Identifier: Apache-2.0
// The system calls that the V4L2 source makes, as a table: tests put a device of their own behind
// it.
#ifndef SV_PLATFORM_V4L2_SYS_H
#define SV_PLATFORM_V4L2_SYS_H

#include <poll.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

// Failures are negative error numbers (-ENODEV).
typedef struct {
  void *self;
  int (*open)(void *self, const char *path); // read and write, not blocking; the descriptor
  int (*close)(void *self, int fd);
  // repeated when a signal interrupts it
  int (*ioctl)(void *self, int fd, unsigned long request, void *arg);
  // shared, readable; NULL: failed
  void *(*map)(void *self, int fd, size_t bytes, int64_t offset);
  int (*unmap)(void *self, void *p, size_t bytes);
  // Replaces a mapping by a private copy of its content at the same address, so that the device is
  // let go while someone still reads the frame.
  int (*detach)(void *self, void *p, size_t bytes);
  int (*poll)(void *self, struct pollfd *fds, int n, int timeout_ms);
} sv_v4l2_sys;

sv_v4l2_sys sv_v4l2_linux(void);

#ifdef __cplusplus
}
#endif
#endif
