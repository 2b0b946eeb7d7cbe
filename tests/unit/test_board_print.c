// SPDX-License-Identifier: Apache-2.0
// The chessboard to print: sizes of squares and ruler in the SVG, offsets and the same rectangles
// in the PDF, layouts that do not fit, and the command that writes them.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "src/format/board_print.h"
#include "tests/common/test.h"

static char text[SV_BOARD_PRINT_CAP_TEXT];
static sv_err err;

static sv_board_print fit(const char *paper, int w, int h, double square_mm) {
  sv_board_print b;
  assert_ok(sv_board_print_fit(&b, paper, (int[2]){w, h}, square_mm, &err), &err);
  return b;
}

typedef struct {
  double x, y, w, h;
} rect;

static int rects_of_svg(rect *r, int cap) {
  int n = 0;
  for (const char *at = text; (at = strstr(at, "<rect ")); at++, n++)
    if (n < cap)
      assert_int_equal(sscanf(at, "<rect x=\"%lf\" y=\"%lf\" width=\"%lf\" height=\"%lf\"", &r[n].x, &r[n].y,
                              &r[n].w, &r[n].h),
                       4);
  return n;
}

// 70 squares of 24 mm in white of at least 10 mm, then the bar of 100 mm and its 11 ticks.
TEST(test_svg) {
  static rect r[128];
  const sv_board_print b = fit("a4", 9, 6, 0);
  sv_str out = sv_str_make(text, sizeof text);
  sv_board_print_svg(&b, &out);
  assert_false(out.is_cut);
  assert_near(b.square_mm, 24, 0);
  assert_contains(text, "width=\"297mm\" height=\"210mm\" viewBox=\"0 0 297 210\"");
  assert_contains(text, "Squares of 24 mm: --board 9x6 --spacing 0.024<");
  assert_int_equal(rects_of_svg(r, 128), 35 + 1 + 11);
  for (int i = 0; i < 35; i++) {
    assert_near(r[i].w, 24, 0);
    assert_near(r[i].h, 24, 0);
    assert_true(r[i].x >= 10 && r[i].x + 24 <= 287 && r[i].y >= 9.9 && r[i].y + 24 <= 184);
    const double column = (r[i].x - r[0].x) / 24, row = (r[i].y - r[0].y) / 24;
    assert_near(column, (int)(column + 0.5), 1e-9);
    assert_int_equal(((int)(column + 0.5) + (int)(row + 0.5)) & 1, 0);
  }
  assert_near(r[35].w, 100, 0);
  assert_near(r[36].x, r[35].x, 0);
  assert_near(r[46].x + r[46].w, r[35].x + 100, 1e-9);
}

// Each object is where the table says, and the page draws what the SVG draws.
TEST(test_pdf) {
  const sv_board_print b = fit("letter", 7, 10, 15);
  sv_str out = sv_str_make(text, sizeof text);
  sv_board_print_pdf(&b, &out);
  assert_false(out.is_cut);
  assert_memory_equal(text, "%PDF-1.4\n", 9);
  assert_string_equal(text + out.len - 6, "%%EOF\n");
  const char *start = strstr(text, "startxref\n");
  assert_non_null(start);
  const char *table = text + atoi(start + 10);
  assert_memory_equal(table, "xref\n0 7\n", 9);
  for (int i = 1; i <= 6; i++) {
    char object[16];
    snprintf(object, sizeof object, "%d 0 obj\n", i);
    assert_memory_equal(text + atoi(table + 9 + 20 * i), object, strlen(object));
  }
  const char *begin = strstr(text, "stream\n") + 7, *end = strstr(text, "endstream");
  assert_int_equal(atoi(strstr(text, "6 0 obj\n") + 8), end - begin);
  assert_contains(text, "/MediaBox [0 0 612.000 792.000]");
  assert_contains(text, " 15.000 15.000 re\n");
  int n = 0;
  for (const char *at = text; (at = strstr(at, " re\n")); at++) n++;
  assert_int_equal(n, 44 + 1 + 11);
}

TEST(test_what_does_not_fit) {
  sv_board_print b;
  assert_error(sv_board_print_fit(&b, "a4", (int[2]){9, 6}, 30, &err), SV_E_RANGE, &err, "1 to 24.");
  assert_error(sv_board_print_fit(&b, "b5", (int[2]){9, 6}, 0, &err), SV_E_ARG, &err, "a4|a3");
  assert_error(sv_board_print_fit(&b, "a4", (int[2]){2, 6}, 0, &err), SV_E_ARG, &err, "3 to 64");
  // as large as boards become: the text still fits
  b = fit("a0", 64, 64, 0);
  for (int k = 0; k < 2; k++) {
    sv_str out = sv_str_make(text, sizeof text);
    (k ? sv_board_print_svg : sv_board_print_pdf)(&b, &out);
    assert_false(out.is_cut);
  }
  int corners[2];
  assert_true(sv_board_print_parse("9x6", corners) && corners[0] == 9 && corners[1] == 6);
  assert_false(sv_board_print_parse("9", corners));
  assert_false(sv_board_print_parse("9x65", corners));
}

static char root[256];

TEST(test_command) {
  char command[900], said[600];
  const char *bin = getenv("SV_BIN"), *emulate = getenv("SV_EMULATE");
  char program[300];
  snprintf(program, sizeof program, "%s%s%s/subview-calibrate print", emulate ? emulate : "",
           emulate ? " " : "", bin ? bin : "build/sim-x86/bin");
  snprintf(command, sizeof command, "%s --board 9x6 --spacing 0.02 --out %s/b.svg --quiet && cat %s/b.svg",
           program, root, root);
  FILE *p = popen(command, "r");
  assert_non_null(p);
  text[fread(text, 1, sizeof text - 1, p)] = 0;
  if (pclose(p) != 0) skip(); // built without calibration
  assert_contains(text, "Squares of 20 mm: --board 9x6 --spacing 0.02<");
  snprintf(command, sizeof command, "%s --board 9x6 --spacing 0.2 --out %s/c.svg 2>&1", program, root);
  p = popen(command, "r");
  assert_non_null(p);
  said[fread(said, 1, sizeof said - 1, p)] = 0;
  assert_int_equal(WEXITSTATUS(pclose(p)), 2);
  assert_contains(said, "squares of 200 mm do not fit");
}

FIXTURE(make_root) { return temp_folder_make(root, sizeof root, "print"); }
FIXTURE(remove_root) { return temp_folder_remove(root); }

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_svg),
      cmocka_unit_test(test_pdf),
      cmocka_unit_test(test_what_does_not_fit),
      cmocka_unit_test(test_command),
  };
  return cmocka_run_group_tests(tests, make_root, remove_root);
}
