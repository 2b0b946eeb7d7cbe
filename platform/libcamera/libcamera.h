// SPDX-License-Identifier: Apache-2.0
// Cameras behind libcamera as one source. The shim is C++ (libcamera has no C interface); without
// libcamera's headers a few lines of C report that it is missing. Owns requests and buffers, which
// are created once and reused.
// Never allocates after init on our side; libcamera allocates inside of its own library while it
// runs. A lost camera is looked up by its id and opened again when udev reports it, through
// templates of libcamera that allocate.
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

// Opens the named cameras (numbers of the list, or ids), negotiates formats and maps the buffers.
// clock: CLOCK_MONOTONIC. One at a time in a process (libcamera's rule). E_UNSUPPORTED without the
// library; E_NOT_FOUND, E_RANGE, E_DEVICE with a sentence.
sv_status sv_libcamera_open(sv_libcamera **self, const sv_camera_options *cfg, const sv_clock *clock,
                            sv_err *err) SV_MUST_USE;
void sv_libcamera_close(sv_libcamera *self); // NULL is allowed
sv_source sv_libcamera_source(sv_libcamera *self);

// Lists one line per camera. Returns their number, or a negative status with a sentence.
int sv_libcamera_list(sv_str *out, sv_err *err);

#ifdef __cplusplus
}
#endif
#endif
