// SPDX-License-Identifier: Apache-2.0
// Moving scenes in the host tool, run as a user runs it: a dataset of the simulator, its tables, frames and films,
// the model as a PLY of differences.
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmocka.h>

static char g_root[256], g_lab[512], g_out[64 << 10];
static bool g_is_ready;

// A shell command in the test's folder; @ stands for the program. Its exit code; g_out is what it printed.
static int run(const char *line) {
  char command[4096];
  size_t at = (size_t)snprintf(command, sizeof command, "cd '%s' && { ", g_root);
  for (; *line && at + sizeof g_lab < sizeof command; line++) {
    if (*line == '@') at += (size_t)snprintf(command + at, sizeof command - at, "'%s'", g_lab);
    else command[at++] = *line;
  }
  snprintf(command + at, sizeof command - at, "; } 2>&1 </dev/null");
  FILE *p = popen(command, "r");
  assert_non_null(p);
  size_t n = fread(g_out, 1, sizeof g_out - 1, p);
  g_out[n] = 0;
  int code = pclose(p);
  return WIFEXITED(code) ? WEXITSTATUS(code) : 128 + WTERMSIG(code);
}

static void run_well(const char *line) {
  int code = run(line);
  if (code != 0) fail_msg("%s: exit %d: %s", line, code, g_out);
}

static void says(const char *line, const char *expected) {
  run_well(line);
  if (!strstr(g_out, expected)) fail_msg("%s: '%s' is not in: %s", line, expected, g_out);
}

static int setup(void **state) {
  const char *bin = getenv("SV_BIN"), *emulate = getenv("SV_EMULATE"), *tmp = getenv("TMPDIR");
  char here[256];
  (void)state;
  if (!bin || (emulate && *emulate) || !getcwd(here, sizeof here)) return 0;
  snprintf(g_lab, sizeof g_lab, "%s%s%s/subview-lab", *bin == '/' ? "" : here, *bin == '/' ? "" : "/", bin);
  if (access(g_lab, X_OK) != 0) return 0;
  snprintf(g_root, sizeof g_root, "%.200s/moving_XXXXXX", tmp ? tmp : "/tmp");
  if (!mkdtemp(g_root)) return -1;
  g_is_ready = run("@ import --from sim moving,size=48x36,fps=15 --out s --quiet && "
                   "@ train --data s --transforms transforms_train_stereo.json --model 4dgs --gaussians 150 "
                   "--steps 60 --eval --json --quiet --out m > m.json") == 0;
  if (!g_is_ready) fprintf(stderr, "%s", g_out);
  return g_is_ready ? 0 : -1;
}

static int teardown(void **state) {
  char command[300];
  (void)state;
  if (!*g_root) return 0;
  snprintf(command, sizeof command, "rm -rf '%s'", g_root);
  return system(command);
}

static void need_program(void) {
  if (g_is_ready) return;
  print_message("skip: subview-lab is not here (SV_BIN), or the machine is emulated\n");
  skip();
}

// One time in four of the training cameras is held out, and four cameras that no device has, over all times.
static void test_dataset(void **state) {
  (void)state;
  need_program();
  says("grep -c '\"split\": \"train\"' s/transforms_train_mono.json", "19");
  says("grep -c '\"split\": \"test_time\"' s/transforms_train_stereo.json", "12");
  says("grep -c '\"split\": \"train\"' s/transforms_train_phone.json", "57");
  says("grep -c '\"split\": \"test_view\"' s/transforms_test.json", "100");
  run_well("cmp s/frames/mono_right/f007.png s/frames/stereo_right/f007.png"); // the same camera
  run_well("cmp s/frames/mono_right/f007.png s/frames/phone_wide/f007.png");
  assert_int_equal(run("cmp s/frames/mono_right/f007.png s/frames/mono_right/f010.png"), 1); // it moves
  says("cat m.json", "\"time_psnr\"");
  says("@ import --from sim moving,noise=read:0.001 --out n || true", "are written without noise");
}

static void test_tables(void **state) {
  (void)state;
  need_program();
  run_well("@ tables --data s --steps 3 --gaussians 60 --out t --quiet");
  says("wc -l < t/dynamic.csv", "7"); // the head, three devices in two forms of motion
  says("grep -c 'stereo,clip\\|phone,field' t/dynamic.csv", "2");
  says("head -1 t/dynamic.csv", "times dB over mono");
}

static void test_frames(void **state) {
  (void)state;
  need_program();
  run_well(
      "@ render --data s --transforms transforms_train_stereo.json --model m/model.ply --frames 5 --out f");
  says("ls f/frame_*.png | wc -l", "5");
  run_well("@ export --model m/model.ply --format delta --frames 3 --out m/delta.ply --quiet");
  says("head -c 3 m/delta.ply", "ply");
}

static void test_film(void **state) {
  (void)state;
  need_program();
  if (run("command -v ffmpeg") != 0) {
    print_message("skip: ffmpeg is not installed\n");
    skip();
  }
  says("ffmpeg -v error -i f/movie.mp4 -f null - && ls f", "sheet.png");
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_dataset), cmocka_unit_test(test_tables),
                                     cmocka_unit_test(test_frames), cmocka_unit_test(test_film)};
  return cmocka_run_group_tests(tests, setup, teardown);
}
