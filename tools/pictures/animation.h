// SPDX-License-Identifier: Apache-2.0
// An animated WebP (libwebp) that plays in a loop.
#ifndef SV_TOOLS_PICTURES_ANIMATION_H
#define SV_TOOLS_PICTURES_ANIMATION_H

#include <stdbool.h>
#include <stdint.h>

#include "src/base/status.h"

typedef struct lab_animation lab_animation;

// False in a build without libwebp: begin then fails with E_UNSUPPORTED.
bool lab_animation_is_built(void);
// frame_ms: how long each frame stands. Free with lab_animation_free, which takes NULL, too.
sv_status lab_animation_begin(lab_animation **out, int width_px, int height_px, int frame_ms,
                              sv_err *err) SV_MUST_USE;
// rgb: [height][width][3]. Frames are compressed as they come.
sv_status lab_animation_add(lab_animation *a, const uint8_t *rgb, sv_err *err) SV_MUST_USE;
sv_status lab_animation_write(lab_animation *a, const char *path, sv_err *err) SV_MUST_USE;
void lab_animation_free(lab_animation *a);

#endif
