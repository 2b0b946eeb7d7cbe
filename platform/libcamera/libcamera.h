// SPDX-License-Identifier: Apache-2.0
// Cameras behind libcamera as one source. The code that uses libcamera is C++ and belongs to one of
// libcamera's releases, so it is a module (subview-libcamera.so, module.h), opened when the first
// of these functions is called. Owns requests and buffers, which are created once and reused.
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

// Opens the named cameras (numbers of the list, or ids), negotiates formats and maps the buffers.
// clock: CLOCK_MONOTONIC. One at a time in a process (libcamera's rule). E_UNSUPPORTED without the
// module or its libcamera; E_NOT_FOUND, E_RANGE, E_DEVICE with a sentence.
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
