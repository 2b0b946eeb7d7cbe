// SPDX-License-Identifier: Apache-2.0
// Sensor noise (the paper, section 4.2): y ~ N(x, read + shot x) in linear light, clipped to [0,
// 1], rounded to 14 bits and stored display-referred (sRGB).
//
// Noise is a hash of two keys and the pixel's number, so it is the same on any machine and for any
// number of threads. Normal deviates come from tables (Box-Muller with 4096 radii and 1024 angles):
// mean 0, variance within 1e-3 of 1, at most 4.2 sigma.
#ifndef SV_IMAGE_NOISE_H
#define SV_IMAGE_NOISE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "src/base/arena.h"
#include "src/base/status.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_NOISE_CODE_MAX 16383 // 14 bits

typedef struct {
  float read, shot; // variance = read + shot x in linear light of [0, 1]; both >= 0
} sv_noise_model;

// Tables, shared by all threads.
typedef struct {
  uint8_t *srgb8;   // [16384] 14-bit linear -> display
  uint16_t *srgb16; // [16384]
  float *linear8;   // [256] display -> linear
  float *radius;    // [4096]
  float *turn_cos;  // [1024]
} sv_noise;

size_t sv_noise_bytes(void);
// Fills the tables; on a dry arena it only counts.
sv_status sv_noise_init(sv_noise *t, sv_arena *arena) SV_MUST_USE;

// One pixel of linear light: out may be in. Not clipped, not rounded.
void sv_noise_add(const sv_noise *t, const sv_noise_model *m, const uint32_t key[2], uint32_t i_pixel,
                  const float in[3], float out[3]);

// Linear light -> the sensor's code, 0..SV_NOISE_CODE_MAX: round(16383 x), clipped.
static inline int sv_noise_quantise(float x) {
  float c = x < 0 ? 0 : x > 1 ? 1 : x;
  return (int)(c * SV_NOISE_CODE_MAX + 0.5f);
}

typedef struct {
  sv_noise_model model;
  uint32_t key[2];    // of the image: other keys give independent noise
  bool is_over_black; // an image with straight alpha is composited over black, measured, and opaque
                      // afterwards
} sv_noise_job;

// Adds noise to n_px pixels in place: decode, add, quantise, encode. n_channels is 3, or 4 with
// alpha if is_over_black: the background of a transparent pixel belongs to the measurement.
// Otherwise E_ARG.
sv_status sv_noise_u8(const sv_noise *t, const sv_noise_job *job, uint8_t *px, int n_channels,
                      size_t n_px) SV_MUST_USE;
sv_status sv_noise_u16(const sv_noise *t, const sv_noise_job *job, uint16_t *px, int n_channels,
                       size_t n_px) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
