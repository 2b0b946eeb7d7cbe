// SPDX-License-Identifier: Apache-2.0
// A chessboard to print, as SVG or PDF: squares of a stated side, a ruler bar of 100 mm to check
// the printer's scale, and the options that subview-calibrate needs for it. Owns nothing: it writes
// text into the caller's buffer. Never reads or writes files.
#ifndef SV_FORMAT_BOARD_PRINT_H
#define SV_FORMAT_BOARD_PRINT_H

#include "src/base/status.h"
#include "src/base/str.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_BOARD_PRINT_CAP_SIDE 64          // inner corners along a side
#define SV_BOARD_PRINT_CAP_TEXT (320 << 10) // bytes that no board exceeds
#define SV_BOARD_PAPERS         "a4|a3|a2|a1|a0|letter|legal|tabloid"

typedef struct {
  const char *paper;  // one of SV_BOARD_PAPERS
  int n_cols, n_rows; // inner corners: one square more along each side
  double square_mm;   // side of a square
  double paper_mm[2]; // width and height, turned so that squares are largest
} sv_board_print;

// Lays a board out. square_mm 0: the largest whole millimeter that fits. E_ARG: unknown paper, or
// corners outside 3..SV_BOARD_PRINT_CAP_SIDE. E_RANGE: squares that do not fit; the sentence has
// the largest that do.
sv_status sv_board_print_fit(sv_board_print *b, const char *paper, const int corners[2], double square_mm,
                             sv_err *err) SV_MUST_USE;
// Parses "9x6". False: no such text, or sides outside 3..SV_BOARD_PRINT_CAP_SIDE.
bool sv_board_print_parse(const char *text, int corners[2]);
void sv_board_print_svg(const sv_board_print *b, sv_str *out);
void sv_board_print_pdf(const sv_board_print *b, sv_str *out); // PDF 1.4, one page, Helvetica

#ifdef __cplusplus
}
#endif
#endif
