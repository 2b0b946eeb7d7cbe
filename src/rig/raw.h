// SPDX-License-Identifier: Apache-2.0
// A sensor's image as it was measured, owned by someone else: 8 or 16 bits a sample.
#ifndef SV_RIG_RAW_H
#define SV_RIG_RAW_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  const uint8_t *u8;   // [height_px][width_px][n_channels], 255 is 1; NULL when u16 is set
  const uint16_t *u16; // the same, 65535 is 1; NULL when u8 is set
  int width_px, height_px, n_channels;
} sv_raw;

// Channel c of pixel (x, y), 0..1. Bounds are not checked.
static inline float sv_raw_at(const sv_raw *r, int x, int y, int c) {
  size_t i = ((size_t)y * (size_t)r->width_px + (size_t)x) * (size_t)r->n_channels + (size_t)c;
  return r->u16 ? (float)r->u16[i] * (1.0f / 65535.0f) : (float)r->u8[i] * (1.0f / 255.0f);
}

#ifdef __cplusplus
}
#endif
#endif
