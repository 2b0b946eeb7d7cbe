// SPDX-License-Identifier: Apache-2.0
// remap on AVX2: eight pixels at a time through gathers. Two 4-byte gathers, two bytes apart, cover
// the six bytes of a pixel pair (and of a table entry) without reading past them.
#include <immintrin.h>
#include <string.h>

#include "kernels/remap/remap.h"
#include "kernels/remap/remap_px.h"
#include "kernels/ops.h"

typedef struct {
  __m256i wx, gy, fy, offset, down, is_none;
} places;

static inline __m256i gather(const void *p, __m256i offset) {
  return _mm256_i32gather_epi32((const int *)p, offset, 1);
}

static inline places read_taps(const sv_remap_args *a, const sv_remap_tap *t) {
  const __m256i entry = _mm256_setr_epi32(0, 6, 12, 18, 24, 30, 36, 42), k256 = _mm256_set1_epi32(256);
  const uint8_t *bytes = (const uint8_t *)t;
  __m256i xy = gather(bytes, entry), yf = gather(bytes + 2, entry);
  __m256i x = _mm256_srai_epi32(_mm256_slli_epi32(xy, 16), 16), y = _mm256_srai_epi32(xy, 16);
  __m256i fx = _mm256_and_si256(_mm256_srli_epi32(yf, 16), _mm256_set1_epi32(255)),
          fy = _mm256_srli_epi32(yf, 24);
  places p;
  p.is_none = _mm256_cmpeq_epi32(x, _mm256_set1_epi32(SV_REMAP_NONE));
  x = _mm256_andnot_si256(p.is_none, x);
  y = _mm256_andnot_si256(p.is_none, y);
  // In the last column the pair starts one pixel earlier and only its right half counts.
  __m256i is_last = _mm256_cmpgt_epi32(x, _mm256_set1_epi32(a->src_width_px - 2));
  x = _mm256_add_epi32(x, is_last);
  fx = _mm256_blendv_epi8(fx, k256, is_last);
  p.wx = _mm256_or_si256(_mm256_sub_epi32(k256, fx), _mm256_slli_epi32(fx, 16));
  p.fy = fy;
  p.gy = _mm256_sub_epi32(k256, fy);
  p.offset = _mm256_add_epi32(_mm256_mullo_epi32(y, _mm256_set1_epi32((int)a->src_stride_bytes)),
                              _mm256_add_epi32(x, _mm256_add_epi32(x, x)));
  p.down = _mm256_and_si256(_mm256_cmpgt_epi32(_mm256_set1_epi32(a->src_height_px - 1), y),
                            _mm256_set1_epi32((int)a->src_stride_bytes));
  return p;
}

// The horizontal blend of one row of pairs: r, g, b times 256.
static inline void blend_row(const uint8_t *src, __m256i offset, __m256i wx, __m256i out[3]) {
  const __m256i outer = _mm256_set1_epi32((int)0x80038000), g_left = _mm256_set1_epi32((int)0x80808001),
                g_right = _mm256_set1_epi32((int)0x80028080),
                in_dword = _mm256_setr_epi32(0, 0x04040404, 0x08080808, 0x0c0c0c0c, 0, 0x04040404, 0x08080808,
                                             0x0c0c0c0c);
  __m256i a = gather(src, offset), b = gather(src + 2, offset); // R G B R'   B R' G' B'
  __m256i r = _mm256_shuffle_epi8(a, _mm256_add_epi8(outer, in_dword));
  __m256i g = _mm256_or_si256(_mm256_shuffle_epi8(a, _mm256_add_epi8(g_left, in_dword)),
                              _mm256_shuffle_epi8(b, _mm256_add_epi8(g_right, in_dword)));
  __m256i l = _mm256_shuffle_epi8(b, _mm256_add_epi8(outer, in_dword));
  out[0] = _mm256_madd_epi16(r, wx);
  out[1] = _mm256_madd_epi16(g, wx);
  out[2] = _mm256_madd_epi16(l, wx);
}

static inline __m256i blend_columns(__m256i top, __m256i low, const places *p) {
  __m256i s = _mm256_add_epi32(_mm256_mullo_epi32(top, p->gy), _mm256_mullo_epi32(low, p->fy));
  return _mm256_srli_epi32(_mm256_add_epi32(s, _mm256_set1_epi32(32768)), 16);
}

static inline void store_rgb(uint8_t *dst, __m128i v) { // 4 x RGB0 -> 12 bytes
  v = _mm_shuffle_epi8(v, _mm_setr_epi8(0, 1, 2, 4, 5, 6, 8, 9, 10, 12, 13, 14, -1, -1, -1, -1));
  int32_t rest = _mm_extract_epi32(v, 2);
  _mm_storel_epi64((__m128i *)dst, v);
  memcpy(dst + 8, &rest, 4);
}

static void eight_pixels(const sv_remap_args *a, const sv_remap_tap *t, uint8_t *dst) {
  const places p = read_taps(a, t);
  const __m256i fill = _mm256_set1_epi32(a->fill[0] | a->fill[1] << 8 | a->fill[2] << 16);
  __m256i top[3], low[3];
  blend_row(a->src, p.offset, p.wx, top);
  blend_row(a->src, _mm256_add_epi32(p.offset, p.down), p.wx, low);
  __m256i v = blend_columns(top[0], low[0], &p);
  v = _mm256_or_si256(v, _mm256_slli_epi32(blend_columns(top[1], low[1], &p), 8));
  v = _mm256_or_si256(v, _mm256_slli_epi32(blend_columns(top[2], low[2], &p), 16));
  v = _mm256_blendv_epi8(v, fill, p.is_none);
  store_rgb(dst, _mm256_castsi256_si128(v));
  store_rgb(dst + 12, _mm256_extracti128_si256(v, 1));
}

void sv_remap_avx2(const sv_remap_args *a) {
  // The gathers need a second column, and places that fit in 31 bits.
  const int is_wide = a->src_width_px >= 2 && (size_t)a->src_height_px * a->src_stride_bytes <= INT32_MAX;
  for (int y = a->row0; y < a->row1; y++) {
    const sv_remap_tap *t = a->table + (size_t)y * (size_t)a->dst_width_px;
    uint8_t *dst = a->dst + (size_t)y * a->dst_stride_bytes;
    int i = 0;
    for (; is_wide && i + 8 <= a->dst_width_px; i += 8) eight_pixels(a, t + i, dst + 3 * i);
    for (; i < a->dst_width_px; i++) remap_px(a, t + i, dst + 3 * i);
    remap_mask_row(a, y);
  }
}
