// SPDX-License-Identifier: Apache-2.0
// rgb8 over the vocabulary: 32 pixels at a time, so that a vector of 16 chroma pairs meets 16 even
// and 16 odd lumas. All products are integers below 2^24: floats hold them exactly.
#include <string.h>

#include "kernels/rgb8/rgb8.h"
#include "kernels/simd/v16.h"
#include "kernels/simd/px.h"

typedef struct {
  v16 y0, ky, krv, kgu, kgv, kbu, one, c0;
} matrix;

static inline void yuv16(const matrix *m, const uint8_t *y, v16 u, v16 v, uint8_t *out) {
  const v16 scale = v16_set1(1.0f / 16384.0f);
  v16 l = v16_add(v16_mul(m->ky, v16_sub(v16_load_u8(y), m->y0)), m->one);
  v16 g = v16_add(v16_mul(m->kgu, u), v16_mul(m->kgv, v));
  v16_store_u8(out, v16_mul(v16_add(l, v16_mul(m->krv, v)), scale));
  v16_store_u8(out + 16, v16_mul(v16_add(l, g), scale));
  v16_store_u8(out + 32, v16_mul(v16_add(l, v16_mul(m->kbu, u)), scale));
}

// ye, yo: even and odd lumas; u, v: chroma of the pairs; 32 pixels of RGB to dst.
static inline void yuv32(const matrix *m, const uint8_t *ye, const uint8_t *yo, const uint8_t *u,
                         const uint8_t *v, uint8_t *dst) {
  uint8_t even[48], odd[48], low[48], high[48];
  v16 uf = v16_sub(v16_load_u8(u), m->c0), vf = v16_sub(v16_load_u8(v), m->c0);
  yuv16(m, ye, uf, vf, even);
  yuv16(m, yo, uf, vf, odd);
  for (int c = 0; c < 48; c += 16) px_zip2(even + c, odd + c, low + c, high + c);
  px_join3(low, dst);
  px_join3(high, dst + 48);
}

// 32 pixels; s holds 32 pixels' bytes, c 32 bytes of chroma.
static inline void block(sv_rgb8_layout layout, const matrix *m, const uint8_t *s, const uint8_t *c,
                         uint8_t *dst) {
  uint8_t p[64], q[32];
  switch (layout) {
  case SV_RGB8_GREY:
    for (int i = 0; i < 2; i++) {
      for (int k = 0; k < 3; k++) memcpy(p + 16 * k, s + 16 * i, 16);
      px_join3(p, dst + 48 * i);
    }
    break;
  case SV_RGB8_BGR:
  case SV_RGB8_RGBX:
  case SV_RGB8_BGRX:
    for (int i = 0; i < 2; i++) {
      if (layout == SV_RGB8_BGR) px_split3(s + 48 * i, p);
      else px_split4(s + 64 * i, p);
      if (layout != SV_RGB8_RGBX) {
        memcpy(q, p, 16);
        memcpy(p, p + 32, 16);
        memcpy(p + 32, q, 16);
      }
      px_join3(p, dst + 48 * i);
    }
    break;
  case SV_RGB8_YUYV:
    px_split4(s, p);
    yuv32(m, p, p + 32, p + 16, p + 48, dst);
    break;
  case SV_RGB8_UYVY:
    px_split4(s, p);
    yuv32(m, p + 16, p + 48, p, p + 32, dst);
    break;
  case SV_RGB8_NV12:
    px_split2(s, p);
    px_split2(c, q);
    yuv32(m, p, p + 16, q, q + 16, dst);
    break;
  default: break;
  }
}

void V(sv_rgb8)(const sv_rgb8_args *a) {
  static const uint8_t bytes_of[SV_N_RGB8] = {1, 3, 4, 4, 2, 2, 1};
  const sv_yuv_matrix *k = &a->yuv;
  const matrix m = {v16_set1((float)k->y0),  v16_set1((float)k->ky),  v16_set1((float)k->krv),
                    v16_set1((float)k->kgu), v16_set1((float)k->kgv), v16_set1((float)k->kbu),
                    v16_set1(1.0f),          v16_set1(128.0f)};
  const size_t n = bytes_of[a->layout];
  uint8_t tail[128], tail_c[32], out[96];
  for (int y = a->row0; y < a->row1; y++) {
    const uint8_t *s = a->src + (size_t)y * a->src_stride_bytes;
    const uint8_t *c = a->chroma ? a->chroma + (size_t)(y / 2) * a->chroma_stride_bytes : s;
    uint8_t *dst = a->dst + (size_t)y * a->dst_stride_bytes;
    int x = 0;
    for (; x + 32 <= a->width_px; x += 32)
      block(a->layout, &m, s + n * (size_t)x, c + x, dst + 3 * (size_t)x);
    size_t left = (size_t)(a->width_px - x);
    if (!left) continue;
    memset(tail, 0, sizeof tail); // never read past the row
    memset(tail_c, 0, sizeof tail_c);
    memcpy(tail, s + n * (size_t)x, n * left);
    if (a->layout == SV_RGB8_NV12) memcpy(tail_c, c + x, left);
    block(a->layout, &m, tail, tail_c, out);
    memcpy(dst + 3 * (size_t)x, out, 3 * left);
  }
}
