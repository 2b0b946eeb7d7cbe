// SPDX-License-Identifier: Apache-2.0
#include "tools/pictures/sheet.h"

#include <stdlib.h>
#include <string.h>

#include "tools/common/fileio.h"
#include "tools/common/imageio.h"

#if defined(__has_include) && __has_include(<stb/stb_easy_font.h>)
#include <stb/stb_easy_font.h>
#define HAS_FONT 1
#else
#define HAS_FONT 0
#endif

sv_status lab_sheet_start(lab_sheet *sh, long w, long h, sv_err *err) {
  *sh = (lab_sheet){0, 0, NULL};
  if (w < 1 || h < 1 || w > SV_BITMAP_CAP_SIDE_PX || h > SV_BITMAP_CAP_SIDE_PX ||
      3 * w > (long)SV_BITMAP_CAP_SAMPLES / h)
    return sv_fail(err, SV_E_RANGE, "a sheet of %ldx%ld pixels is too large for one image", w, h);
  size_t bytes = 3 * (size_t)w * (size_t)h;
  sh->px = malloc(bytes);
  if (!sh->px) return sv_fail(err, SV_E_NOMEM, "no memory for a sheet of %ldx%ld pixels", w, h);
  sh->width_px = (int)w;
  sh->height_px = (int)h;
  memset(sh->px, LAB_SHEET_PAPER, bytes);
  return SV_OK;
}

void lab_sheet_free(lab_sheet *sh) {
  free(sh->px);
  sh->px = NULL;
}

sv_status lab_sheet_write(const lab_sheet *sh, const char *path, sv_err *err) {
  char folder[SV_CAP_PATH];
  sv_path_folder(folder, sizeof folder, path);
  sv_status s = *folder ? sv_path_make_folder(folder, err) : SV_OK;
  sv_bitmap b = {sh->width_px, sh->height_px, 3, 8, sh->px, NULL};
  return s < 0 ? s : sv_bitmap_write_png(path, &b, err);
}

void lab_sheet_pixel(lab_sheet *sh, int x, int y, const uint8_t rgb[3]) {
  if (x >= 0 && y >= 0 && x < sh->width_px && y < sh->height_px)
    memcpy(sh->px + 3 * ((size_t)y * (size_t)sh->width_px + (size_t)x), rgb, 3);
}

void lab_sheet_box(lab_sheet *sh, int x, int y, int w, int h, const uint8_t rgb[3]) {
  for (int j = y; j < y + h; j++)
    for (int i = x; i < x + w; i++) lab_sheet_pixel(sh, i, j, rgb);
}

bool lab_sheet_has_text(void) { return HAS_FONT; }

#if HAS_FONT

#define CAP_QUADS 32 // a character has at most 20

// The font has the characters from ' ' to '~', as text of one character.
static void glyph(char out[2], char c) {
  out[0] = c >= ' ' && c <= '~' ? c : '?';
  out[1] = 0;
}

int lab_sheet_text_width(const char *text, int scale) {
  int width = 0;
  for (char one[2]; *text; text++) {
    glyph(one, *text);
    width += stb_easy_font_width(one);
  }
  return width * scale;
}

void lab_sheet_text(lab_sheet *sh, int x, int y, int scale, const char *text, const uint8_t rgb[3]) {
  float quads[CAP_QUADS][4][4]; // corners x, y, z, color
  for (char one[2]; *text; text++) {
    glyph(one, *text);
    int n = stb_easy_font_print(0, 0, one, NULL, quads, (int)sizeof quads);
    for (int i = 0; i < n; i++) {
      int x0 = (int)quads[i][0][0], y0 = (int)quads[i][0][1];
      int x1 = (int)quads[i][2][0], y1 = (int)quads[i][2][1];
      lab_sheet_box(sh, x + x0 * scale, y + y0 * scale, (x1 - x0) * scale + scale / 2, (y1 - y0) * scale,
                    rgb);
    }
    x += lab_sheet_text_width(one, scale);
  }
}

#else

int lab_sheet_text_width(const char *text, int scale) {
  (void)text;
  (void)scale;
  return 0;
}

void lab_sheet_text(lab_sheet *sh, int x, int y, int scale, const char *text, const uint8_t rgb[3]) {
  (void)sh;
  (void)x;
  (void)y;
  (void)scale;
  (void)text;
  (void)rgb;
}

#endif
