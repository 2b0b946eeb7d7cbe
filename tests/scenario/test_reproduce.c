// SPDX-License-Identifier: Apache-2.0
// `make reproduce` on a list of its own: figures that agree, differ, fail and lack their dataset,
// and the table that is written. SV_BIN names the programs' folder.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "tests/common/lab_shell.h"
#include "tests/common/test.h"

static lab_shell shell = {.cwd = ""};

static const char list[] =
    "# a comment\n"
    "A | room | - | @run run --source sim:room,rig=stereo,size=48x36 --exposures 1 --gaussians 50 --steps 3 "
    "--json --quiet --out o | psnr | 20 | 15\n"
    "A | too high | - | @run run --source sim:room,rig=stereo,size=48x36 --exposures 1 --gaussians 50 "
    "--steps 3 "
    "--json --quiet --out o | psnr | 90 | 5\n"
    "B | memory | - | @run plan --images 4 --size 64x48 | ~^sum  *\\([0-9]*\\)$ | 15000000 | 9000000\n"
    "B | fails | - | @lab train --data nowhere --out o | psnr | 1 | 1\n"
    "B | person | person | @lab info --data {person} --json | views | 1 | 1\n";

FIXTURE(setup) {
  const int code = lab_shell_open(&shell, "reproduce");
  char here[500], path[800];
  if (code != 0) return code < 0 ? code : 0;
  if (!getcwd(here, sizeof here - 40)) return -1;
  strcat(here, "/tools/reproduce/reproduce.sh");
  setenv("SV_REPRODUCE", here, 1);
  unsetenv("SV_DATA");
  snprintf(path, sizeof path, "%s/list.txt", shell.root);
  FILE *f = fopen(path, "w");
  if (!f || fputs(list, f) < 0 || fclose(f) != 0) return -1;
  shell.is_ready = true;
  return 0;
}

FIXTURE(teardown) { return lab_shell_close(&shell); }

TEST(test_table) {
  lab_shell_need(&shell);
  assert_int_equal(lab_shell_run(&shell, "FIGURES=list.txt $SV_REPRODUCE $(dirname @) out"), 1);
  assert_contains(shell.said, "5 figures: 2 agree, 2 differ or failed, 1 skipped");
  char *text = temp_read(shell.root, "out/results.md");
  assert_contains(text, "Written by `make reproduce` on 20");
  assert_contains(text, "## A\n");
  assert_contains(text, "| 15 | agrees |");
  assert_contains(text, "| 5 | **differs** |");
  assert_contains(text, "| - | 1 | **failed**: error: nowhere");
  assert_contains(text, "skipped: no dataset person");
  assert_contains(text, "github.com/perfanalytics/pose2sim");
  free(text);
}

TEST(test_choice) {
  lab_shell_need(&shell);
  lab_shell_run_well(&shell, "FIGURES=list.txt $SV_REPRODUCE $(dirname @) out memory");
  assert_contains(shell.said, "1 figures: 1 agree");
  assert_int_equal(lab_shell_run(&shell, "FIGURES=list.txt $SV_REPRODUCE $(dirname @) out nothing"), 2);
  assert_contains(shell.said, "no figure matches 'nothing'");
}

// Each line of the real list has its seven fields and a dataset that is listed.
TEST(test_list) {
  lab_shell_need(&shell);
  lab_shell_run_well(&shell,
                     "cd $(dirname $SV_REPRODUCE) && awk -F ' [|] ' '/^#/ { next } NF != 7 { exit 1 } "
                     "$3 != \"-\" { print $3 }' figures.txt | sort -u | while read -r n; do grep -q "
                     "\"^$n | \" datasets.txt || exit 1; done");
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_table), cmocka_unit_test(test_choice),
                                     cmocka_unit_test(test_list)};
  return cmocka_run_group_tests(tests, setup, teardown);
}
