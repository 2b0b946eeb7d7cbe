// SPDX-License-Identifier: Apache-2.0
#include "src/port/port.h"

static const sv_pixel_info pixels[SV_N_PIXEL_FORMATS] = {
#define X(NAME, name, layout, bits, container_bits, phase)                                                   \
  {name, SV_LAYOUT_##layout, bits, container_bits, phase},
#include "src/port/pixel.inc"
#undef X
};

const sv_pixel_info *sv_pixel(sv_pixel_format f) {
  return &pixels[(unsigned)f < SV_N_PIXEL_FORMATS ? (unsigned)f : SV_PIX_NONE];
}

size_t sv_pixel_row_bytes(sv_pixel_format f, int n_px) {
  const sv_pixel_info *p = sv_pixel(f);
  size_t n = n_px > 0 ? (size_t)n_px : 0;
  switch (p->layout) {
  case SV_LAYOUT_RGB:
  case SV_LAYOUT_BGR: return n * 3 * (size_t)(p->container_bits / 8);
  case SV_LAYOUT_RGBX:
  case SV_LAYOUT_BGRX: return n * 4;
  case SV_LAYOUT_YUYV:
  case SV_LAYOUT_UYVY: return n * 2;
  case SV_LAYOUT_NV12: return n;
  case SV_LAYOUT_GREY:
  case SV_LAYOUT_BAYER: return (n * (size_t)p->container_bits + 7) / 8;
  default: return 0;
  }
}

size_t sv_pixel_frame_bytes(sv_pixel_format f, int width_px, int height_px) {
  size_t rows = height_px > 0 ? (size_t)height_px : 0;
  if (sv_pixel(f)->layout == SV_LAYOUT_NV12) rows += (rows + 1) / 2;
  return sv_pixel_row_bytes(f, width_px) * rows;
}

typedef struct {
  const char *name, *sentence;
} event_text;
static const event_text events[SV_N_CAMERA_EVENTS] = {
#define X(NAME, name, sentence) {name, sentence},
#include "src/port/camera_event.inc"
#undef X
};

const char *sv_camera_event_name(sv_camera_event_kind k) {
  return (unsigned)k < SV_N_CAMERA_EVENTS ? events[k].name : "?";
}
const char *sv_camera_event_sentence(sv_camera_event_kind k) {
  return (unsigned)k < SV_N_CAMERA_EVENTS ? events[k].sentence : "?";
}
