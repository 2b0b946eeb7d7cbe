// SPDX-License-Identifier: Apache-2.0
#include "src/train/sweep_gaps.h"

#include <string.h>

#define CAP_GAP 10        // pixels that are filled in between measured ones
#define EDGE    (4 * 256) // of neighbours: two surfaces

// A gap between two measured places: on one surface what lies between, at an edge the one behind.
static uint16_t between(uint16_t a, uint16_t b, int at, int gap) {
  int d = (int)b - (int)a;
  if (d > EDGE || d < -EDGE) return a < b ? a : b;
  return (uint16_t)((int)a + d * (at + 1) / (gap + 1));
}

// Fills the gaps of a line of `n` pixels, `step` apart, from the measured ones in `from`.
static void fill_line(const uint16_t *from, uint16_t *to, int n, int step) {
  int last = -1;
  for (int i = 0; i < n; i++) {
    if (!from[i * step]) continue;
    int gap = i - last - 1;
    for (int k = 0; last >= 0 && k < gap && gap <= CAP_GAP; k++) {
      uint16_t c = between(from[last * step], from[i * step], k, gap), *at = &to[(last + 1 + k) * step];
      *at = *at ? between(*at, c, 0, 1) : c;
    }
    last = i;
  }
}

void sv_sweep_fill_gaps(sv_depth_map *m) {
  const int w = m->view.width_px, h = m->view.height_px;
  memset(m->code, 0, (size_t)w * (size_t)h * sizeof *m->code);
  for (int y = 0; y < h; y++) fill_line(m->grey + y * w, m->code + y * w, w, 1);
  for (int x = 0; x < w; x++) fill_line(m->grey + x, m->code + x, h, w);
  for (int i = 0; i < w * h; i++)
    if (m->grey[i]) m->code[i] = m->grey[i];
}
