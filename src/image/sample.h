// SPDX-License-Identifier: Apache-2.0
// Single pixels of any camera format, few and quickly: nearest samples, no interpolation, no curve
// but for raw light. For thumbnails and meters. Owns nothing.
// Never reads compressed frames; training uses convert.h instead.
#ifndef SV_IMAGE_SAMPLE_H
#define SV_IMAGE_SAMPLE_H

#include "src/port/port.h"

#ifdef __cplusplus
extern "C" {
#endif

// False for compressed and unknown formats, and for frames that are shorter than they say: sources
// mark those, but meters come before that is looked at.
bool sv_sample_can(const sv_frame *f);
// RGB, 0 to 255, of a pixel inside of a frame of which sv_sample_can holds.
void sv_sample(uint8_t rgb[3], const sv_frame *f, int x, int y);

#ifdef __cplusplus
}
#endif
#endif
