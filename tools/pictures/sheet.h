// SPDX-License-Identifier: Apache-2.0
// A sheet of images and text, written as a PNG: the contact sheets of `tables` and `compare`.
#ifndef SV_TOOLS_PICTURES_SHEET_H
#define SV_TOOLS_PICTURES_SHEET_H

#include <stdbool.h>
#include <stdint.h>

#include "src/base/status.h"

#define LAB_SHEET_PAPER   255 // gray value of an empty sheet
#define LAB_SHEET_TEXT_PX 12  // height of a line of text at scale 1

typedef struct {
  int width_px, height_px;
  uint8_t *px; // [height][width][3]
} lab_sheet;

// An empty sheet. Free with lab_sheet_free. E_RANGE when it is larger than the decoders' limit
// (imageio.h).
sv_status lab_sheet_start(lab_sheet *sh, long width_px, long height_px, sv_err *err) SV_MUST_USE;
void lab_sheet_free(lab_sheet *sh);
// The folder of path is made when it is missing.
sv_status lab_sheet_write(const lab_sheet *sh, const char *path, sv_err *err) SV_MUST_USE;

// Pixels outside the sheet are skipped.
void lab_sheet_pixel(lab_sheet *sh, int x, int y, const uint8_t rgb[3]);
void lab_sheet_box(lab_sheet *sh, int x, int y, int width_px, int height_px, const uint8_t rgb[3]);

// False in a build without stb_easy_font.h: text is then left out, and has width 0.
bool lab_sheet_has_text(void);
// One line of ASCII; other bytes become '?'. x, y: top left corner. scale: pixels of a font unit,
// at least 1.
int lab_sheet_text_width(const char *text, int scale);
void lab_sheet_text(lab_sheet *sh, int x, int y, int scale, const char *text, const uint8_t rgb[3]);

#endif
