// SPDX-License-Identifier: Apache-2.0
// Conversion of camera frames to RGB8: Y'CbCr and demosaicing kernels over rows, compressed images
// through the port's decoder, raw samples through tables (black level, white balance, sRGB curve).
// Owns one frame of converted pixels. RGB8 frames pass through without a copy.
// Never converts a frame that does not become part of an exposure.
#ifndef SV_IMAGE_CONVERT_H
#define SV_IMAGE_CONVERT_H

#include "kernels/kernels.h"
#include "src/base/arena.h"
#include "src/image/deep.h"
#include "src/image/planes.h"
#include "src/port/compute.h"
#include "src/port/port.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  const sv_camera_caps *caps; // [n_cameras]; format NONE counts as RGB8
  int n_cameras, n_threads;
  const sv_decoder *decoder; // NULL: compressed formats are refused
  bool is_deep;              // for sv_convert_deep: all cameras have more than 8 bits (deep.h)
} sv_convert_cfg;

typedef struct {
  sv_convert_cfg cfg;
  uint8_t *rgb;  // one converted frame, the largest; NULL when all cameras deliver RGB8
  uint8_t *grey; // one frame of raw samples as bytes
  uint8_t *rows; // [n_threads][row_bytes] scratch of the demosaicing
  size_t row_bytes;
  uint8_t **tables;     // [n_cameras] of raw cameras: [4][SV_RAW_TABLE], by place in the pattern;
                        // else NULL
  sv_deep_buffers deep; // with is_deep; its rgb is the one above
  const uint8_t *coded; // what rgb was decoded from: an image that holds several cameras is decoded
                        // once
} sv_convert;

// Whether frames of this format can be converted, given a decoder.
bool sv_convert_knows(sv_pixel_format f);

// E_UNSUPPORTED for formats that cannot be converted (RGB16: only with is_deep); E_RANGE for sizes
// that a format does not allow. caps, decoder and arena must outlive it.
sv_status sv_convert_init(sv_convert *c, const sv_convert_cfg *cfg, sv_arena *arena, sv_err *err) SV_MUST_USE;

// The frame as RGB8; *out points into the frame or to memory of `c` that the next call overwrites.
// E_UNSUPPORTED or E_RANGE when the frame is not as its camera's caps say; the decoder's errors.
sv_status sv_convert_frame(sv_convert *c, const sv_frame *frame, const sv_kernels *k, const sv_pool *pool,
                           sv_image_u8 *out, sv_err *err) SV_MUST_USE;

// With is_deep: the frame as 16 bits of linear light, [3][height][width] in memory of `c`, and as
// RGB8 with `light` times the light.
sv_status sv_convert_deep(sv_convert *c, const sv_frame *frame, float light, const sv_compute *with,
                          sv_image_u8 *rgb, sv_err *err) SV_MUST_USE;

// Forgets the image that was decoded last. Call it when frames go back to their source.
void sv_convert_forget(sv_convert *c);

// Display value 0..255 of a sample of `bits` bits.
uint8_t sv_raw_tone_value(const sv_raw_tone *t, double gain, int bits, int sample);

#ifdef __cplusplus
}
#endif
#endif
