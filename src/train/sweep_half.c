// SPDX-License-Identifier: Apache-2.0
#include "src/train/sweep_half.h"

#include "src/base/mathx.h"

#define MIN_PLANES 32 // below, all planes are as fast
#define MIN_SIDE   32 // pixels of the half-size map
#define SPREAD     4  // pixels of the half-size map around those of a block
#define N_STRAY    8  // of these 256 pixels; so many may be wrong at either end
#define MARGIN     3  // planes around those found

size_t sv_sweep_half_px(const sv_depth_map *m) {
  return (size_t)(m->view.width_px / 2) * (size_t)(m->view.height_px / 2);
}

void sv_sweep_half(const sv_depth_map *m, sv_depth_map *out) {
  uint16_t *grey = out->grey, *code = out->code;
  *out = *m;
  out->grey = grey;
  out->code = code;
  out->k = 2 * m->k;
  out->view = sv_view_scaled(&m->view, 2);
  out->dw = 2 * m->dw;
  out->n_planes = m->n_planes / 2 + 1;
  const int w = out->view.width_px, h = out->view.height_px;
  // Where many sources agree, little is wrong, and what so few pixels show is missed.
  const bool is_sure = m->n_sources == SV_SWEEP_CAP_SOURCES;
  if (is_sure || m->n_planes < MIN_PLANES || w < MIN_SIDE || h < MIN_SIDE) out->n_planes = 0;
  for (int y = 0; y < h; y++)
    for (int x = 0; x < w; x++) {
      const uint16_t *p = m->grey + (size_t)(2 * y) * (size_t)m->view.width_px + 2 * x,
                     *q = p + m->view.width_px;
      grey[(size_t)y * (size_t)w + (size_t)x] = (uint16_t)(((uint32_t)p[0] + p[1] + q[0] + q[1]) / 4);
    }
}

void sv_sweep_half_planes(const sv_depth_map *half, int n_planes, int x, int y, int *first, int *last) {
  *first = 0;
  *last = n_planes - 1;
  if (half->n_planes == 0) return;
  const int x0 = sv_maxi(x / 2 - SPREAD, 0), x1 = sv_mini(x / 2 + 8 + SPREAD, half->view.width_px);
  const int y0 = sv_maxi(y / 2 - SPREAD, 0),
            y1 = sv_mini((y + SV_SWEEP_BAND) / 2 + SPREAD, half->view.height_px);
  int n[SV_SWEEP_CAP_PLANES] = {0}, least = 0, most = SV_SWEEP_CAP_PLANES - 1, n_all = 0;
  for (int r = y0; r < y1; r++)
    for (int c = x0; c < x1; c++) {
      const int code = half->code[r * half->view.width_px + c];
      if (!code) continue;
      n[(code - 1) / 256]++;
      n_all++;
    }
  if (n_all <= 2 * N_STRAY) return;
  for (int k = n[least]; k <= N_STRAY; k += n[least]) least++;
  for (int k = n[most]; k <= N_STRAY; k += n[most]) most--;
  *first = sv_maxi(2 * least - MARGIN, 0);
  *last = sv_mini(2 * most + 1 + MARGIN, n_planes - 1);
}
