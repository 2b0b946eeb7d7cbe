// SPDX-License-Identifier: Apache-2.0
// JPEG and PNG through libjpeg and libpng, without heap.
// Owns one fixed block, which both libraries use through a memory manager and which is emptied
// after each image. One codec serves one thread and must not move between init and close. Never
// calls the heap after init: only sv_codec_init lets libjpeg take a few small blocks (its two codec
// objects), which sv_codec_close returns.
#ifndef SV_PLATFORM_CODEC_CODEC_H
#define SV_PLATFORM_CODEC_CODEC_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "src/base/arena.h"
#include "src/port/port.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  int max_width_px, max_height_px; // larger images are E_RANGE
  bool has_progressive;            // also progressive JPEG and interlaced PNG: these need the
                                   // coefficients of the whole image (6 bytes a pixel) in the block
} sv_codec_cfg;

typedef struct {
  sv_codec_cfg cfg;
  void *state;    // libjpeg's objects, in the arena
  uint8_t *block; // [block_bytes] working memory of one image
  size_t block_bytes, used_bytes, high_bytes;
} sv_codec;

typedef struct {
  sv_pixel_format format; // SV_PIX_JPEG or SV_PIX_PNG
  int width_px, height_px;
  int n_channels; // 1 grey, 2 grey+alpha, 3 RGB, 4 RGBA (or CMYK in a JPEG)
  int bits;       // of one channel in the file
} sv_codec_info;

size_t sv_codec_bytes(const sv_codec_cfg *cfg); // 0 when cfg is out of range (1..32768 px a side)
sv_status sv_codec_init(sv_codec *c, const sv_codec_cfg *cfg, sv_arena *arena) SV_MUST_USE;
void sv_codec_close(sv_codec *c);

// Describes an image from its header alone; needs no codec. E_FORMAT when it is neither JPEG nor
// PNG, or truncated before its size.
sv_status sv_codec_probe(const uint8_t *data, size_t bytes, sv_codec_info *out, sv_err *err) SV_MUST_USE;

// The image to fill: width_px x height_px must agree with the file (E_RANGE otherwise).
typedef struct {
  int width_px, height_px;
  size_t stride_bytes;    // at least width * pixel size
  sv_pixel_format format; // see decode_* below
  uint8_t *data;          // [height][stride]
} sv_picture;

// format: RGB8 or GREY8. A damaged image is decoded as far as possible and E_CORRUPT is returned.
// Extra bytes between segments, which many webcams send, are not damage.
sv_status sv_codec_decode_jpeg(sv_codec *c, const uint8_t *data, size_t bytes, const sv_picture *out,
                               sv_err *err) SV_MUST_USE;
// format: GREY8, RGB8, RGBA8 (alpha 255 when the file has none), RGB16 (grey is repeated, so 16-bit
// depth maps keep all bits). RGB8 and GREY8 drop alpha without blending.
sv_status sv_codec_decode_png(sv_codec *c, const uint8_t *data, size_t bytes, const sv_picture *out,
                              sv_err *err) SV_MUST_USE;
// Either format, by the first bytes.
sv_status sv_codec_decode(sv_codec *c, const uint8_t *data, size_t bytes, const sv_picture *out,
                          sv_err *err) SV_MUST_USE;

typedef struct {
  int quality;        // 1..100
  bool is_full_color; // chroma at full resolution (4:4:4, else 4:2:0)
} sv_jpeg_options;
typedef struct {
  uint8_t *data; // [cap_bytes]
  size_t cap_bytes;
} sv_codec_buffer;
// in (format RGB8 or GREY8) -> JPEG of so many bytes. E_FULL when out is too small:
// width * height * 3 + 4096 always suffices in practice, a tenth of it usually.
sv_status sv_codec_encode_jpeg(sv_codec *c, const sv_picture *in, sv_jpeg_options o, sv_codec_buffer out,
                               size_t *bytes, sv_err *err) SV_MUST_USE;

// GREY8, RGB8 or RGB16 -> PNG in out[cap], without loss. sv_codec_png_cap bytes always suffice;
// E_FULL.
sv_status sv_codec_encode_png(sv_codec *c, const sv_picture *in, uint8_t *out, size_t cap, size_t *bytes,
                              sv_err *err) SV_MUST_USE;
size_t sv_codec_png_cap(int width_px, int height_px, sv_pixel_format format);

#ifdef __cplusplus
}
#endif
#endif
