// SPDX-License-Identifier: Apache-2.0
// The man pages: made for every program, without a warning of groff, and with every option that
// --help has.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "tests/common/test.h"

static char root[256];

static const char *bin(void) {
  const char *b = getenv("SV_BIN");
  return b ? b : "build/sim-x86/bin";
}

// What a command prints; its exit code must be 0.
static char *output(const char *command) {
  static char text[256 << 10];
  FILE *p = popen(command, "r");
  assert_non_null(p);
  text[fread(text, 1, sizeof text - 1, p)] = 0;
  if (pclose(p) != 0) fail_msg("%s: %s", command, text);
  return text;
}

static void make_pages(void) {
  char command[900];
  const char *emulate = getenv("SV_EMULATE");
  snprintf(command, sizeof command, "EMULATE='%s' tools/man/man.sh '%s' '%s' 2>&1", emulate ? emulate : "",
           bin(), root);
  assert_string_equal(output(command), "");
}

// Options of "PROGRAM [COMMAND] --help" that the page has not.
static void must_have_options(const char *program, const char *command) {
  char line[1600];
  const char *emulate = getenv("SV_EMULATE");
  snprintf(line, sizeof line,
           "for o in $(%s %s/%s %s --help | sed -nE 's/^  (--[a-z-]+).*/\\1/p'); do "
           "sed 's/\\\\-/-/g' %s/%s.1 | grep -qF -e \"$o\" || echo \"$o\"; done",
           emulate ? emulate : "", bin(), program, command, root, program);
  assert_string_equal(output(line), "");
}

TEST(test_pages) {
  static const char *const what[][2] = {{"subview", "run"},
                                        {"subview", "capture"},
                                        {"subview", "plan"},
                                        {"subview-lab", "train"},
                                        {"subview-lab", "export"},
                                        {"subview-lab", "import"},
                                        {"subview-lab", "compare"},
                                        {"subview-preview", ""},
                                        {"subview-calibrate", "board"},
                                        {"subview-calibrate", "pose"},
                                        {"subview-depth", ""}};
  make_pages();
  for (size_t i = 0; i < sizeof what / sizeof *what; i++) must_have_options(what[i][0], what[i][1]);
}

TEST(test_groff) {
  static const char *const pages[] = {"subview", "subview-preview", "subview-lab", "subview-calibrate",
                                      "subview-depth"};
  char command[900], path[400];
  struct stat st;
  if (system("command -v groff >/dev/null 2>&1") != 0) {
    print_message("skip how man pages look: no groff here\n");
    skip();
  }
  make_pages();
  for (int i = 0; i < 5; i++) {
    snprintf(path, sizeof path, "%s/%s.1", root, pages[i]);
    assert_int_equal(stat(path, &st), 0);
    snprintf(command, sizeof command, "groff -ww -man -Tutf8 '%s' 2>&1 >'%s/out'", path, root);
    assert_string_equal(output(command), "");
    snprintf(command, sizeof command, "sed 's/.\\x08//g' '%s/out'", root);
    const char *text = output(command);
    assert_contains(text, "SYNOPSIS");
    assert_contains(text, "SEE ALSO");
    assert_not_contains(text, "\\&");
  }
}

FIXTURE(make_root) { return temp_folder_make(root, sizeof root, "man"); }
FIXTURE(remove_root) { return temp_folder_remove(root); }

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_pages), cmocka_unit_test(test_groff)};
  return cmocka_run_group_tests(tests, make_root, remove_root);
}
