// SPDX-License-Identifier: Apache-2.0
// One channel of an OpenEXR file as floats, by the library OpenEXRCore where the build has it (flat
// images in scan lines, of any compression that it knows). Owns nothing; never writes a file.
#ifndef SV_TOOLS_COMMON_EXR_H
#define SV_TOOLS_COMMON_EXR_H

#include <stdbool.h>

#include "src/base/status.h"

#ifdef __cplusplus
extern "C" {
#endif

// Whether this build can read them.
bool lab_has_exr(void);

// The channel of that name of an image of exactly that size: dst [height_px][width_px], rows from
// the top. E_UNSUPPORTED in builds without the library.
typedef struct {
  const char *channel;
  int width_px, height_px;
} lab_exr_want;
sv_status lab_exr_read(const char *path, const lab_exr_want *want, float *dst, sv_err *err) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
