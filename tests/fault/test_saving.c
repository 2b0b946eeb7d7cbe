// SPDX-License-Identifier: Apache-2.0
// What saving promises beyond a single failed call, on the real programs: the second place, two
// programs and one folder, limits of files and memory, models that are not finite, two generations
// of the checkpoint, temporary files, output that nobody can take.
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "tests/common/test.h"

#define RUN                                                                                                  \
  "subview run --source sim:textured,rig=stereo,size=32x24 --exposures 1 --gaussians 24 --threads 1 "        \
  "--quiet "

static char bin[256], hurry[500], said[16 << 10];

// A shell line; @ is the folder of the programs, $ that of the test, ^ makes a program's pauses
// short. What it prints goes to `said`.
static int run(const char *line) {
  char text[2000];
  size_t n = 0;
  for (; *line && n + 300 < sizeof text; line++) {
    if (*line == '@') n += (size_t)snprintf(text + n, sizeof text - n, "%s/", bin);
    else if (*line == '^') n += (size_t)snprintf(text + n, sizeof text - n, "%s", hurry);
    else if (*line == '$') n += (size_t)snprintf(text + n, sizeof text - n, "%s", temp_folder);
    else text[n++] = *line;
  }
  text[n] = 0;
  return shell_read(said, sizeof said, text);
}

static void expect(int code, const char *words, const char *line) {
  const int is = run(line);
  if (is != code || (words && !strstr(said, words)))
    fail_msg("%s: exit %d, expected %d and \"%s\": %s", line, is, code, words ? words : "", said);
}

static bool is_there(const char *name) { return access(temp_path("%s", name), F_OK) == 0; }

static void digest_of(const char *folder, char out[20]) {
  char *text = temp_read(temp_path("%s", folder), "run.json"), *at = strstr(text, "\"digest\": \"");
  if (!at) fail_msg("%s: no digest", folder);
  snprintf(out, 20, "%.16s", at + 11);
  free(text);
}

// --- the second place ----------------------------------------------------------------------------

// A folder that nobody can write to, root neither: its file system is full, read-only for this
// test's purposes. /proc is one where files cannot be made; a limit of a file's size fails as well.
TEST(test_rescue) {
  expect(0, NULL, "@" RUN "--steps 3 --out $/whole 2>&1");
  // A folder in the place of the file: rename refuses for good.
  shell_ok("mkdir -p %s/x %s/x", temp_path("lost/model.ply"), temp_path("lost/checkpoint.bin"));
  expect(3, "the others are in", "^@" RUN "--steps 3 --out $/lost --rescue $/second 2>&1");
  assert_contains(said, "second");
  assert_true(is_there("second/model.ply") && is_there("second/checkpoint.bin") && is_there("lost/run.json"));
  expect(0, NULL, "cmp $/second/model.ply $/whole/model.ply");
  // What was saved last goes on from there.
  expect(0, "resumed at step 3",
         "@subview run --source sim:textured,rig=stereo,size=32x24 --exposures 1 "
         "--gaussians 24 --threads 1 --steps 5 --resume --out $/second 2>&1");
  // Without --rescue: a new folder in memory, of this user alone.
  expect(3, "/subview-rescue.", "^@" RUN "--steps 3 --out $/lost 2>&1");
  char place[300] = "", *at = strstr(said, "are in "), *end = at ? strchr(at, ';') : NULL;
  if (!end || end - at > 250) fail_msg("no place in: %s", said);
  snprintf(place, sizeof place, "%.*s", (int)(end - at - 7), at + 7);
  struct stat st;
  assert_int_equal(stat(place, &st), 0);
  assert_int_equal(st.st_mode & 0777, 0700);
  shell_ok("cmp %s/model.ply %s && rm -r %s", place, temp_path("whole/model.ply"), place);
}

TEST(test_rescue_of_lab) {
  shell_ok("mkdir -p %s/x", temp_path("lost_lab/model.ply"));
  expect(1, "the model is saved in ",
         "^@subview-lab train --data tests/data/kitchen --transforms transforms_train_stereo_theta10.json "
         "--exposures 1 --steps 1 --gaussians 64 --quiet --out $/lost_lab 2>&1");
  char *at = strstr(said, "is saved in "), *end = at ? strstr(at, " instead") : NULL;
  if (!end || end - at > 250) fail_msg("no place in: %s", said);
  shell_ok("cd '%.*s' && test -s model.ply && test -s train.json && rm -r \"$PWD\"", (int)(end - at - 12),
           at + 12);
}

