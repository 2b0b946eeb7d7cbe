// SPDX-License-Identifier: Apache-2.0
// Display values <-> linear light, and planes -> bytes.
//
// srgb_to_linear, linear_to_srgb: the transfer curve of IEC 61966-2-1,
//   linear = v / 12.92 for v <= 0.04045, else ((v + 0.055) / 1.055)^2.4
//   srgb = 12.92 l for l <= 0.0031308, else 1.055 l^(1/2.4) - 0.055
// as 2^(y log2 x) with this library's own polynomials, so the bits are the same everywhere. Against
// double: |error| < 6e-7 on [0, 1], both ways. Nothing is clamped; below 0 the straight part goes
// on. Exact for AVX2, AVX-512 and NEON; SSE4.1 abs = 2e-6 max(1, |value|).
//
// noise_curve: linear light -> values with the same noise everywhere, of a sensor whose variance is
// read + shot x: the integral of 1 / sqrt(read + shot x), 0 at 0 and 1 at 1 (the generalized
// Anscombe transform: Murtagh, Starck, Bijaoui 1995), below 0 with its slope there:
//   y = x (sqrt(read + shot) + sqrt(read)) / (sqrt(read + shot max(x, 0)) + sqrt(read))
// read > 0, shot >= 0. Exact for all.
//
// pack: three planes -> interleaved RGB bytes, round to nearest even of 255 v, clamped to 0..255,
// NaN -> 0. Exact for all.
#ifndef SV_KERNELS_COLOR_H
#define SV_KERNELS_COLOR_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  const float *src; // [n]
  float *dst;       // [n], may be src
  float *slope;     // [n] d dst / d src, or NULL; not src nor dst
  int n;            // any
} sv_curve_args;

typedef struct {
  const float *src; // as of sv_curve_args
  float *dst, *slope;
  int n;
  float read, shot;
} sv_noise_curve_args;

typedef struct {
  const float *src[3]; // [height][stride]
  int width_px, stride;
  uint8_t *dst; // [height][dst_stride_bytes], 3 bytes a pixel; bytes behind 3 width are kept
  size_t dst_stride_bytes;
  int row0, row1;
} sv_pack_args;

typedef void sv_srgb_to_linear_fn(const sv_curve_args *a);
typedef void sv_linear_to_srgb_fn(const sv_curve_args *a);
typedef void sv_noise_curve_fn(const sv_noise_curve_args *a);
typedef void sv_pack_fn(const sv_pack_args *a);

#ifdef __cplusplus
}
#endif
#endif
