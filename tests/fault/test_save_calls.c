// SPDX-License-Identifier: Apache-2.0
// Each system call of each save of the real programs fails: EIO, ENOSPC, EDQUOT, EROFS, short
// writes, SIGXFSZ. Once: the run goes on, says so in a sentence, and its model is that of an
// undisturbed run. For good: old files are whole and the model is in the second place.
// SV_LONG=1 takes every kind at every call; otherwise the kinds take turns.
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "tests/common/test.h"

#define CAP_CALLS 1000

// of Linux on x86 and ARM
static const char *const kinds[] = {"5", "28", "122", "30", "short", "xfsz"};
#define N_KINDS ((int)(sizeof kinds / sizeof *kinds))

static char bin[256], preload[500], said[16 << 10];
static long n_warned, n_ended;

typedef struct {
  const char *command; // with %s for the folder and the rest of the line
  const char *must;    // the file, below the folder, that the command is about
  bool is_run;         // survives faults; else a fault ends it with a sentence
  int n_start;         // calls before it has begun, which may end it
} job;

// What the job says (stderr) goes to `said`; its exit code.
static int run(const job *j, long at, const char *kind, bool lasts) {
  char line[1400], args[500];
  snprintf(args, sizeof args, j->command, temp_path("work"), temp_path("rescue"));
  snprintf(line, sizeof line,
           "SV_FAULT_DIR=%s SV_FAULT_AT=%ld SV_FAULT_KIND=%s %s SV_FAULT_COUNT=%s LD_PRELOAD=%s %s/%s 2>&1 "
           ">/dev/null",
           temp_path("work"), at, kind, lasts ? "SV_FAULT_LASTS=100000" : "", temp_path("count"), preload,
           bin, args);
  return shell_read(said, sizeof said, line);
}

static long n_calls(void) {
  char *text = temp_read(temp_folder, "count");
  const long n = strtol(text, NULL, 10);
  free(text);
  return n;
}

static bool is_there(const char *folder, const char *name) {
  return access(temp_path("%s/%s", folder, name), F_OK) == 0;
}

static bool is_same(const char *a, const char *b, const char *name) {
  char line[700], nothing[16];
  snprintf(line, sizeof line, "cmp -s %s %s", temp_path("%s/%s", a, name), temp_path("%s/%s", b, name));
  return shell_read(nothing, sizeof nothing, line) == 0;
}

// A capture's list that was saved before the first frame came.
static bool is_whole_list(const char *name) {
  if (!strstr(name, ".json") || !is_there("work", name)) return false;
  char *text = temp_read(temp_path("work"), name);
  const size_t n = strlen(text);
  const bool is_whole = n > 2 && strcmp(text + n - 2, "}\n") == 0;
  free(text);
  return is_whole;
}

static bool has_temporary(const char *folder) {
  char text[64], line[400];
  snprintf(line, sizeof line, "find %s -name '*.subview-tmp' | wc -l", temp_path("%s", folder));
  shell_read(text, sizeof text, line);
  return strtol(text, NULL, 10) != 0;
}

// Every line of stderr is a message of ours, none a crash. Its length does not count the folder
// that the test happens to lie in.
static void check_words(const char *what) {
  char copy[sizeof said], *save = NULL;
  size_t n = 0;
  for (const char *c = said; *c; n++)
    if (*temp_folder && !strncmp(c, temp_folder, strlen(temp_folder))) {
      copy[n] = '@';
      c += strlen(temp_folder);
    } else copy[n] = *c++;
  copy[n] = 0;
  for (char *l = strtok_r(copy, "\n", &save); l; l = strtok_r(NULL, "\n", &save))
    if (!is_one_sentence(l)) fail_msg("%s: \"%s\"", what, l);
}

static void begin(const char *old) {
  shell_ok("rm -rf %s %s && mkdir -p %s && cp -r %s/. %s", temp_path("work"), temp_path("rescue"),
           temp_path("work"), temp_path("%s", old), temp_path("work"));
}