TEST(test_saved_list) {
  shell_ok("mkdir -p %s/x", temp_path("no_preview/preview.jpg"));
  // Only files that are there are listed as saved.
  expect(3, NULL, "^@" RUN "--steps 3 --out $/no_preview --rescue $/second3 2>$/err");
  assert_contains(said, "second3/preview.jpg");
  assert_contains(said, "no_preview/model.ply");
  assert_not_contains(said, "no_preview/preview.jpg");
}

// --- two programs, one folder --------------------------------------------------------------------

static pid_t begin_long(const char *out, const char *steps) {
  const pid_t pid = fork();
  if (pid != 0) return pid;
  char program[300];
  snprintf(program, sizeof program, "%s/subview", bin);
  const int null = open("/dev/null", O_RDWR);
  dup2(null, 1);
  dup2(null, 2);
  execl(program, "subview", "run", "--source", "sim:textured,rig=stereo,size=32x24", "--exposures", "1",
        "--gaussians", "24", "--threads", "1", "--save-every", "0.01", "--steps", steps, "--out", out,
        (char *)NULL);
  _exit(98);
}

static bool wait_for(const char *name) {
  const struct timespec t = {0, 10000000};
  for (int i = 0; i < 3000 && !is_there(name); i++) nanosleep(&t, NULL);
  return is_there(name);
}

TEST(test_two_programs) {
  const pid_t first = begin_long(temp_path("shared"), "9000000");
  assert_true(wait_for("shared/checkpoint.1.bin"));
  for (int i = 0; i < 5; i++) {
    expect(1, "shared: another program is writing there", "@" RUN "--steps 3 --out $/shared 2>&1");
    expect(1, "another program", "@" RUN "--steps 3 --resume --out $/shared 2>&1");
    expect(1, "another program",
           "@subview capture --source sim:textured,rig=stereo,size=32x24 --exposures 1 "
           "--quiet --out $/shared 2>&1");
  }
  expect(1, "another program",
         "@subview-lab train --data tests/data/kitchen --transforms transforms_train_stereo_theta10.json "
         "--exposures 1 --steps 1 --gaussians 64 --quiet --out $/shared 2>&1");
  assert_false(is_there("shared/rig")); // the refused capture has touched nothing
  int status;
  kill(first, SIGTERM);
  assert_int_equal(waitpid(first, &status, 0), first);
  assert_true(WIFEXITED(status) && WEXITSTATUS(status) == 0);
  expect(0, NULL, "@" RUN "--steps 3 --overwrite --out $/shared 2>&1"); // free again
}

// --- limits --------------------------------------------------------------------------------------

TEST(test_limits) {
  expect(1, "limit of a file's size", "(ulimit -f 4; ^@" RUN "--steps 3 --out $/small) 2>&1");
  assert_int_equal(run("find $/small -name '*tmp*' | grep ."), 1);
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
  expect(1, "ulimit -v", "(ulimit -v 500000; @" RUN "--steps 3 --out $/narrow) 2>&1");
  expect(
      1, "ulimit -v",
      "(ulimit -v 500000; @subview capture --source sim:textured,rig=stereo --exposures 1 --out $/n) 2>&1");
  expect(0, NULL, "(ulimit -v 500000; @subview --help)");
#endif
}

TEST(test_full_output) {
  static const char *const lines[] = {"@" RUN "--steps 3 --json --out $/json 2>&1 >/dev/full",
                                      "@subview plan --json 2>&1 >/dev/full",
                                      "@subview --help 2>&1 >/dev/full",
                                      "@subview capture --source sim:textured,rig=stereo,size=32x24 "
                                      "--exposures 1 --json --quiet --out $/cap 2>&1 "
                                      ">/dev/full",
                                      "@subview-lab train --data tests/data/kitchen --transforms "
                                      "transforms_train_stereo_theta10.json --exposures "
                                      "1 --steps 1 --gaussians 64 --quiet --json --out $/lab 2>&1 >/dev/full",
                                      "@subview-lab --help 2>&1 >/dev/full",
                                      "@subview-calibrate board --help 2>&1 >/dev/full",
                                      "@subview-preview --help 2>&1 >/dev/full"};
  for (size_t i = 0; i < sizeof lines / sizeof *lines; i++) expect(1, "the disk is full", lines[i]);
  assert_true(is_there("json/model.ply")); // it is saved all the same
}

// --- models that are not finite ------------------------------------------------------------------

