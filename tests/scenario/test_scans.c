// SPDX-License-Identifier: Apache-2.0
// What the service builds on: options from a file, numbered scans of which N are kept, a token that
// stays, and a scan that was interrupted goes on by itself.
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "tests/common/live_run.h"
#include "tests/common/test.h"

static live_run r;
static uint8_t answer[65536];
static char said[8192];

static void setting(const char *more) {
  char text[600];
  snprintf(text, sizeof text,
           "# a comment\nsource = sim:textured,rig=stereo,size=64x48\nrig=\nexposures=2\ngaussians=300\n"
           "threads=1\nsave-every=0.05\nsession\nkeep=2\ntoken-file=%s\n%s\n",
           temp_path("token"), more);
  temp_put_text("subview.conf", text);
}

static void start(const char *args) {
  if (!live_run_start(&r, temp_folder, args)) fail_msg("the run does not start: %s", r.err);
}
static void post(const char *path) {
  char header[80];
  snprintf(header, sizeof header, "X-Subview-Token: %s\r\n", r.token);
  live_run_request(&r, "POST", path, header, answer, sizeof answer);
}
static bool state_is(const char *state) {
  char text[64];
  snprintf(text, sizeof text, "\"state\":\"%s\"", state);
  live_run_get(&r, "/state", NULL, answer, sizeof answer);
  return live_run_code(answer) == 200 && strstr((const char *)answer, text) != NULL;
}
static void wait_for(const char *state) {
  for (int i = 0; i < 600; i++) {
    if (state_is(state)) return;
    poll(NULL, 0, 50);
  }
  fail_msg("the state is not %s: %.300s", state, (const char *)answer);
}
static bool is_there(const char *name) {
  struct stat st;
  return stat(temp_path("out/%s", name), &st) == 0;
}

TEST(test_interrupted) {
  char token[40];
  struct stat st;
  setting("steps=10000000");
  start("--config @/subview.conf");
  snprintf(token, sizeof token, "%s", r.token);
  assert_int_equal(stat(temp_path("token"), &st), 0);
  assert_int_equal(st.st_mode & 0777, 0600); // a secret
  assert_int_equal(st.st_size, 33);
  shell_ok("! ls %s | grep subview-tmp", temp_folder);
  wait_for("waiting");
  post("/start");
  for (int i = 0; i < 600 && !is_there("0001/checkpoint.bin"); i++) poll(NULL, 0, 50);
  assert_true(is_there("0001/checkpoint.bin"));
  kill(r.pid, SIGKILL);
  waitpid(r.pid, NULL, 0);
  // It goes on in the same scan, without Start, and its link is the same.
  start("--config @/subview.conf");
  assert_string_equal(r.token, token);
  wait_for("training");
  assert_int_equal(live_run_stop(&r), 0);
  assert_contains(r.err, "going on with the interrupted scan");
  assert_contains(r.err, "resumed at step ");
  assert_true(is_there("0001/run.json") && !is_there("0002"));
}

TEST(test_kept) {
  setting("steps=5");
  start("--steps 7 --config @/subview.conf"); // the command line wins
  for (int i = 0; i < 3; i++) {
    wait_for("waiting");
    post("/start");
    wait_for("done");
    if (i < 2) post("/new");
  }
  assert_int_equal(live_run_stop(&r), 0);
  assert_true(!is_there("0001") && !is_there("0002") && is_there("0003/model.ply") &&
              is_there("0004/run.json"));
  assert_false(is_there("0005"));
  char *report = temp_read(temp_folder, "out/0004/run.json");
  assert_contains(report, "\"steps\": 7");
  free(report);
}

// As at a board's start: the cameras come after the service. It looks often, and tells once.
TEST(test_camera_comes_late) {
  char late[400];
  shell_ok("%s/subview capture --source sim:textured,rig=mono,size=64x48 --exposures 2 --out %s --quiet "
           "2>/dev/null",
           getenv("SV_BIN"), temp_path("early"));
  snprintf(late, sizeof late, "steps=5\nsource=replay:%s,speed=max", temp_path("late"));
  setting(late);
  start("--config @/subview.conf");
  wait_for("failed");
  poll(NULL, 0, 1500);
  shell_ok("mv %s %s", temp_path("early"), temp_path("late"));
  bool is_back = false;
  for (int i = 0; i < 40 && !is_back; i++, poll(NULL, 0, 50)) is_back = state_is("waiting"); // 2 s
  assert_true(is_back);
  post("/start");
  wait_for("done");
  assert_int_equal(live_run_stop(&r), 0);
  const char *first = strstr(r.err, "late");
  assert_non_null(first);
  assert_null(strstr(first + 4, "late")); // one sentence of it
}

static int run(const char *args) {
  char line[900];
  const char *emulate = getenv("SV_EMULATE");
  snprintf(line, sizeof line, "%s \"$SV_BIN/subview\" run %s --out '%s' 2>&1", emulate ? emulate : "", args,
           temp_path("other"));
  return shell_read(said, sizeof said, line);
}

TEST(test_refused) {
  char args[400];
  assert_int_equal(run("--config"), 2);
  assert_contains(said, "--config needs a value");
  assert_int_equal(run("--config /no/such/file"), 1);
  assert_contains(said, "/no/such/file: cannot be opened: it does not exist");
  setting("colour=red");
  snprintf(args, sizeof args, "--config '%s' --preview 1", temp_path("subview.conf"));
  assert_int_equal(run(args), 2);
  assert_contains(said, "unknown option '--colour=red'");
  setting("steps=5");
  temp_put_text("token", "12345\n"); // it is not replaced by another one
  snprintf(args, sizeof args, "--config '%s' --preview 18080", temp_path("subview.conf"));
  assert_int_equal(run(args), 1);
  assert_contains(said, "no token of a page");
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_interrupted), cmocka_unit_test(test_kept),
                                     cmocka_unit_test(test_camera_comes_late),
                                     cmocka_unit_test(test_refused)};
  return cmocka_run_group_tests(tests, temp_folder_setup, temp_folder_teardown);
}
