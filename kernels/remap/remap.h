// SPDX-License-Identifier: Apache-2.0
// An image drawn from another one through a table of places: lens undistortion. Integers only, so
// exact for every variant.
//
// The table has one 6-byte entry per destination pixel. (x, y) is the upper left of four source
// pixels, counted from 0 at the first pixel, (fx, fy) the place between them in 1/256 pixel:
//   value = (sum over the taps of weight x byte + 32768) >> 16
//   weights (256-fx)(256-fy), fx (256-fy), (256-fx) fy, fx fy of (x,y), (x+1,y), (x,y+1), (x+1,y+1)
// A tap beyond the last column or row repeats the border. An entry with x = SV_REMAP_NONE is a
// place the source does not have: it gets the fill colour. Any other entry must have 0 <= x < src
// width and 0 <= y < src height (the builder's duty, calib/remap.c; sides up to 32767).
#ifndef SV_KERNELS_REMAP_H
#define SV_KERNELS_REMAP_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define SV_REMAP_NONE INT16_MIN

typedef struct {
  int16_t x, y;
  uint8_t fx, fy;
} sv_remap_tap;

typedef struct {
  const uint8_t *src; // [src_height][src_stride_bytes], RGB, 3 bytes a pixel
  int src_width_px, src_height_px;
  size_t src_stride_bytes;
  const sv_remap_tap *table; // [dst_height][dst_width]
  // [dst_height][dst_stride_bytes], RGB; bytes behind 3 width are kept. Not src
  uint8_t *dst;
  int dst_width_px;
  size_t dst_stride_bytes;
  uint8_t *mask; // [dst_height][dst_width] 255 where the source has the place, else 0; may be NULL
  uint8_t fill[3];
  int row0, row1; // rows of dst
} sv_remap_args;

typedef void sv_remap_fn(const sv_remap_args *a);

#ifdef __cplusplus
}
#endif
#endif
