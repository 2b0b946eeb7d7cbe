// SPDX-License-Identifier: Apache-2.0
// A chessboard to print.
#include <stdlib.h>
#include <string.h>

#include "src/format/board_print.h"
#include "tools/calibrate/calibrate.h"

static bool ends_in(const char *path, const char *ending) {
  const size_t n = strlen(path), m = strlen(ending);
  return n > m && !strcmp(path + n - m, ending);
}

static sv_status write_board(const char *path, const sv_board_print *b, sv_err *err) {
  char *text = malloc(SV_BOARD_PRINT_CAP_TEXT);
  if (!text) return sv_fail(err, SV_E_NOMEM, "%s: no memory for the board", path);
  sv_str out = sv_str_make(text, SV_BOARD_PRINT_CAP_TEXT);
  if (ends_in(path, ".pdf")) sv_board_print_pdf(b, &out);
  else sv_board_print_svg(b, &out);
  sv_status s = sv_file_write(path, text, out.len, err);
  free(text);
  return s;
}

int cal_cmd_print(const cal_options *o) {
  const char *paper = o->paper ? o->paper : "a4";
  char path[SV_CAP_PATH];
  sv_board_print b;
  lab_session se;
  sv_err err = {0};
  if (o->out && !ends_in(o->out, ".pdf") && !ends_in(o->out, ".svg"))
    return cal_usage("print", "--out '%.80s' ends in .pdf or .svg", o->out);
  if (sv_board_print_fit(&b, paper, (int[2]){o->n_cols, o->n_rows}, o->spacing_m > 0 ? 1e3 * o->spacing_m : 0,
                         &err) < 0)
    return cal_usage("print", "%s", err.text);
  if (o->out) sv_copy(path, sizeof path, o->out);
  else sv_fmt(path, sizeof path, "board-%dx%d-%s.pdf", b.n_cols, b.n_rows, paper);
  sv_status s = lab_session_start(&se, 1, o->is_quiet, &err);
  if (s == SV_OK) s = write_board(path, &b, &err);
  if (s == SV_OK)
    lab_say(&se,
            "written: %s, squares of %g mm. Print at 100 %% and check that the bar is 100 mm long; then\n"
            "calibrate with --board %dx%d --spacing %g",
            path, b.square_mm, b.n_cols, b.n_rows, b.square_mm / 1e3);
  if (s == SV_OK && o->is_json) {
    lab_report j = {0};
    lab_report_begin(&j);
    lab_report_text(&j, "file", path);
    lab_report_int(&j, "columns", b.n_cols);
    lab_report_int(&j, "rows", b.n_rows);
    lab_report_num(&j, "spacing_m", b.square_mm / 1e3);
    lab_report_num(&j, "paper_width_mm", b.paper_mm[0]);
    lab_report_num(&j, "paper_height_mm", b.paper_mm[1]);
    lab_report_end(&j);
    s = lab_report_print(&j, &err);
  }
  if (s != SV_OK) lab_failed(&se, &err);
  lab_session_stop(&se);
  return s == SV_OK ? CAL_EXIT_OK : CAL_EXIT_FAILED;
}
