// SPDX-License-Identifier: Apache-2.0
// Pixels of a camera as the reference camera would show them: linear light, color matrix, falloff
// of the lens, display values again, in place. Integers only, so exact. Table look-ups: there is
// only the reference.
//   v[i] = clamp(sum over k of light[i][k][byte k], 0, 2^17 - 1)
//   byte i = display[min((v[i] inverse_falloff + 2^12) >> 13, 16383)]
// Saturated values become the least light that saturates.
#ifndef SV_KERNELS_CORRECT_H
#define SV_KERNELS_CORRECT_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define SV_CORRECT_ONE     65532 // of light: 4 x 16383
#define SV_CORRECT_FALLOFF 2048  // of inverse_falloff: 1
#define SV_CORRECT_CODES   16384

typedef struct {
  uint8_t *px; // [rows][stride_bytes], RGB
  size_t stride_bytes;
  int width_px;
  const int32_t *light;            // [3][3][256] to channel i from channel k
  const uint16_t *inverse_falloff; // [rows][width_px], at most 32767
  const uint8_t *display;          // [SV_CORRECT_CODES]
  int row0, row1;
} sv_correct_args;

typedef void sv_correct_fn(const sv_correct_args *a);

#ifdef __cplusplus
}
#endif
#endif
