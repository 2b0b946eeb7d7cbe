// SPDX-License-Identifier: Apache-2.0
// area over the vocabulary: the sum over rows, and, where a whole number of columns becomes one,
// that over columns, four pixels at a time. Other sums over columns are the reference's.
#include <string.h>

#include "kernels/area/area.h"
#include "kernels/area/area_px.h"
#include "kernels/simd/v16.h"

// Sixteen bytes of every covered row, from column i of bytes on.
static inline v16 sum_rows(const sv_area_args *a, const area_span *s, int i, int n) {
  v16 sum = v16_zero();
  for (int k = s->first; k < s->end; k++) {
    const uint8_t *p = a->src + (size_t)k * a->src_stride_bytes + i;
    uint8_t tail[16] = {0};
    if (n < 16) memcpy(tail, p, (size_t)n); // never read past the row
    sum = v16_add(sum, v16_mul(v16_set1(area_weight(s, k)), v16_load_u8(n < 16 ? tail : p)));
  }
  return sum;
}

// Red, green and blue of four pixels in groups of four lanes; the fourth lane of each is not used.
static int whole_columns(const sv_area_args *a, uint8_t *dst) {
  const int n = a->src_width_px / a->dst_width_px;
  const area_span s = area_span_of(0, a->src_width_px, a->dst_width_px);
  const v16 w = v16_set1(area_weight(&s, 0));
  int x = 0;
  for (; x + 4 <= a->dst_width_px; x += 4) {
    const float *p = a->scratch + 3 * (size_t)x * (size_t)n;
    v16 sum = v16_zero();
    float px[16];
    for (int k = 0; k < 3 * n; k += 3)
      sum = v16_add(sum, v16_mul(w, v16_load_quads(p + k, p + 3 * n + k, p + 6 * n + k, p + 9 * n + k)));
    v16_store(px, sum);
    for (int i = 0; i < 12; i++) dst[3 * x + i] = area_byte(px[i / 3 * 4 + i % 3]);
  }
  return x;
}

void V(sv_area)(const sv_area_args *a) {
  const int n = 3 * a->src_width_px;
  for (int y = a->row0; y < a->row1; y++) {
    const area_span s = area_span_of(y, a->src_height_px, a->dst_height_px);
    int i = 0;
    for (; i + 16 <= n; i += 16) v16_store(a->scratch + i, sum_rows(a, &s, i, 16));
    if (i < n) v16_store(a->scratch + i, sum_rows(a, &s, i, n - i));
    uint8_t *dst = a->dst + (size_t)y * a->dst_stride_bytes;
    const int x = a->src_width_px % a->dst_width_px ? 0 : whole_columns(a, dst);
    area_columns(a, x, dst);
  }
}
