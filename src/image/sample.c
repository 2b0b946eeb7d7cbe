// SPDX-License-Identifier: Apache-2.0
#include "src/image/sample.h"

#include <math.h>
#include <string.h>

#include "src/base/mathx.h"

// Sample i of a row of samples of `bits` bits (packed or in 16), as 8 bits.
static int sample(const uint8_t *row, int i, const sv_pixel_info *p) {
  if (p->container_bits == 8) return row[i];
  if (p->container_bits == 16) return (row[2 * i] | row[2 * i + 1] << 8) >> (p->bits - 8) & 255;
  if (p->container_bits == 10)
    return row[i / 4 * 5 + i % 4]; // the high bytes come first, the low bits after four
  return row[i / 2 * 3 + i % 2];   // 12 bits: after two
}

static uint8_t clamp(int v) { return (uint8_t)sv_clampi(v, 0, 255); }

// Full-range BT.601; a thumbnail does not show the difference to the other kinds.
static void from_yuv(uint8_t o[3], int y, int cb, int cr) {
  o[0] = clamp(y + (359 * (cr - 128) >> 8));
  o[1] = clamp(y - (88 * (cb - 128) >> 8) - (183 * (cr - 128) >> 8));
  o[2] = clamp(y + (454 * (cb - 128) >> 8));
}

static void from_bayer(uint8_t o[3], const sv_frame *f, const sv_pixel_info *p, int x, int y) {
  x &= ~1;
  y &= ~1;
  if (x + 1 >= f->width_px || y + 1 >= f->height_px) {
    memset(o, 0, 3);
    return;
  }
  int v[4];
  for (int k = 0; k < 4; k++) {
    v[k] = sample(f->data + (size_t)(y + k / 2) * (size_t)f->stride_bytes, x + k % 2, p);
    v[k] = (int)(sqrtf((float)v[k] / 255.0f) * 255.0f); // near enough to the display's curve
  }
  // red and blue lie across
  o[0] = (uint8_t)v[p->phase];
  o[2] = (uint8_t)v[3 - p->phase];
  o[1] = (uint8_t)((v[p->phase ^ 1] + v[p->phase ^ 2]) / 2);
}

void sv_sample(uint8_t o[3], const sv_frame *f, int x, int y) {
  const sv_pixel_info *p = sv_pixel(f->format);
  const uint8_t *row = f->data + (size_t)y * (size_t)f->stride_bytes, *q;
  switch (p->layout) {
  case SV_LAYOUT_GREY: o[0] = o[1] = o[2] = (uint8_t)sample(row, x, p); return;
  case SV_LAYOUT_RGB:
    for (int k = 0; k < 3; k++) o[k] = p->bits == 16 ? row[6 * x + 2 * k + 1] : row[3 * x + k];
    return;
  case SV_LAYOUT_BGR:
    o[0] = row[3 * x + 2];
    o[1] = row[3 * x + 1];
    o[2] = row[3 * x];
    return;
  case SV_LAYOUT_RGBX: memcpy(o, row + 4 * x, 3); return;
  case SV_LAYOUT_BGRX:
    o[0] = row[4 * x + 2];
    o[1] = row[4 * x + 1];
    o[2] = row[4 * x];
    return;
  case SV_LAYOUT_YUYV:
    q = row + 4 * (x / 2);
    from_yuv(o, q[2 * (x & 1)], q[1], q[3]);
    return;
  case SV_LAYOUT_UYVY:
    q = row + 4 * (x / 2);
    from_yuv(o, q[1 + 2 * (x & 1)], q[0], q[2]);
    return;
  case SV_LAYOUT_NV12:
    q = f->chroma ? f->chroma : f->data + (size_t)f->height_px * (size_t)f->stride_bytes;
    q += (size_t)(y / 2) * (size_t)(f->chroma ? f->chroma_stride_bytes : f->stride_bytes) +
         2 * (size_t)(x / 2);
    from_yuv(o, row[x], q[0], q[1]);
    return;
  default: from_bayer(o, f, p, x, y);
  }
}

bool sv_sample_can(const sv_frame *f) {
  const sv_pixel_info *p = sv_pixel(f->format);
  if (p->layout == SV_LAYOUT_NONE || p->layout == SV_LAYOUT_CODED) return false;
  if (!f->data || f->width_px < 1 || f->height_px < 1) return false;
  size_t rows = (size_t)f->height_px * (size_t)f->stride_bytes;
  if (f->data_bytes && !f->chroma && p->layout == SV_LAYOUT_NV12) rows += rows / 2;
  return !f->data_bytes ||
         f->data_bytes + (size_t)f->stride_bytes >= rows + sv_pixel_row_bytes(f->format, f->width_px);
}