static void check_once(const job *j, long at, const char *kind, int code) {
  char what[400];
  snprintf(what, sizeof what, "%.40s, call %ld, %s: exit %d, said: %.200s", j->command, at, kind, code, said);
  check_words(what);
  if (has_temporary("work")) fail_msg("%s: a temporary file is left", what);
  if (code != 0 && code != 1) fail_msg("%s", what);
  if (j->is_run && code == 1 && strstr(said, "trying again")) fail_msg("%s: it has not tried again", what);
  const bool is_new = is_same("work", "good", j->must), is_old = is_same("work", "old", j->must);
  if (code == 0 ? !is_new : !is_new && !is_old && !is_whole_list(j->must))
    fail_msg("%s: %s is torn", what, j->must);
  if (strcmp(kind, "short") == 0 && code) fail_msg("%s: a short write is no failure", what);
  if (code == 1 && !*said) fail_msg("%s: without a word", what);
  n_warned += code == 0 && *said != 0;
  n_ended += code == 1;
}

// Of the run alone: before its folder is open there is nothing to save.
static void check_for_good(const job *j, long at, const char *kind, int code) {
  char what[400];
  snprintf(what, sizeof what, "%.40s, from call %ld on, %s: exit %d, said: %.200s", j->command, at, kind,
           code, said);
  check_words(what);
  const bool is_new = is_same("work", "good", j->must), is_old = is_same("work", "old", j->must);
  if (!is_new && !is_old) fail_msg("%s: %s is torn", what, j->must);
  if (strcmp(kind, "short") == 0 || code == 0) {
    if (code || !is_new) fail_msg("%s", what);
    return;
  }
  if (code != 3) fail_msg("%s", what);
  if (!is_new && !is_same("rescue", "good", j->must)) fail_msg("%s: the model is lost", what);
}

static void fail_each(const job *j) {
  const bool is_long = getenv("SV_LONG") != NULL;
  long n_once = 0, n_lasting = 0;
  n_warned = n_ended = 0;
  shell_ok("rm -rf %s %s %s", temp_path("old"), temp_path("good"), temp_path("work"));
  shell_ok("mkdir %s %s", temp_path("work"), temp_path("old"));
  if (run(j, 0, "5", false) != 0) fail_msg("%s: %s", j->command, said);
  const long n = n_calls();
  shell_ok("mv %s %s && mkdir -p %s/c && echo of an earlier run > %s", temp_path("work"), temp_path("good"),
           temp_path("old"), temp_path("old/%s", j->must));
  assert_true(n > 3 && n < CAP_CALLS && is_there("good", j->must));
  for (long at = 1; at <= n; at++)
    for (int k = 0; k < N_KINDS; k++) {
      if (!is_long && k != at % N_KINDS) continue;
      begin("old");
      check_once(j, at, kinds[k], run(j, at, kinds[k], false));
      n_once++;
      if (!j->is_run || strncmp(j->command, "subview run", 11) != 0) continue;
      if (!is_long && at % 4) continue;
      begin("old");
      check_for_good(j, at, kinds[k], run(j, at, kinds[k], true));
      n_lasting++;
    }
  print_message(
      "%.20s: %ld calls; failed once: %ld, of which %ld ended it and %ld were told; for good: %ld\n",
      j->command, n, n_once, n_ended, n_warned, n_lasting);
  if (j->is_run && n_ended > j->n_start * (is_long ? N_KINDS : 1))
    fail_msg("%ld faults ended it, expected at most %d", n_ended, j->n_start);
}

TEST(test_run) {
  const job j = {
      "subview run --source sim:textured,rig=stereo,size=32x24 --exposures 1 --gaussians 24 --steps 3 "
      "--save-every 0.000001 --threads 1 --overwrite --quiet --out %s --rescue %s",
      "model.ply", true, 0};
  fail_each(&j);
  assert_true(n_warned > 50); // no silent failure
}

// Killed at each call: nothing is torn, and the next run goes on to the same model.
TEST(test_run_killed_at_each_call) {
  const job j = {
      "subview run --source sim:textured,rig=stereo,size=32x24 --exposures 1 --gaussians 24 --steps 3 "
      "--save-every 0.000001 --threads 1 --resume --quiet --out %s --rescue %s",
      "model.ply", true, 0};
  const long stride = getenv("SV_LONG") ? 1 : 3;
  long n_killed = 0;
  shell_ok("rm -rf %s %s %s", temp_path("old"), temp_path("good"), temp_path("work"));
  shell_ok("mkdir %s %s", temp_path("work"), temp_path("old"));
  if (run(&j, 0, "5", false) != 0) fail_msg("%s", said);
  const long n = n_calls();
  shell_ok("mv %s %s && echo of an earlier run > %s", temp_path("work"), temp_path("good"),
           temp_path("old/%s", j.must));
  for (long at = 1 + n % stride; at <= n; at += stride) {
    begin("old");
    const int code = run(&j, at, "kill", false);
    if (code != 128 + 9) fail_msg("call %ld: exit %d: %s", at, code, said);
    if (!is_same("work", "good", j.must) && !is_same("work", "old", j.must)) fail_msg("call %ld: torn", at);
    if (run(&j, 0, "5", false) != 0) fail_msg("after a kill at call %ld: %s", at, said);
    if (!is_same("work", "good", j.must)) fail_msg("after a kill at call %ld: another model", at);
    if (has_temporary("work")) fail_msg("after a kill at call %ld: a temporary file is left", at);
    n_killed++;
  }
  print_message("killed at %ld of %ld calls\n", n_killed, n);
}

