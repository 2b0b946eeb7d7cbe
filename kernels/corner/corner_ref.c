// SPDX-License-Identifier: Apache-2.0
#include <math.h>
#include <stddef.h>

#include "kernels/corner/corner.h"
#include "kernels/ops.h"

// Sum of gx gx (k = 0), gx gy (1) or gy gy (2) over the column of five pixels about (x, y).
static float column(const sv_corner_args *a, int x, int y, int k) {
  float p[5];
  for (int i = 0; i < 5; i++) {
    const float *s = a->src + (size_t)(y - 2 + i) * (size_t)a->stride + x;
    float gx = s[1] - s[-1], gy = s[a->stride] - s[-a->stride];
    p[i] = k == 0 ? gx * gx : k == 1 ? gx * gy : gy * gy;
  }
  return ((p[0] + p[1]) + (p[3] + p[4])) + p[2];
}

static float moment(const sv_corner_args *a, int x, int y, int k) {
  float v[5];
  for (int i = 0; i < 5; i++) v[i] = column(a, x - 2 + i, y, k);
  return ((v[0] + v[1]) + (v[3] + v[4])) + v[2];
}

void sv_corner_ref(const sv_corner_args *a) {
  const int m = a->margin_px, n_x = (a->width_px + SV_CORNER_CELL - 1) / SV_CORNER_CELL;
  for (int cy = a->cell0; cy < a->cell1; cy++)
    for (int cx = 0; cx < n_x; cx++) {
      sv_corner best = {0.0f, -1, -1};
      for (int y = cy * SV_CORNER_CELL; y < (cy + 1) * SV_CORNER_CELL; y++)
        for (int x = cx * SV_CORNER_CELL; x < (cx + 1) * SV_CORNER_CELL; x++) {
          if (x < m || x >= a->width_px - m || y < m || y >= a->height_px - m) continue;
          float xx = moment(a, x, y, 0), xy = moment(a, x, y, 1), yy = moment(a, x, y, 2);
          float d = (xx - yy) * 0.5f, score = (xx + yy) * 0.5f - sqrtf(d * d + xy * xy);
          if (score > best.score) best = (sv_corner){score, (int16_t)x, (int16_t)y};
        }
      a->out[cy * n_x + cx] = best;
    }
}
