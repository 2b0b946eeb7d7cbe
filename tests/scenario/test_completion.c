// SPDX-License-Identifier: Apache-2.0
// Shell completion against the programs' own help: what a person gets who presses TAB.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tests/common/test.h"

static void must_complete(const char *line, const char *wanted) {
  char command[1200], got[4096] = "";
  const char *bin = getenv("SV_BIN");
  snprintf(command, sizeof command,
           "PATH='%s':\"$PATH\" bash -c '. tools/completion/subview.bash; COMP_WORDS=(%s \"\"); "
           "COMP_CWORD=$((${#COMP_WORDS[@]} - "
           "1)); w=${COMP_WORDS[COMP_CWORD]}; _subview \"${COMP_WORDS[0]}\" \"$w\" \"${COMP_WORDS[COMP_CWORD "
           "- 1]}\"; "
           "printf \" %%s\" \"${COMPREPLY[@]}\"'",
           bin ? bin : "build/sim-x86/bin", line);
  FILE *p = popen(command, "r");
  assert_non_null(p);
  size_t n = fread(got, 1, sizeof got - 2, p);
  got[n] = ' ';
  got[n + 1] = 0;
  assert_int_equal(pclose(p), 0);
  char mark[64];
  snprintf(mark, sizeof mark, " %s ", wanted);
  if (!strstr(got, mark)) fail_msg("%s <TAB>: no \"%s\" in:%s", line, wanted, got);
  assert_not_contains(got, " subview "); // nothing of the examples
}

TEST(test_completion) {
  if (system("command -v bash >/dev/null 2>&1") != 0 || is_emulated()) {
    print_message("skip shell completion: no bash here, or foreign programs\n");
    skip();
  }
  must_complete("subview", "run");
  must_complete("subview", "cameras");
  must_complete("subview-lab", "export");
  must_complete("subview-lab", "compare");
  must_complete("subview run --source", "replay:");
  must_complete("subview run --source", "sim:textured");
  must_complete("subview run --quality", "fine");
  must_complete("subview-lab export --format", "glb");
  must_complete("subview-lab export --up", "-z");
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_completion)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
