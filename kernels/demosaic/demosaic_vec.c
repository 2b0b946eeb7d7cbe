// SPDX-License-Identifier: Apache-2.0
// demosaic over the vocabulary: five mirrored copies of rows in the scratch, then 16 pixels at a
// time; all four interpolations are formed and the pattern chooses.
#include <string.h>

#include "kernels/demosaic/demosaic.h"
#include "kernels/simd/v16.h"
#include "kernels/simd/px.h"

#define MARGIN 16 // bytes before a row's first pixel; two are used

static inline int mirrored(int i, int n) { return i < 0 ? -i : i >= n ? 2 * (n - 1) - i : i; }

static void copy_row(const sv_demosaic_args *a, int y, uint8_t *row) {
  int w = a->width_px;
  memcpy(row, a->src + (size_t)mirrored(y, a->height_px) * a->src_stride_bytes, (size_t)w);
  row[-1] = row[1];
  row[-2] = row[2];
  row[w] = row[w - 2];
  row[w + 1] = row[w - 3];
}

typedef struct {
  v16 c, green, row, column, cross;
} taps;

static inline taps taps_at(const uint8_t *const r[5], int x) {
  const v16 s = v16_set1(1.0f / 32.0f), one = v16_set1(1.0f);
#define AT(k, dx) v16_load_u8(r[k] + x + (dx))
#define OUT(t)    v16_mul(v16_add(v16_add(t, t), one), s)
  v16 c = AT(2, 0), ew = v16_add(AT(2, -1), AT(2, 1)), ns = v16_add(AT(1, 0), AT(3, 0));
  v16 ew2 = v16_add(AT(2, -2), AT(2, 2)), ns2 = v16_add(AT(0, 0), AT(4, 0));
  v16 diag = v16_add(v16_add(AT(1, -1), AT(1, 1)), v16_add(AT(3, -1), AT(3, 1)));
  v16 c2 = v16_add(c, c), c10 = v16_mul(c, v16_set1(10.0f)), all2 = v16_add(ew2, ns2);
  v16 d2 = v16_add(diag, diag);
  v16 green = v16_sub(v16_mul(v16_set1(4.0f), v16_add(c2, v16_add(ew, ns))), v16_add(all2, all2));
  v16 row = v16_add(v16_sub(v16_add(c10, v16_mul(v16_set1(8.0f), ew)), v16_add(d2, v16_add(ew2, ew2))), ns2);
  v16 column =
      v16_add(v16_sub(v16_add(c10, v16_mul(v16_set1(8.0f), ns)), v16_add(d2, v16_add(ns2, ns2))), ew2);
  v16 cross = v16_sub(v16_add(v16_add(c10, c2), v16_add(d2, d2)), v16_mul(v16_set1(3.0f), all2));
  return (taps){c, OUT(green), OUT(row), OUT(column), OUT(cross)};
#undef AT
#undef OUT
}

void V(sv_demosaic)(const sv_demosaic_args *a) {
  const size_t pitch = SV_DEMOSAIC_SCRATCH_BYTES(a->width_px) / 5;
  const v16m red_columns = v16m_from_bits((a->phase & 1) ? 0xaaaau : 0x5555u);
  uint8_t planes[48], tail[48], *row[5];
  for (int k = 0; k < 5; k++) row[k] = a->scratch + (size_t)k * pitch + MARGIN;
  memset(a->scratch, 0, 5 * pitch);
  for (int k = 1; k < 5; k++) copy_row(a, a->row0 - 3 + k, row[k]);
  for (int y = a->row0; y < a->row1; y++) {
    uint8_t *oldest = row[0], *dst = a->dst + (size_t)y * a->dst_stride_bytes;
    for (int k = 0; k < 4; k++) row[k] = row[k + 1];
    row[4] = oldest;
    copy_row(a, y + 2, row[4]);
    const uint8_t *const r[5] = {row[0], row[1], row[2], row[3], row[4]};
    const int is_red_row = (y & 1) == a->phase >> 1;
    // In a red row the own colour is red, in a blue one blue; it stands in the columns `own`.
    const v16m own = is_red_row ? red_columns : v16m_andnot(v16m_from_bits(0xffffu), red_columns);
    uint8_t *own_plane = planes + (is_red_row ? 0 : 32), *other_plane = planes + (is_red_row ? 32 : 0);
    for (int x = 0; x < a->width_px; x += 16) {
      taps t = taps_at(r, x);
      v16_store_u8(own_plane, v16_sel(own, t.c, t.row));
      v16_store_u8(planes + 16, v16_sel(own, t.green, t.c));
      v16_store_u8(other_plane, v16_sel(own, t.cross, t.column));
      int n = a->width_px - x;
      px_join3(planes, n >= 16 ? dst + 3 * (size_t)x : tail);
      if (n < 16) memcpy(dst + 3 * (size_t)x, tail, (size_t)(3 * n));
    }
  }
}
