// SPDX-License-Identifier: Apache-2.0
// The system calls that the display makes, as a table: tests put a card of their own behind it.
// Owns nothing. Never allocates.
#ifndef SV_PLATFORM_DRM_SYS_H
#define SV_PLATFORM_DRM_SYS_H

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
  // shared, readable and writable; NULL: failed
  void *(*map)(void *self, int fd, size_t bytes, int64_t offset);
  int (*unmap)(void *self, void *p, size_t bytes);
  int64_t (*read)(void *self, int fd, void *to, size_t cap); // of events
} sv_drm_sys;

sv_drm_sys sv_drm_linux(void);

#ifdef __cplusplus
}
#endif
#endif
