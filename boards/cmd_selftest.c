// SPDX-License-Identifier: Apache-2.0
// subview selftest: the kernels against their reference, on the CPU that will run them.
#include "boards/board_main.h"
#include "src/run/selftest.h"

static sv_selftest test;

typedef struct {
  options_common common;
} selftest_options;

static const sv_option rows[] = {OPTIONS_COMMON(selftest_options)};

static const sv_tool_command command = {
    .name = "selftest",
    .args = "[options]",
    .text = "Runs every kernel and its reference on synthetic data; exit 1 on any difference.",
    .example = "  "
               "subview selftest",
    .bit = 1};

int cmd_selftest(int argc, char **argv) {
  sv_err err;
  selftest_options o = {0};
  int r = options_parse(&command, rows, sizeof rows / sizeof *rows, argc, argv, &o);
  if (r) return r < 0 ? 0 : r;
  sv_arena arena;
  if (board_arena(&arena, &err) < 0) return fail_with(&err);
  if (sv_selftest_run(&test, &arena, &err) < 0) return fail_with(&err);
  for (int i = 0; i < test.n_lines; i++) {
    const sv_selftest_line *l = &test.line[i];
    say(1, "%-7s %-9s %s", sv_isa_name(l->isa), l->what, l->is_ok ? "ok" : "DIFFERS");
    if (l->digest == l->expected) say(1, "  same bits as the reference\n");
    else
      say(1, "  digest %08x, reference %08x, loss %.6f against %.6f\n", (unsigned)l->digest,
          (unsigned)l->expected, l->loss, l->expected_loss);
  }
  if (!test.n_lines) say(1, "this build has only the reference kernels: nothing to compare\n");
  return test.n_failed ? 1 : 0;
}
