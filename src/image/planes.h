// SPDX-License-Identifier: Apache-2.0
// Images in memory: three float planes (rendered and trained) and 8-bit images (from cameras and
// files). Values 0..1 are display values unless said otherwise. Owns nothing: planes lie in the
// caller's arena, 8-bit images belong to their source.
// Never reads files and never changes the size of an image.
#ifndef SV_IMAGE_PLANES_H
#define SV_IMAGE_PLANES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "src/base/arena.h"
#include "src/base/status.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_PLANE_PAD 32 // strides and padded heights are multiples of it

// Three planes of one size. Pixel (x, y) of channel k is c[k][y * stride + x]. Columns [width,
// stride) and rows [height, rows_padded) exist; gradient planes hold exact zeros there.
typedef struct {
  float *c[3];                     // R, G, B; each [rows_padded][stride], 64-byte aligned
  int width_px, height_px, stride; // stride in floats
  int rows_padded;
} sv_planes;

static inline int sv_plane_pad(int n) { return (n + SV_PLANE_PAD - 1) / SV_PLANE_PAD * SV_PLANE_PAD; }
// Floats of one padded plane.
static inline size_t sv_plane_floats(int width_px, int height_px) {
  return (size_t)sv_plane_pad(width_px) * (size_t)sv_plane_pad(height_px);
}

// Takes three cleared planes from the arena. On a dry arena it only counts. E_ARG for a side
// outside 1..16384, else the arena's status.
sv_status sv_planes_init(sv_planes *p, int width_px, int height_px, sv_arena *a) SV_MUST_USE;

// Reuses the memory for a smaller image (coarse to fine): sets size, stride and padding and clears
// the new planes. E_RANGE when it does not fit in the cap_floats of each plane.
sv_status sv_planes_resize(sv_planes *p, int width_px, int height_px, size_t cap_floats) SV_MUST_USE;

// Sets every float of the three planes, padding included, to 0.
void sv_planes_clear(sv_planes *p);
// Another size in the same memory, whose values are then undefined. Never more than it was
// initialised for.
void sv_planes_set_size(sv_planes *p, int width_px, int height_px);

// An image of bytes that someone else owns: [height][stride_bytes], n_channels interleaved (1
// grey, 3 RGB, 4 RGB and straight alpha).
typedef struct {
  const uint8_t *px;
  int width_px, height_px, n_channels, stride_bytes;
  const uint8_t *mask; // [height][width] 0: the pixel is ignored; NULL: all of them count
} sv_image_u8;

// Whether a pixel of the image at 1/k counts: none of the k x k pixels that it is the mean of is
// ignored.
static inline bool sv_image_counts(const sv_image_u8 *im, int k, int x, int y) {
  if (!im->mask) return true;
  const uint8_t *at = im->mask + (size_t)y * (size_t)k * (size_t)im->width_px + (size_t)x * (size_t)k;
  for (int j = 0; j < k; j++, at += im->width_px)
    for (int i = 0; i < k; i++)
      if (!at[i]) return false;
  return true;
}
// Pixels that count.
long sv_image_n_counted(const sv_image_u8 *im);

#ifdef __cplusplus
}
#endif
#endif
