// SPDX-License-Identifier: Apache-2.0
#include "src/base/mathx.h"
#include "src/image/sample.h"
#include "src/preview/preview.h"

bool sv_preview_thumbnail(const sv_frame *f, int cap_w, int cap_h, uint8_t *rgb, int *w, int *h) {
  if (!sv_sample_can(f)) return false;
  int step = sv_maxi((f->width_px + cap_w - 1) / cap_w, (f->height_px + cap_h - 1) / cap_h);
  *w = f->width_px / step;
  *h = f->height_px / step;
  if (*w < 1 || *h < 1) return false;
  for (int y = 0; y < *h; y++)
    for (int x = 0; x < *w; x++)
      sv_sample(rgb + 3 * ((size_t)y * (size_t)*w + (size_t)x), f, x * step + step / 2, y * step + step / 2);
  return true;
}
