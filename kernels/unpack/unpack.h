// SPDX-License-Identifier: Apache-2.0
// Bytes to planes: RGB or RGBA (straight alpha) -> three float planes in [0, 1], reduced k x k by
// area average. With alpha the image is first laid over a background colour, then averaged:
//   out = mean(c a) + (1 - mean a) bg       (c, a in 0..1)
// The sums are integers below 2^24, so every order gives the same bits. Exact for AVX2, AVX-512 and
// NEON; SSE4.1 abs = 1e-6 (RGBA only).
#ifndef SV_KERNELS_UNPACK_H
#define SV_KERNELS_UNPACK_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define SV_UNPACK_CAP_K 8
// Floats of scratch for a source of this width; 64-byte aligned, one per thread, contents free.
#define SV_UNPACK_SCRATCH_FLOATS(width_px) (4 * ((((width_px) + 15) & ~15) + 32))

typedef struct {
  const uint8_t *src; // [height_px][src_stride_bytes]
  size_t src_stride_bytes;
  int n_channels;          // 3 or 4
  int width_px, height_px; // of the source
  int k;                   // 1..SV_UNPACK_CAP_K; the result is floor(width/k) x floor(height/k)
  float bg[3];             // used with alpha only
  float *dst[3];           // [height/k][dst_stride]; columns [width/k, dst_stride) become 0
  int dst_stride;          // a multiple of 32
  int row0, row1;          // rows of the result
  float *scratch;
} sv_unpack_args;

// Three planes of 16 bits -> float planes in [0, scale], reduced in the same way. Sums are
// integers: there is only the reference.
typedef struct {
  const uint16_t *src[3];  // [height_px][width_px]
  int width_px, height_px; // of the source
  int k;                   // as above
  float scale;
  float *dst[3]; // [height/k][dst_stride]; columns [width/k, dst_stride) become 0
  int dst_stride;
  int row0, row1; // rows of the result
} sv_unpack16_args;

typedef void sv_unpack16_fn(const sv_unpack16_args *a);
typedef void sv_unpack_fn(const sv_unpack_args *a);

#ifdef __cplusplus
}
#endif
#endif
