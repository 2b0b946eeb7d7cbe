// SPDX-License-Identifier: Apache-2.0
// Rows of camera pixels to RGB8. The Y'CbCr forms use integers, so that every variant gives the
// same bits:
//   R = clamp(round(t / 2^14)),  t = ky (Y - y0) + krv (Cr - 128) + 1      (G, B alike)
// with even coefficients: t is odd, so nothing ever lies half way. Exact for all variants, SSE4.1
// included. Matrices: ITU-R BT.601-7 (2.5.1, 2.5.2) and BT.709-6 (3.2, 3.3); limited range Y
// 16..235, C 16..240.
#ifndef SV_KERNELS_RGB8_H
#define SV_KERNELS_RGB8_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef enum {
  SV_RGB8_GREY, // 1 byte a pixel, repeated
  SV_RGB8_BGR,  // 3 bytes
  SV_RGB8_RGBX, // 4 bytes, the last is left out
  SV_RGB8_BGRX,
  SV_RGB8_YUYV, // 4:2:2 Y0 Cb Y1 Cr; width even
  SV_RGB8_UYVY, // 4:2:2 Cb Y0 Cr Y1; width even
  SV_RGB8_NV12, // 4:2:0 Y plane, Cb,Cr plane; width even
  SV_N_RGB8
} sv_rgb8_layout;

typedef struct {
  int32_t y0, ky, krv, kgu, kgv, kbu; // times 2^14, even
} sv_yuv_matrix;

typedef struct {
  sv_rgb8_layout layout;
  const uint8_t *src; // [rows][src_stride_bytes]
  size_t src_stride_bytes;
  const uint8_t *chroma; // NV12 only: row y uses [y / 2]
  size_t chroma_stride_bytes;
  sv_yuv_matrix yuv; // of the Y'CbCr forms
  int width_px;
  uint8_t *dst; // [rows][dst_stride_bytes] RGB8; must not overlap
  size_t dst_stride_bytes;
  int row0, row1;
} sv_rgb8_args;

typedef void sv_rgb8_fn(const sv_rgb8_args *a);

// is_709: BT.709, else BT.601; is_full: Y and C over 0..255 (JPEG), else limited range.
sv_yuv_matrix sv_rgb8_matrix(int is_709, int is_full);

#ifdef __cplusplus
}
#endif
#endif
