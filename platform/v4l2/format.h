// SPDX-License-Identifier: Apache-2.0
// V4L2's pixel formats and ours, in the order in which they are preferred.
#ifndef SV_PLATFORM_V4L2_FORMAT_H
#define SV_PLATFORM_V4L2_FORMAT_H

#include <stdint.h>

#include "src/port/port.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  char name[5]; // the FOURCC, "GREY"
  sv_pixel_format format;
} sv_v4l2_format;

extern const sv_v4l2_format sv_v4l2_formats[];
extern const int sv_v4l2_n_formats;

uint32_t sv_v4l2_fourcc(const char name[5]);
void sv_v4l2_fourcc_name(uint32_t fourcc, char out[5]);
int sv_v4l2_format_index(uint32_t fourcc); // -1: not known
// Buffers that a frame consists of: 2 of NV12M, else 1.
uint32_t sv_v4l2_format_planes(uint32_t fourcc);

#ifdef __cplusplus
}
#endif
#endif
