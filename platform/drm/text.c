// SPDX-License-Identifier: Apache-2.0
#include "platform/drm/text.h"

#include <string.h>

#if defined(__has_include) && __has_include(<stb/stb_easy_font.h>)
#include <stb/stb_easy_font.h>

#define CAP_QUADS 32 // a character has at most 20

static void box(const sv_display_frame *f, const int from_px[2], const int to_px[2]) {
  const int x0 = from_px[0] < 0 ? 0 : from_px[0], x1 = to_px[0] > f->width_px ? f->width_px : to_px[0];
  const int y0 = from_px[1] < 0 ? 0 : from_px[1], y1 = to_px[1] > f->height_px ? f->height_px : to_px[1];
  for (int y = y0; y < y1 && x0 < x1; y++)
    memset(f->px + (size_t)y * f->stride_bytes + 4 * (size_t)x0, 0xff, 4 * (size_t)(x1 - x0));
}

void sv_drm_text(const sv_display_frame *f, const int at_px[2], int scale, const char *line) {
  float quads[CAP_QUADS][4][4]; // corners x, y, z, color
  int x = at_px[0];
  for (; *line && x < f->width_px; line++) {
    char one[2] = {*line >= ' ' && *line <= '~' ? *line : '?', 0};
    const int n = stb_easy_font_print(0, 0, one, NULL, quads, (int)sizeof quads);
    for (int i = 0; i < n; i++) { // the first and the third corner are opposite
      const float *a = quads[i][0], *b = quads[i][2];
      box(f, (const int[]){x + (int)a[0] * scale, at_px[1] + (int)a[1] * scale},
          (const int[]){x + (int)b[0] * scale, at_px[1] + (int)b[1] * scale});
    }
    x += stb_easy_font_width(one) * scale;
  }
}

#else

void sv_drm_text(const sv_display_frame *f, const int at_px[2], int scale, const char *line) {
  (void)f;
  (void)at_px;
  (void)scale;
  (void)line;
}

#endif
