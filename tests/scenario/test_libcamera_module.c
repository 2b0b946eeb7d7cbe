// SPDX-License-Identifier: Apache-2.0
// `subview` with, without and with an unfit libcamera module: one sentence, and the other cameras
// go on.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tests/common/test.h"

static char said[8192];

// A command with the program ($P) of an installation in the test's folder and its module ($M). The
// exit code; `said` is what it printed.
static int run(const char *command) {
  char line[2048];
  const char *emulate = getenv("SV_EMULATE");
  snprintf(line, sizeof line,
           "F='%s' E='%s'; P=\"$E $F/bin/subview\" M=$F/lib/subview/subview-libcamera.so; { %s; } 2>&1",
           temp_folder, emulate ? emulate : "", command);
  return shell_read(said, sizeof said, line);
}

// The cameras of this machine are listed whatever libcamera's module is like.
static void expect_cameras(void) {
  assert_int_equal(run("$P cameras"), 0);
  assert_contains(said, "sim:textured");
}

static bool has_module(void) {
  if (run("test -e $F/whole.so") == 0) return true;
  print_message("skip  this build has no libcamera\n");
  return false;
}

FIXTURE(install) {
  if (temp_folder_setup(state) != 0 || !getenv("SV_BIN")) return -1;
  return run("mkdir -p $F/bin $F/lib/subview && cp \"$SV_BIN/subview\" $F/bin/ &&"
             "if [ -e \"$SV_BIN/../lib/subview/subview-libcamera.so\" ]; then"
             "  cp \"$SV_BIN/../lib/subview/subview-libcamera.so\" $F/whole.so; fi");
}

TEST(test_missing) {
  run("rm -f $M");
  assert_int_equal(run("$P cameras --source-kind libcamera"), 1);
  assert_contains(said, "libcamera: subview-libcamera.so is neither beside this program");
  assert_int_equal(run("$P capture --source libcamera:0 --exposures 1 --out $F/out"), 1);
  assert_contains(said, "v4l2: works without it");
  expect_cameras();
}

TEST(test_no_library) {
  run("echo 'no library' >$M");
  assert_int_equal(run("$P cameras --source-kind libcamera"), 1);
  assert_contains(said, "libcamera: the module does not load (");
  expect_cameras();
}

// What the module says of itself is changed in its file: one digit of the revision.
TEST(test_of_another_build) {
  if (!has_module()) skip();
  assert_int_equal(run("sed 's/subview libcamera module [0-9]/subview libcamera module x/' $F/whole.so >$M"),
                   0);
  assert_int_equal(run("$P cameras --source-kind libcamera"), 1);
  assert_contains(said, "is of another build than this program");
  expect_cameras();
}

TEST(test_fits) {
  if (!has_module()) skip();
  run("cp $F/whole.so $M");
  run("$P cameras --source-kind libcamera"); // there may be none here
  assert_null(strstr(said, "module"));
  assert_int_equal(run("$P capture --source libcamera:no-such-camera --exposures 1 --out $F/out"), 1);
  assert_contains(said, "libcamera: no camera \"no-such-camera\"");
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_missing), cmocka_unit_test(test_no_library),
                                     cmocka_unit_test(test_of_another_build), cmocka_unit_test(test_fits)};
  return cmocka_run_group_tests(tests, install, temp_folder_teardown);
}
