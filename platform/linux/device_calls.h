// SPDX-License-Identifier: Apache-2.0
// System calls on a device's file, in the form of the tables behind which tests put devices of
// their own (platform/v4l2/sys.h, platform/drm/sys.h). Failures are negative error numbers.
// Owns nothing. Never allocates.
#ifndef SV_PLATFORM_LINUX_DEVICE_CALLS_H
#define SV_PLATFORM_LINUX_DEVICE_CALLS_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

// self is not used.
int sv_linux_device_open(void *self, const char *path); // read and write, not blocking
int sv_linux_device_close(void *self, int fd);
// Repeated when a signal interrupts it.
int sv_linux_device_ioctl(void *self, int fd, unsigned long request, void *arg);
// Shared, readable and writable; NULL: failed.
void *sv_linux_device_map(void *self, int fd, size_t bytes, int64_t offset);
int sv_linux_device_unmap(void *self, void *p, size_t bytes);

#ifdef __cplusplus
}
#endif
#endif
