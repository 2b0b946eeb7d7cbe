// SPDX-License-Identifier: Apache-2.0
// A library to be preloaded into subview on the virtual board: while the file REFUSE_WHILE exists,
// the video device REFUSE_DEVICE takes buffers and gives none back, and does not start: a driver
// that has lost its camera and finds it again. Everything else goes to the kernel.
#include <errno.h>
#include <linux/videodev2.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

static int is_refused(int fd) {
  const char *device = getenv("REFUSE_DEVICE"), *file = getenv("REFUSE_WHILE");
  struct stat there, wanted;
  return device && file && access(file, F_OK) == 0 && fstat(fd, &there) == 0 && stat(device, &wanted) == 0 &&
         there.st_rdev == wanted.st_rdev;
}

int ioctl(int fd, unsigned long request, ...) {
  va_list ap;
  va_start(ap, request);
  void *arg = va_arg(ap, void *);
  va_end(ap);
  uint32_t r = (uint32_t)request;
  if ((r == (uint32_t)VIDIOC_QBUF || r == (uint32_t)VIDIOC_STREAMON) && is_refused(fd)) {
    if (r == (uint32_t)VIDIOC_QBUF) return 0;
    errno = ENODEV;
    return -1;
  }
  return (int)syscall(SYS_ioctl, fd, request, arg);
}
