// SPDX-License-Identifier: Apache-2.0
// Stands in for libcamera.cc where libcamera's headers are not installed.
#include "platform/libcamera/libcamera.h"

static sv_status missing(sv_err *err) {
  return sv_fail(err, SV_E_UNSUPPORTED,
                 "this build has no libcamera; install libcamera-dev and build again, or use v4l2:");
}

const char *sv_libcamera_version(void) { return NULL; }
sv_status sv_libcamera_open(sv_libcamera **self, const sv_camera_options *cfg, const sv_clock *clock,
                            sv_err *err) {
  (void)cfg, (void)clock;
  *self = NULL;
  return missing(err);
}
void sv_libcamera_close(sv_libcamera *self) { (void)self; }
sv_source sv_libcamera_source(sv_libcamera *self) {
  (void)self;
  return (sv_source){.self = NULL};
}
int sv_libcamera_list(sv_str *out, sv_err *err) {
  (void)out;
  return missing(err);
}
