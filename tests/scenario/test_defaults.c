// SPDX-License-Identifier: Apache-2.0
// What `subview run` and `subview-lab train` have in common has the same default in both, or the
// help of each names the other.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tests/common/lab_shell.h"
#include "tests/common/test.h"

static lab_shell shell = {.cwd = ""};

static int setup(void **state) {
  (void)state;
  const int r = lab_shell_open(&shell, "defaults");
  if (r < 0) return -1;
  shell.is_ready = r == 0;
  return 0;
}
static int teardown(void **state) {
  (void)state;
  return lab_shell_close(&shell);
}

// The help of one option, without the line breaks.
static void help_of(const char *help, const char *option, char *out, size_t cap) {
  char start[40];
  size_t n = 0;
  snprintf(start, sizeof start, "\n  --%s ", option);
  const char *at = strstr(help, start);
  if (!at) fail_msg("no --%s in: %s", option, help);
  for (at += 3; *at && strncmp(at, "\n  --", 5) != 0 && strncmp(at, "\n\n", 2) != 0 && n + 1 < cap; at++)
    if (*at != '\n' && !(*at == ' ' && n && out[n - 1] == ' ')) out[n++] = *at;
  out[n] = 0;
}

// The default's first word.
static void default_of(const char *help, char out[32]) {
  const char *at = strrchr(help, '[');
  if (!at) fail_msg("no default in: %s", help);
  const size_t n = strcspn(at + 1, ";,:]");
  snprintf(out, 32, "%.*s", (int)(n < 31 ? n : 31), at + 1);
}

TEST(test_defaults) {
  static const char *const same[] = {"gaussians", "sh", "seed", "optimizer", "scale"};
  static const char *const told[] = {"steps", "threads", "appearance"};
  lab_shell_need(&shell);
  lab_shell_run_well(&shell, "@ train --help >train.txt && $(dirname @)/subview run --help >run.txt");
  char *train = temp_read(shell.root, "train.txt"), *run = temp_read(shell.root, "run.txt");
  char of_train[1024], of_run[1024], a[32], b[32];
  for (size_t i = 0; i < sizeof same / sizeof *same; i++) {
    help_of(train, same[i], of_train, sizeof of_train);
    help_of(run, same[i], of_run, sizeof of_run);
    default_of(of_train, a);
    default_of(of_run, b);
    assert_string_equal(a, b);
  }
  for (size_t i = 0; i < sizeof told / sizeof *told; i++) {
    help_of(train, told[i], of_train, sizeof of_train);
    help_of(run, told[i], of_run, sizeof of_run);
    assert_contains(of_train, "subview run: ");
    assert_contains(of_run, "subview-lab train: ");
  }
  free(train);
  free(run);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_defaults)};
  return cmocka_run_group_tests(tests, setup, teardown);
}
