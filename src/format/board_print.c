// SPDX-License-Identifier: Apache-2.0
#include "src/format/board_print.h"

#include <string.h>

#define MARGIN_MM 10.0 // white around the board: printers and corner detection need it
#define FOOT_MM   16.0 // ruler and text below the board
#define RULER_MM  100.0
#define TEXT_MM   3.2
#define POINT_MM  (25.4 / 72)

static const struct {
  const char *name;
  double mm[2]; // short side first
} papers[] = {{"a4", {210, 297}},        {"a3", {297, 420}},         {"a2", {420, 594}},
              {"a1", {594, 841}},        {"a0", {841, 1189}},        {"letter", {215.9, 279.4}},
              {"legal", {215.9, 355.6}}, {"tabloid", {279.4, 431.8}}};

// The largest side of squares on a page of this size.
static double largest_mm(double width_mm, double height_mm, const int corners[2]) {
  const double across = (width_mm - 2 * MARGIN_MM) / (corners[0] + 1);
  const double down = (height_mm - 2 * MARGIN_MM - FOOT_MM) / (corners[1] + 1);
  return across < down ? across : down;
}

sv_status sv_board_print_fit(sv_board_print *b, const char *paper, const int corners[2], double square_mm,
                             sv_err *err) {
  const double *mm = NULL;
  *b = (sv_board_print){.n_cols = corners[0], .n_rows = corners[1]};
  for (size_t i = 0; i < sizeof papers / sizeof *papers; i++)
    if (!strcmp(paper, papers[i].name)) {
      mm = papers[i].mm;
      b->paper = papers[i].name;
    }
  if (!mm) return sv_fail(err, SV_E_ARG, "paper '%.20s' is none of %s", paper, SV_BOARD_PAPERS);
  for (int i = 0; i < 2; i++)
    if (corners[i] < 3 || corners[i] > SV_BOARD_PRINT_CAP_SIDE)
      return sv_fail(err, SV_E_ARG, "a board has 3 to %d inner corners along a side, not %d",
                     SV_BOARD_PRINT_CAP_SIDE, corners[i]);
  const double upright = largest_mm(mm[0], mm[1], corners);
  const double sideways = largest_mm(mm[1], mm[0], corners);
  const double largest = upright > sideways ? upright : sideways;
  b->paper_mm[0] = upright > sideways ? mm[0] : mm[1];
  b->paper_mm[1] = upright > sideways ? mm[1] : mm[0];
  b->square_mm = square_mm > 0 ? square_mm : (double)(int)largest;
  if (b->square_mm < 1 || b->square_mm > largest + 1e-9)
    return sv_fail(err, SV_E_RANGE,
                   "%dx%d corners on %s: squares of %g mm do not fit; expected 1 to %.1f mm, or larger paper",
                   corners[0], corners[1], paper, b->square_mm, largest);
  return SV_OK;
}

bool sv_board_print_parse(const char *text, int corners[2]) {
  size_t n = 0;
  while (text[n] && text[n] != 'x' && text[n] != 'X') n++;
  long long side[2];
  if (!text[n] || !sv_parse_int(text, n, &side[0]) ||
      !sv_parse_int(text + n + 1, strlen(text + n + 1), &side[1]))
    return false;
  for (int i = 0; i < 2; i++) {
    if (side[i] < 3 || side[i] > SV_BOARD_PRINT_CAP_SIDE) return false;
    corners[i] = (int)side[i];
  }
  return true;
}

// --- what both formats draw ----------------------------------------------------------------------

// In millimeters, y down from the page's upper edge.
typedef struct {
  sv_str *out;
  const sv_board_print *b;
  void (*rect)(sv_str *out, const double at[2], const double size[2]);
  void (*text)(sv_str *out, const double at[2], const char *line);
} drawing;

static void draw_squares(const drawing *d) {
  const sv_board_print *b = d->b;
  const double s = b->square_mm, size[2] = {s, s};
  const double left = (b->paper_mm[0] - (b->n_cols + 1) * s) / 2;
  const double top = (b->paper_mm[1] - FOOT_MM - (b->n_rows + 1) * s) / 2;
  for (int j = 0; j <= b->n_rows; j++)
    for (int i = j & 1; i <= b->n_cols; i += 2) d->rect(d->out, (double[2]){left + i * s, top + j * s}, size);
}

// A bar, and a tick at each 10 mm.
static void draw_ruler(const drawing *d) {
  const double left = MARGIN_MM, y = d->b->paper_mm[1] - MARGIN_MM - 2;
  d->rect(d->out, (double[2]){left, y}, (double[2]){RULER_MM, 0.5});
  for (int i = 0; i <= 10; i++) {
    const double length = i % 5 ? 2 : 3.5;
    // the outer edges of the first and last tick are 100 mm apart
    const double x = left + (i == 0 ? 0 : i == 10 ? RULER_MM - 0.3 : i * 10 - 0.15);
    d->rect(d->out, (double[2]){x, y - length}, (double[2]){0.3, length});
  }
}

