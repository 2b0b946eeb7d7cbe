// SPDX-License-Identifier: Apache-2.0
// PNG and JPEG for host tools (libpng, libjpeg; heap). Sentences name the file.
#ifndef SV_TOOLS_COMMON_IMAGEIO_H
#define SV_TOOLS_COMMON_IMAGEIO_H

#include <stddef.h>
#include <stdint.h>

#include "src/base/status.h"

#ifdef __cplusplus
extern "C" {
#endif

// Interleaved rows without padding. 1 channel gray, 2 gray+alpha, 3 RGB, 4 RGBA (straight alpha).
typedef struct {
  int width_px, height_px, n_channels;
  int bits;      // 8 or 16 a sample
  uint8_t *u8;   // [height][width][n_channels] when bits is 8, else NULL
  uint16_t *u16; // the same when bits is 16
} sv_bitmap;

// Limits of the decoders: images beyond are refused before memory is taken.
#define SV_BITMAP_CAP_SIDE_PX 32767
#define SV_BITMAP_CAP_SAMPLES (1u << 29) // pixels times channels

// PNG (all kinds: palettes and 1, 2, 4 bits become 8-bit channels, transparency becomes alpha) or
// JPEG (gray or RGB), told apart by content. Free with sv_bitmap_free. On failure out is empty.
sv_status sv_bitmap_decode(const char *name, const void *data, size_t bytes, sv_bitmap *out,
                           sv_err *err) SV_MUST_USE;
sv_status sv_bitmap_read(const char *path, sv_bitmap *out, sv_err *err) SV_MUST_USE;
void sv_bitmap_free(sv_bitmap *b);

// In place. to_channels: 1 (luma, Rec. 601), 3 or 4 (alpha 255 when there was none; dropped, not
// composited, for 3). to_8: 16-bit samples rounded to 8 bits.
sv_status sv_bitmap_to_channels(sv_bitmap *b, int n_channels, sv_err *err) SV_MUST_USE;
sv_status sv_bitmap_to_8(sv_bitmap *b, sv_err *err) SV_MUST_USE;

// Any bitmap: 8 or 16 bits, 1 to 4 channels. Atomic (sv_file_write).
sv_status sv_bitmap_write_png(const char *path, const sv_bitmap *b, sv_err *err) SV_MUST_USE;
// 8 bits, 1 or 3 channels; quality 1..100.
sv_status sv_bitmap_write_jpeg(const char *path, const sv_bitmap *b, int quality, sv_err *err) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
