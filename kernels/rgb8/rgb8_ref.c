// SPDX-License-Identifier: Apache-2.0
#include "kernels/rgb8/rgb8.h"
#include "kernels/ops.h"

// 1.402, -0.344136, -0.714136, 1.772 (601) and 1.5748, -0.187324, -0.468124, 1.8556 (709), times
// 255/224 and 255/219 for limited range; times 2^14, to the nearest even number.
sv_yuv_matrix sv_rgb8_matrix(int is_709, int is_full) {
  static const sv_yuv_matrix m[2][2] = {
      {{16, 19078, 26150, -6418, -13320, 33050}, {0, 16384, 22970, -5638, -11700, 29032}},
      {{16, 19078, 29372, -3494, -8732, 34610}, {0, 16384, 25802, -3070, -7670, 30402}},
  };
  return m[is_709 != 0][is_full != 0];
}

static uint8_t clamp14(int32_t t) {
  int32_t q = t < 0 ? 0 : (t + 8192) >> 14;
  return (uint8_t)(q > 255 ? 255 : q);
}

static void put_yuv(uint8_t *dst, const sv_yuv_matrix *m, int y, int u, int v) {
  int32_t l = m->ky * (y - m->y0) + 1;
  u -= 128;
  v -= 128;
  dst[0] = clamp14(l + m->krv * v);
  dst[1] = clamp14(l + m->kgu * u + m->kgv * v);
  dst[2] = clamp14(l + m->kbu * u);
}

static void put(const sv_rgb8_args *a, const uint8_t *s, const uint8_t *c, int x, uint8_t *dst) {
  const uint8_t *pair = s + (size_t)(x / 2) * 4;
  int k = x & 1;
  switch (a->layout) {
  case SV_RGB8_GREY: dst[0] = dst[1] = dst[2] = s[x]; break;
  case SV_RGB8_BGR:
    dst[0] = s[3 * x + 2];
    dst[1] = s[3 * x + 1];
    dst[2] = s[3 * x];
    break;
  case SV_RGB8_RGBX:
    dst[0] = s[4 * x];
    dst[1] = s[4 * x + 1];
    dst[2] = s[4 * x + 2];
    break;
  case SV_RGB8_BGRX:
    dst[0] = s[4 * x + 2];
    dst[1] = s[4 * x + 1];
    dst[2] = s[4 * x];
    break;
  case SV_RGB8_YUYV: put_yuv(dst, &a->yuv, pair[2 * k], pair[1], pair[3]); break;
  case SV_RGB8_UYVY: put_yuv(dst, &a->yuv, pair[1 + 2 * k], pair[0], pair[2]); break;
  case SV_RGB8_NV12: put_yuv(dst, &a->yuv, s[x], c[x - k], c[x - k + 1]); break;
  default: break;
  }
}

void sv_rgb8_ref(const sv_rgb8_args *a) {
  for (int y = a->row0; y < a->row1; y++) {
    const uint8_t *s = a->src + (size_t)y * a->src_stride_bytes;
    const uint8_t *c = a->chroma ? a->chroma + (size_t)(y / 2) * a->chroma_stride_bytes : s;
    uint8_t *dst = a->dst + (size_t)y * a->dst_stride_bytes;
    for (int x = 0; x < a->width_px; x++) put(a, s, c, x, dst + 3 * (size_t)x);
  }
}
