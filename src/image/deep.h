// SPDX-License-Identifier: Apache-2.0
// Deep pictures: more than 8 bits a value, kept in 16 bits of linear light. From raw frames (black
// level, white balance, demosaicing) and from 16-bit sRGB frames; beside each an RGB8 picture, as
// bright as the first exposure's would be, for all that looks at pictures but training.
// Owns nothing. Never undistorts.
#ifndef SV_IMAGE_DEEP_H
#define SV_IMAGE_DEEP_H

#include "kernels/kernels.h"
#include "src/port/port.h"
#include "src/rig/photometry.h"

#ifdef __cplusplus
extern "C" {
#endif

// A deep picture, and what its camera makes of light.
typedef struct {
  const uint16_t *px; // [3][height][width] linear light of 65535, of someone else; NULL: none
  int width_px, height_px;
  float exposure;   // shutter time over that of the first exposure
  float white;      // share of the sensor's range that is white, 1: light below counts from 0 to 1
  float read, shot; // variance of a value x of the sensor's range = read + shot x; read > 0
  // What its camera makes of the light that the reference camera would show; NULL: the same. Not
  // used where that is learned.
  const sv_photometry *photometric;
} sv_image_deep;

// Floats of scratch that a thread needs for a width.
#define SV_DEEP_SCRATCH_FLOATS(width_px) (3 * (((size_t)(width_px) + 31) & ~(size_t)31))

typedef struct {
  uint16_t *linear;  // [3][height][width] out
  uint8_t *rgb;      // [height][3 width] out
  uint16_t *samples; // [height][width] scratch of Bayer frames, else NULL
  float *scratch;    // [n_threads][SV_DEEP_SCRATCH_FLOATS]
  float light;       // factor on the light of rgb: 1 / (exposure white)
} sv_deep_buffers;

// Whether a camera's frames have more than 8 bits of linear light: raw with linear samples, or
// RGB16.
bool sv_deep_knows(const sv_camera_caps *c);
// A frame whose format and size are as caps says, which sv_deep_knows.
void sv_deep_convert(const sv_frame *f, const sv_camera_caps *caps, const sv_deep_buffers *b,
                     const sv_kernels *k, const sv_pool *pool);

// Deep pictures made smaller, by area as kernels/area/area.h has it, but exact: linear light is
// added up in whole numbers.
typedef struct {
  const uint16_t *src; // [3][src_height][src_width] at steps of src_plane and src_stride values
  size_t src_plane, src_stride;
  int src_width_px, src_height_px; // at most 16384
  uint16_t *dst;                   // [3][dst_height][dst_width]. Not src
  int dst_width_px, dst_height_px; // at most those of src
  int row0, row1;                  // rows of dst
  uint32_t *scratch;               // [src_width]
} sv_deep_reduction;
void sv_deep_reduce(const sv_deep_reduction *r);

// A deep picture as a frame of RGB16: [height][width][3] of two bytes, sRGB. scratch:
// SV_DEEP_SCRATCH_FLOATS.
void sv_deep_encode(const uint16_t *linear, int width_px, int height_px, uint8_t *rgb16, float *scratch,
                    const sv_kernels *k);

// What is white in a picture of n values: its 99th percentile, at least 1/256.
float sv_deep_white(const uint16_t *linear, size_t n);
// Value of the noise curve at which a deep picture is taken for saturated.
float sv_deep_saturated(const sv_image_deep *d);
// Its noise with light that counts from 0 to white.
static inline float sv_deep_read(const sv_image_deep *d) { return d->read / (d->white * d->white); }
static inline float sv_deep_shot(const sv_image_deep *d) { return d->shot / d->white; }

#ifdef __cplusplus
}
#endif
#endif
