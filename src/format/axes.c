// SPDX-License-Identifier: Apache-2.0
#include "src/format/axes.h"

#include <stdint.h>

// Parity of the polynomial of SH coefficient k in x (bit 0), y (bit 1), z (bit 2), in the order of 3DGS:
// 1 | y z x | xy yz 3zz-1 xz xx-yy | y(3xx-yy) xyz y(5zz-1) z(5zz-3) x(5zz-1) z(xx-yy) x(xx-3yy)
static const uint8_t parity[16] = {0, 2, 4, 1, 3, 6, 0, 5, 0, 2, 7, 2, 4, 1, 4, 1};

void sv_gaussian_turn(sv_gaussian *g, sv_half_turn turn) {
  static const uint8_t flips_of[] = {0, 6, 3};
  const uint8_t flips = flips_of[turn];
  for (int a = 0; a < 3; a++) {
    if (!(flips >> a & 1)) continue;
    g->mean[a] = -g->mean[a];
    g->quat_wxyz[1 + a] = -g->quat_wxyz[1 + a];
  }
  for (int k = 1; k < 16; k++) {
    int odd = parity[k] & flips;
    if (!((odd ^ odd >> 1 ^ odd >> 2) & 1)) continue;
    for (int c = 0; c < 3; c++) g->sh[k][c] = -g->sh[k][c];
  }
}
