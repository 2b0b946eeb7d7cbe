// SPDX-License-Identifier: Apache-2.0
#include "kernels/demosaic/demosaic.h"
#include "kernels/ops.h"

static int mirror(int i, int n) { return i < 0 ? -i : i >= n ? 2 * (n - 1) - i : i; }

static int at(const sv_demosaic_args *a, int x, int y) {
  return a->src[(size_t)mirror(y, a->height_px) * a->src_stride_bytes + (size_t)mirror(x, a->width_px)];
}

static uint8_t sixteenth(int t) { // of an even clamp range: (2 t + 1) / 32 is never half way
  int q = 2 * t + 1 < 0 ? 0 : (2 * t + 1 + 16) >> 5;
  return (uint8_t)(q > 255 ? 255 : q);
}

void sv_demosaic_ref(const sv_demosaic_args *a) {
  for (int y = a->row0; y < a->row1; y++)
    for (int x = 0; x < a->width_px; x++) {
      uint8_t *p = a->dst + (size_t)y * a->dst_stride_bytes + 3 * (size_t)x;
      int c = at(a, x, y);
      int ew = at(a, x - 1, y) + at(a, x + 1, y), ns = at(a, x, y - 1) + at(a, x, y + 1);
      int ew2 = at(a, x - 2, y) + at(a, x + 2, y), ns2 = at(a, x, y - 2) + at(a, x, y + 2);
      int diag = at(a, x - 1, y - 1) + at(a, x + 1, y - 1) + at(a, x - 1, y + 1) + at(a, x + 1, y + 1);
      uint8_t green = sixteenth(8 * c + 4 * (ew + ns) - 2 * (ew2 + ns2));
      uint8_t row = sixteenth(10 * c + 8 * ew - 2 * diag - 2 * ew2 + ns2);
      uint8_t column = sixteenth(10 * c + 8 * ns - 2 * diag - 2 * ns2 + ew2);
      uint8_t cross = sixteenth(12 * c + 4 * diag - 3 * (ew2 + ns2));
      int is_red_row = (y & 1) == a->phase >> 1, is_red_column = (x & 1) == (a->phase & 1);
      if (is_red_row == is_red_column) { // red or blue itself
        p[is_red_row ? 0 : 2] = (uint8_t)c;
        p[1] = green;
        p[is_red_row ? 2 : 0] = cross;
      } else {
        p[1] = (uint8_t)c;
        p[is_red_row ? 0 : 2] = row;
        p[is_red_row ? 2 : 0] = column;
      }
    }
}
