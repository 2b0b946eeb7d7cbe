// SPDX-License-Identifier: Apache-2.0
// Cameras behind libcamera as one source. The shim is one C++ file (libcamera has no C interface);
// it is built where libcamera's headers are, else a few lines of C say that it is missing.
// libcamera allocates inside of its own library while it runs; nothing on our side of it does after
// init. Requests and buffers are made once and reused. A camera that is lost is looked for by its
// id and opened again, which libcamera learns from udev; this goes through templates of libcamera's
// that allocate.
#ifndef SV_PLATFORM_LIBCAMERA_LIBCAMERA_H
#define SV_PLATFORM_LIBCAMERA_LIBCAMERA_H

#include "platform/camera/options.h"
#include "src/base/arena.h"
#include "src/base/str.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct sv_libcamera sv_libcamera;

// The library's version ("0.0.3"), or NULL: this build has none.
const char *sv_libcamera_version(void);

// Opens the cameras named (numbers of the list, or ids), agrees on formats and maps the buffers.
// clock: CLOCK_MONOTONIC. One at a time in a process (libcamera's rule). E_UNSUPPORTED without the
// library; E_NOT_FOUND, E_RANGE, E_DEVICE with a sentence.
sv_status sv_libcamera_open(sv_libcamera **self, const sv_camera_options *cfg, const sv_clock *clock,
                            sv_err *err) SV_MUST_USE;
void sv_libcamera_close(sv_libcamera *self); // NULL is nothing
sv_source sv_libcamera_source(sv_libcamera *self);

// A line a camera; how many there are, or a negative status with a sentence.
int sv_libcamera_list(sv_str *out, sv_err *err);

#ifdef __cplusplus
}
#endif
#endif
