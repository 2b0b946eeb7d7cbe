// SPDX-License-Identifier: Apache-2.0
// Planes of another size.
//
// resize: bilinear, pixel centres at i + 0.5. Destination pixel i looks at
//   s = clamp((i + 0.5) (src/dst) - 0.5, 0, src - 1)
//   value = (1 - f) src[floor s] + f src[floor s + 1]
// in both directions; no smoothing, so it is meant for enlarging and for factors down to about 1/2.
// half: the mean of 2 x 2 pixels, size floor(w/2) x floor(h/2); half_bwd: its gradient, a quarter
// of a pixel's to each of the four. The compiler does them at the speed of memory, so they have no
// variants. Exact for AVX2, AVX-512 and NEON; SSE4.1 resize abs = 1e-5 max(1, |value|).
#ifndef SV_KERNELS_RESIZE_H
#define SV_KERNELS_RESIZE_H

#ifdef __cplusplus
extern "C" {
#endif

// Floats of scratch of resize for a source of this stride; 64-byte aligned, one per thread,
// contents free.
#define SV_RESIZE_SCRATCH_FLOATS(src_stride) (src_stride)

typedef struct {
  const float *src; // [src_height][src_stride]; columns >= src_width are never used
  int src_width_px, src_height_px, src_stride;
  float *dst; // [dst_height][dst_stride]; columns [dst_width, dst_stride) become 0. Not src
  int dst_width_px, dst_height_px, dst_stride;
  int row0, row1; // rows of dst
  float *scratch; // half: not used
} sv_resize_args;

typedef void sv_resize_fn(const sv_resize_args *a);
// dst_width_px <= src_width_px / 2, dst_height_px likewise
typedef void sv_half_fn(const sv_resize_args *a);

typedef struct {
  const float *grad; // [height][stride] of the means; columns >= width are never used
  int width_px, stride;
  float *src_grad; // [2 height][src_stride]; columns [2 width, src_stride) become 0. Not grad
  int src_stride;
  int row0, row1; // rows of grad
} sv_half_bwd_args;
typedef void sv_half_bwd_fn(const sv_half_bwd_args *a);

#ifdef __cplusplus
}
#endif
#endif
