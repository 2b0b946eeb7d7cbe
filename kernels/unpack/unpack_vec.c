// SPDX-License-Identifier: Apache-2.0
// unpack over the vocabulary: rows are summed vertically into float rows (integers, so exact), then
// folded horizontally, pairs first.
#include <string.h>

#include "kernels/unpack/unpack.h"
#include "kernels/simd/v16.h"
#include "kernels/simd/px.h"

static inline v16m lanes_below(int n) { return v16m_from_bits(n >= 16 ? 0xffffu : (1u << n) - 1u); }

static inline void put(float *p, v16 v, int is_first) {
  v16_store(p, is_first ? v : v16_add(v16_load(p), v));
}

// Sixteen pixels and more of a row, of which n are left; never reads past the row.
static inline const uint8_t *sixteen(const uint8_t *src, int n, int n_channels, uint8_t tail[64]) {
  if (n >= 16) return src;
  memset(tail, 0, 64);
  memcpy(tail, src, (size_t)(n * n_channels));
  return tail;
}

// Adds one source row of n pixels to the sums t[0..3].
static void add_row(const uint8_t *src, int n, int n_channels, float *const t[4], int is_first) {
  uint8_t tail[64], px[64];
  for (int i = 0; i < n; i += 16, src += 16 * n_channels) {
    const uint8_t *p = sixteen(src, n - i, n_channels, tail);
    if (n_channels == 3) {
      px_split3(p, px);
      for (int c = 0; c < 3; c++) put(t[c] + i, v16_load_u8(px + 16 * c), is_first);
    } else {
      px_split4(p, px);
      v16 alpha = v16_load_u8(px + 48);
      for (int c = 0; c < 3; c++) put(t[c] + i, v16_mul(v16_load_u8(px + 16 * c), alpha), is_first);
      put(t[3] + i, v16_sub(v16_set1(255.0f), alpha), is_first);
    }
  }
}

// Sums each k neighbours of a row in place; n results.
static void fold_row(float *p, int k, int n) {
  while (k % 2 == 0) {
    k /= 2;
    for (int i = 0; i < n * k; i += 16) px_pair_sum(p + 2 * i, p + i);
  }
  if (k == 1) return;
  for (int i = 0; i < n; i++) {
    float s = p[i * k];
    for (int j = 1; j < k; j++) s += p[i * k + j];
    p[i] = s;
  }
}

static void finish_row(const sv_unpack_args *a, float *const t[4], int y, int w) {
  const v16 inv = v16_set1(1.0f / (float)(255 * a->k * a->k));
  const v16 inv_alpha = v16_set1(1.0f / (float)(255 * 255 * a->k * a->k));
  for (int c = 0; c < 3; c++) {
    float *dst = a->dst[c] + (size_t)y * (size_t)a->dst_stride;
    v16 bg = v16_mul(v16_set1(a->bg[c]), inv);
    int i = 0;
    for (; i < w; i += 16) {
      v16 s = v16_load(t[c] + i);
      s = a->n_channels == 4 ? v16_fma(v16_load(t[3] + i), bg, v16_mul(s, inv_alpha)) : v16_mul(s, inv);
      v16_store(dst + i, v16_keep(lanes_below(w - i), s));
    }
    for (; i < a->dst_stride; i += 16) v16_store(dst + i, v16_zero());
  }
}

// A row of an image that keeps its size: nothing is summed, so nothing goes through memory.
V16_INLINE void copy_row(const sv_unpack_args *a, int y, int n_channels) {
  const v16 inv = v16_set1(1.0f / 255.0f), inv_alpha = v16_set1(1.0f / (255.0f * 255.0f));
  const uint8_t *src = a->src + (size_t)y * a->src_stride_bytes;
  const int w = a->width_px, stride = a->dst_stride;
  float *dst[3];
  v16 bg[3];
  for (int c = 0; c < 3; c++) {
    dst[c] = a->dst[c] + (size_t)y * (size_t)stride;
    bg[c] = v16_mul(v16_set1(a->bg[c]), inv);
  }
  uint8_t tail[64], px[64];
  int i = 0;
  for (; i < w; i += 16, src += 16 * n_channels) {
    const v16m in = lanes_below(w - i);
    const uint8_t *p = sixteen(src, w - i, n_channels, tail);
    if (n_channels == 3) {
      px_split3(p, px);
      for (int c = 0; c < 3; c++) v16_store(dst[c] + i, v16_keep(in, v16_mul(v16_load_u8(px + 16 * c), inv)));
    } else {
      px_split4(p, px);
      const v16 alpha = v16_load_u8(px + 48), rest = v16_sub(v16_set1(255.0f), alpha);
      for (int c = 0; c < 3; c++) {
        const v16 s = v16_mul(v16_mul(v16_load_u8(px + 16 * c), alpha), inv_alpha);
        v16_store(dst[c] + i, v16_keep(in, v16_fma(rest, bg[c], s)));
      }
    }
  }
  for (; i < stride; i += 16)
    for (int c = 0; c < 3; c++) v16_store(dst[c] + i, v16_zero());
}

void V(sv_unpack)(const sv_unpack_args *a) {
  if (a->k == 1) {
    for (int y = a->row0; y < a->row1; y++)
      if (a->n_channels == 3) copy_row(a, y, 3);
      else copy_row(a, y, 4);
    return;
  }
  const int w = a->width_px / a->k;
  float *t[4];
  for (int c = 0; c < 4; c++)
    t[c] = a->scratch + (size_t)c * (size_t)(SV_UNPACK_SCRATCH_FLOATS(a->width_px) / 4);
  memset(a->scratch, 0, sizeof(float) * (size_t)SV_UNPACK_SCRATCH_FLOATS(a->width_px));
  for (int y = a->row0; y < a->row1; y++) {
    for (int j = 0; j < a->k; j++)
      add_row(a->src + (size_t)(y * a->k + j) * a->src_stride_bytes, w * a->k, a->n_channels, t, j == 0);
    for (int c = 0; c < a->n_channels; c++) fold_row(t[c], a->k, w);
    finish_row(a, t, y, w);
  }
}
