// SPDX-License-Identifier: Apache-2.0
// C only: the port is.
// Text in frames of a display. Owns nothing. Never reads pixels.
#ifndef SV_PLATFORM_DRM_TEXT_H
#define SV_PLATFORM_DRM_TEXT_H

#include "src/port/port.h"

// The characters ' ' to '~'; others become '?'. Nothing in a build without stb_easy_font.h.
void sv_drm_text(const sv_display_frame *f, const int at_px[2], int scale, const char *line);

#endif