TEST(test_not_finite) {
  shell_ok(
      "cp -r tests/data/capture_tiny %s && sed -i 's/\"min_m\":.[^]]*./\"min_m\":[-1e300,-1e300,-1e300]/; "
      "s/\"max_m\":.[^]]*./\"max_m\":[1e300,1e300,1e300]/' %s",
      temp_path("huge"), temp_path("huge/capture.json"));
  const int code =
      run("@subview run --source replay:$/huge,speed=max --exposures 2 --gaussians 24 --steps 5 --quiet "
          "--out $/bad 2>&1");
  if (code != 1) fail_msg("exit %d: %s", code, said);
  assert_false(is_there("bad/model.ply") || is_there("bad/checkpoint.bin"));
}

// --- checkpoints ---------------------------------------------------------------------------------

// Damage of each kind: the run goes on from the one before and ends as if nothing had happened.
TEST(test_two_generations) {
  static const char *const damage[] = {
      "truncate -s 100 $/gen/checkpoint.bin", "rm $/gen/checkpoint.bin", ": > $/gen/checkpoint.bin",
      "printf 'x' | dd of=$/gen/checkpoint.bin bs=1 seek=3000 conv=notrunc 2>/dev/null"};
  char want[20], is[20];
#define STEPS "80000"
#define GEN   RUN "--save-every 0.02 --steps " STEPS " --resume --out $/"
  expect(0, NULL, "@" GEN "undisturbed 2>&1");
  digest_of("undisturbed", want);
  for (size_t i = 0; i < sizeof damage / sizeof *damage; i++) {
    shell_ok("rm -rf %s", temp_path("gen"));
    const pid_t killed = begin_long(temp_path("gen"), STEPS);
    assert_true(wait_for("gen/checkpoint.1.bin"));
    kill(killed, SIGKILL);
    assert_int_equal(waitpid(killed, NULL, 0), killed);
    expect(0, NULL, damage[i]);
    expect(0, "going on from the checkpoint before it", "@" GEN "gen 2>&1");
    digest_of("gen", is);
    assert_string_equal(is, want);
    assert_true(is_there("gen/checkpoint.bin") && is_there("gen/checkpoint.1.bin"));
  }
  // Both: a sentence, and nothing is written over.
  expect(0, NULL, "truncate -s 100 $/gen/checkpoint.bin; truncate -s 100 $/gen/checkpoint.1.bin");
  expect(1, "checkpoint.bin", "@" GEN "gen 2>&1");
  expect(0, "100", "stat -c %s $/gen/checkpoint.bin");
}

// --- temporary files -----------------------------------------------------------------------------

TEST(test_temporaries) {
  // Of a process that is no more, and one of a name that only looks like it.
  shell_ok("mkdir %s && cd %s && touch model.ply.3999999-0.subview-tmp model.ply.x-0.subview-tmp my.tmp",
           temp_path("left"), temp_path("left"));
  expect(0, NULL, "@" RUN "--steps 3 --out $/left 2>&1");
  assert_false(is_there("left/model.ply.3999999-0.subview-tmp"));
  assert_true(is_there("left/model.ply.x-0.subview-tmp") && is_there("left/my.tmp"));
  shell_ok("touch %s", temp_path("left/m.spz.3999999-1.subview-tmp"));
  expect(0, NULL, "@subview-lab export --model $/left/model.ply --format spz --out $/left/m.spz 2>&1");
  assert_false(is_there("left/m.spz.3999999-1.subview-tmp"));
}

FIXTURE(set_up) {
  const char *b = getenv("SV_BIN");
  snprintf(bin, sizeof bin, "%s", b ? b : "build/sim-x86/bin");
  char here[128] = "";
  if (bin[0] != '/' && !getcwd(here, sizeof here)) return -1;
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
  snprintf(hurry, sizeof hurry, "LD_PRELOAD=%s%s%s/../tests/save_faults.so ", here, here[0] ? "/" : "", bin);
#endif
  return temp_folder_setup(NULL);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_rescue),     cmocka_unit_test(test_rescue_of_lab),
      cmocka_unit_test(test_saved_list), cmocka_unit_test(test_two_programs),
      cmocka_unit_test(test_limits),     cmocka_unit_test(test_full_output),
      cmocka_unit_test(test_not_finite), cmocka_unit_test(test_two_generations),
      cmocka_unit_test(test_temporaries)};
  if (is_emulated()) {
    printf("the programs are started by their names here, which an emulator does not take\n");
    return 77;
  }
  return cmocka_run_group_tests(tests, set_up, temp_folder_teardown);
}