static void draw_text(const drawing *d) {
  const sv_board_print *b = d->b;
  char line[160];
  const double left = MARGIN_MM, below = b->paper_mm[1] - MARGIN_MM + 2.5;
  sv_fmt(line, sizeof line, "Squares of %g mm: --board %dx%d --spacing %g", b->square_mm, b->n_cols,
         b->n_rows, b->square_mm / 1000);
  d->text(d->out, (double[2]){left, b->paper_mm[1] - MARGIN_MM - 7}, line);
  d->text(d->out, (double[2]){left, below},
          "This bar is 100 mm long when printed at 100 % (not fit to page).");
}

static void draw(const drawing *d) {
  draw_squares(d);
  draw_ruler(d);
  draw_text(d);
}

// --- SVG -----------------------------------------------------------------------------------------

static void svg_rect(sv_str *out, const double at[2], const double size[2]) {
  sv_str_add(out, "<rect x=\"%.3f\" y=\"%.3f\" width=\"%.3f\" height=\"%.3f\"/>\n", at[0], at[1], size[0],
             size[1]);
}

static void svg_text(sv_str *out, const double at[2], const char *line) {
  sv_str_add(out, "<text x=\"%.3f\" y=\"%.3f\" font-family=\"sans-serif\" font-size=\"%.1f\">%s</text>\n",
             at[0], at[1], TEXT_MM, line);
}

void sv_board_print_svg(const sv_board_print *b, sv_str *out) {
  const drawing d = {out, b, svg_rect, svg_text};
  sv_str_add(
      out,
      "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n"
      "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"%gmm\" height=\"%gmm\" viewBox=\"0 0 %g %g\">\n"
      "<title>Chessboard of %dx%d inner corners</title>\n"
      "<path fill=\"#fff\" d=\"M0 0H%gV%gH0z\"/>\n",
      b->paper_mm[0], b->paper_mm[1], b->paper_mm[0], b->paper_mm[1], b->n_cols, b->n_rows, b->paper_mm[0],
      b->paper_mm[1]);
  draw(&d);
  sv_str_add(out, "</svg>\n");
}

// --- PDF (ISO 32000-1: file structure 7.5, content streams 7.8) ----------------------------------

// The page is turned upside down and scaled once, so that both formats draw in the same units.
static void pdf_rect(sv_str *out, const double at[2], const double size[2]) {
  sv_str_add(out, "%.3f %.3f %.3f %.3f re\n", at[0], at[1], size[0], size[1]);
}

// Letters are turned back; the lines have no brackets or backslashes.
static void pdf_text(sv_str *out, const double at[2], const char *line) {
  sv_str_add(out, "f BT /F1 %.1f Tf 1 0 0 -1 %.3f %.3f Tm (%s) Tj ET\n", TEXT_MM, at[0], at[1], line);
}

void sv_board_print_pdf(const sv_board_print *b, sv_str *out) {
  enum { N = 6 }; // objects from 1; 6 is the length of 5
  size_t at[N + 1];
  const drawing d = {out, b, pdf_rect, pdf_text};
  const double width = b->paper_mm[0] / POINT_MM, height = b->paper_mm[1] / POINT_MM;
  sv_str_add(out, "%%PDF-1.4\n");
  at[1] = out->len;
  // Viewers that know the key propose to print without scaling
  sv_str_add(out, "1 0 obj\n<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>\n"
                  "endobj\n");
  at[2] = out->len;
  sv_str_add(out, "2 0 obj\n<< /Type /Pages /Kids [3 0 R] /Count 1 >>\nendobj\n");
  at[3] = out->len;
  sv_str_add(out,
             "3 0 obj\n<< /Type /Page /Parent 2 0 R /MediaBox [0 0 %.3f %.3f] /Contents 5 0 R\n"
             "/Resources << /Font << /F1 4 0 R >> >> >>\nendobj\n",
             width, height);
  at[4] = out->len;
  sv_str_add(out, "4 0 obj\n<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica >>\nendobj\n");
  at[5] = out->len;
  sv_str_add(out, "5 0 obj\n<< /Length 6 0 R >>\nstream\n");
  const size_t begin = out->len;
  sv_str_add(out, "%.6f 0 0 -%.6f 0 %.3f cm\n0 g\n", 1 / POINT_MM, 1 / POINT_MM, height);
  draw(&d);
  const size_t n = out->len - begin;
  sv_str_add(out, "endstream\nendobj\n");
  at[6] = out->len;
  sv_str_add(out, "6 0 obj\n%zu\nendobj\n", n);
  const size_t xref = out->len;
  sv_str_add(out, "xref\n0 %d\n0000000000 65535 f \n", N + 1);
  for (int i = 1; i <= N; i++) sv_str_add(out, "%010zu 00000 n \n", at[i]);
  sv_str_add(out, "trailer\n<< /Size %d /Root 1 0 R >>\nstartxref\n%zu\n%%%%EOF\n", N + 1, xref);
}