TEST(test_capture) {
  const job j = {
      "subview capture --source sim:textured,rig=stereo,size=32x24 --exposures 2 --quiet --out %s/c",
      "c/capture.json", true, 5};
  fail_each(&j);
}

// Cameras that do not wait for the disk: it takes nothing for a while, and the capture goes on.
TEST(test_capture_leaves_out) {
  char line[1200];
  shell_ok("rm -rf %s && %s/subview capture --source sim:textured,rig=stereo,size=32x24,fps=10 --exposures "
           "60 --out %s "
           "--quiet > /dev/null",
           temp_path("work"), bin, temp_path("long"));
  snprintf(
      line, sizeof line,
      "SV_FAULT_DIR=%s SV_FAULT_AT=60 SV_FAULT_KIND=%d SV_FAULT_LASTS=6 LD_PRELOAD=%s %s/subview capture "
      "--source replay:%s,speed=4 --exposures 20 --out %s --json --quiet 2>&1",
      temp_path("work"), ENOSPC, preload, bin, temp_path("long"), temp_path("work/c"));
  const int code = shell_read(said, sizeof said, line);
  if (code || !strstr(said, "exposures are left out until it can") || !strstr(said, "\"exposures\": 20,") ||
      strstr(said, "\"not_saved\": 0,"))
    fail_msg("exit %d: %s", code, said);
  shell_ok("%s/subview run --source replay:%s,speed=max --exposures 20 --gaussians 24 --steps 2 --quiet "
           "--out %s > "
           "/dev/null",
           bin, temp_path("work/c"), temp_path("out"));
}

TEST(test_train) {
  const job j = {"subview-lab train --data tests/data/kitchen --transforms "
                 "transforms_train_stereo_theta10.json --exposures 1 --steps 2 --gaussians 100 --threads 1 "
                 "--quiet --out %s",
                 "model.ply", true, 0};
  fail_each(&j);
}

TEST(test_export) {
  static const char *const formats[] = {"spz", "glb", "splat", "ply"};
  for (int i = 0; i < 3; i++) {
    char command[200], name[20];
    snprintf(command, sizeof command, "subview-lab export --model %s --format %s --quiet --out %%s/m.%s",
             temp_path("model/model.ply"), formats[i], formats[i]);
    snprintf(name, sizeof name, "m.%s", formats[i]);
    const job j = {command, name, false};
    fail_each(&j);
  }
}

FIXTURE(set_up) {
  const char *b = getenv("SV_BIN");
  snprintf(bin, sizeof bin, "%s", b ? b : "build/sim-x86/bin");
  if (temp_folder_setup(NULL)) return -1;
  char here[128];
  if (!getcwd(here, sizeof here)) return -1;
  snprintf(preload, sizeof preload, "%s%s%s/../tests/save_faults.so", bin[0] == '/' ? "" : here,
           bin[0] == '/' ? "" : "/", bin);
  shell_ok("%s/subview-lab train --data tests/data/kitchen --transforms transforms_train_stereo_theta10.json "
           "--exposures 1 --steps 1 --gaussians 64 --threads 1 --quiet --out %s > /dev/null",
           bin, temp_path("model"));
  return 0;
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_run),     cmocka_unit_test(test_run_killed_at_each_call),
      cmocka_unit_test(test_capture), cmocka_unit_test(test_capture_leaves_out),
      cmocka_unit_test(test_train),   cmocka_unit_test(test_export)};
  // A sanitizer's own library has to come first; a preloaded one is not for it.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  printf("not with sanitizers: they do not let another library come first\n");
  return 77;
#endif
  if (is_emulated()) {
    printf("nothing can be preloaded into an emulated program\n");
    return 77;
  }
  return cmocka_run_group_tests(tests, set_up, temp_folder_teardown);
}
