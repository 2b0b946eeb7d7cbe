// SPDX-License-Identifier: Apache-2.0
// Which exposures of a recording a run takes, and that no run replaces the model of an earlier one
// by accident: neither from the command line nor by New on the page.
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "tests/common/live_run.h"
#include "tests/common/test.h"

#define SMALL                                                                                                \
  "run --source sim:textured,rig=stereo,size=32x24 --exposures 1 --gaussians 24 --steps 2 --quiet "
#define REPLAY "run --source replay:forty --exposures 4 --gaussians 24 --steps 2 --quiet "

static char said[8192];

static int subview(const char *args) {
  char line[1200];
  const char *emulate = getenv("SV_EMULATE");
  snprintf(line, sizeof line, "P=$(realpath \"$SV_BIN/subview\") && cd '%s' && %s $P %s 2>&1", temp_folder,
           emulate ? emulate : "", args);
  return shell_read(said, sizeof said, line);
}

static void expect(int code, const char *sentence, const char *args) {
  const int got = subview(args);
  if (got != code || !strstr(said, sentence)) fail_msg("%s: exit %d: %s", args, got, said);
}

TEST(test_earlier_model) {
  expect(0, "", SMALL "--out earlier");
  shell_ok("cp '%s/earlier/model.ply' '%s/kept.ply'", temp_folder, temp_folder);
  expect(
      1,
      "earlier: holds the model of an earlier run; give another --out, --resume to go on with it, or --over",
      SMALL "--seed 2 --out earlier");
  shell_ok("cmp '%s/earlier/model.ply' '%s/kept.ply'", temp_folder, temp_folder);
  expect(0, "ready: ", SMALL "--check --out earlier");
  expect(0, "ready: ", SMALL "--check");
  expect(1, "not ready: ", "run --source sim:atlantis --check");
  expect(2, "--out is missing", "run --source sim:textured");
  expect(0, "", SMALL "--seed 2 --overwrite --out earlier");
  shell_ok("! cmp -s '%s/earlier/model.ply' '%s/kept.ply'", temp_folder, temp_folder);
  shell_ok("rm '%s/earlier/model.ply'", temp_folder); // a run that was killed left its checkpoint
  expect(1, "earlier: holds the model of an earlier run", SMALL "--out earlier");
}

static void expect_not_due(const char *folder, int n) {
  char text[40], name[80];
  snprintf(name, sizeof name, "%s/run.json", folder);
  char *report = temp_read(temp_folder, name);
  snprintf(text, sizeof text, n ? "\"dropped\": {\"not_due\": %d}" : "\"dropped\": {}", n);
  assert_contains(report, text);
  free(report);
}

TEST(test_every) {
  expect(0, "",
         "capture --source sim:textured,rig=stereo,size=32x24,fps=10 --exposures 40 --quiet --out forty");
  expect(0, "", REPLAY "--out spread");
  expect_not_due("spread", 34); // of 38 that came until there were four
  expect(0, "", REPLAY "--every 0.5 --out half");
  expect_not_due("half", 12); // of 16
  expect(0, "", REPLAY "--every 0 --out first");
  expect_not_due("first", 0);
  expect(0, "4 exposures in every; frames: 32 captured = 8 delivered + 24 dropped",
         "capture --source sim:textured,rig=stereo,size=32x24,fps=10 --exposures 4 --every 0.5 --quiet --out "
         "every");
  expect(2, "--every often: expected a number of seconds from 0 to 3600, or motion",
         SMALL "--every often --out x");
  expect(2, "--every motion: not with --live", SMALL "--every motion --live --out x");
}

// The simulator's rig turns about its scene: motion is seen.
TEST(test_every_motion) {
  expect(0, "",
         "run --source sim:textured,rig=stereo,size=96x72,path=smooth,fps=30,exposures=200 --exposures 6 "
         "--every motion --gaussians 50 --steps 2 --quiet --out motion");
  char *report = temp_read(temp_folder, "motion/run.json"), *at = strstr(report, "\"not_due\": ");
  assert_non_null(at);
  const int n = atoi(at + strlen("\"not_due\": "));
  if (n < 6 || n > 6 * 30) fail_msg("%d exposures came too soon", n);
  free(report);
}

static live_run r;
static uint8_t answer[65536];

static void wait_for(const char *state) {
  char text[64];
  snprintf(text, sizeof text, "\"state\":\"%s\"", state);
  for (int i = 0; i < 600; i++) {
    live_run_get(&r, "/state", NULL, answer, sizeof answer);
    if (live_run_code(answer) == 200 && strstr((const char *)answer, text)) return;
    poll(NULL, 0, 50);
  }
  fail_msg("the state is not %s: %.300s", state, (const char *)answer);
}

static void post(const char *path) {
  char header[80];
  snprintf(header, sizeof header, "X-Subview-Token: %s\r\n", r.token);
  live_run_request(&r, "POST", path, header, answer, sizeof answer);
}

TEST(test_new_keeps_the_old) {
  r.is_guarded = true;
  if (!live_run_start(&r, temp_folder,
                      "--source sim:textured,rig=stereo,size=64x48 --exposures 2 --gaussians 300 --threads 1 "
                      "--steps 5 --session"))
    fail_msg("the run does not start: %s", r.err);
  for (int i = 0; i < 3; i++) {
    wait_for("waiting");
    post("/start");
    wait_for("done");
    if (i < 2) post("/new");
  }
  assert_int_equal(live_run_stop(&r), 0);
  static const char *const folders[] = {"out", "out-2", "out-3"};
  for (int i = 0; i < 3; i++) shell_ok("test -s '%s/%s/model.ply'", temp_folder, folders[i]);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_earlier_model), cmocka_unit_test(test_every),
                                     cmocka_unit_test(test_every_motion),
                                     cmocka_unit_test(test_new_keeps_the_old)};
  return cmocka_run_group_tests(tests, temp_folder_setup, temp_folder_teardown);
}
