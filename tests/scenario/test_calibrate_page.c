// SPDX-License-Identifier: Apache-2.0
// Calibrate on the page: a chessboard that moves before simulated cameras, found, solved, checked
// and installed; the next scan uses that rig. Cameras without a rig are led there. What is asked
// for wrongly changes nothing.
#include <math.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "calib/solve/boards.h"
#include "calib/solve/corners.h"
#include "tests/common/browser.h"
#include "tests/common/live_run.h"
#include "tests/common/test.h"

// The hand that holds the rig moves as one that holds the board would. Poses are not told, so that
// the rig that is found serves for all.
#define SOURCE "sim:board,rig=stereo,path=sway,arc=40,size=320x240,turn_deg_s=40,move_m_s=0.4,poses=unknown"
#define SCAN   " --exposures 4 --gaussians 1500 --threads 2 --steps 60 --session "
#define RUN    "--source " SOURCE SCAN

static char root[256], token[128];
static live_run r;
static browser b;
static char out[1u << 16];
static uint8_t answer[1u << 20];

static void need_solver(void) {
  sv_err err;
  if (sv_corners_available(9, 6, &err) == SV_OK && sv_boards_available(&err) == SV_OK) return;
  print_message("skip  this build does not calibrate\n");
  skip();
}

// Prints into out and returns the exit code.
static int sh(const char *format, ...) SV_PRINTF(1, 2);
static int sh(const char *format, ...) {
  char command[1600];
  va_list ap;
  va_start(ap, format);
  vsnprintf(command, sizeof command, format, ap);
  va_end(ap);
  return shell_read(out, sizeof out, command);
}

static void start(const char *args) {
  if (!live_run_start(&r, root, args)) fail_msg("the run does not start: %s", r.err);
  snprintf(token, sizeof token, "X-Subview-Token: %s\r\n", r.token);
}

static int code_of(const char *method, const char *path, const char *headers) {
  live_run_request(&r, method, path, headers, answer, sizeof answer);
  return live_run_code(answer);
}

static void wait_for(const char *path, const char *text, double seconds) {
  for (int i = 0; i < 20 * seconds; i++, poll(NULL, 0, 50))
    if (code_of("GET", path, NULL) == 200 && strstr((char *)answer, text)) return;
  fail_msg("no %s in %s: %.3000s; %s", text, path, (char *)answer, r.err);
}

static double number(const char *text, const char *key) {
  const char *at = strstr(text, key);
  if (!at) fail_msg("no %s in: %s", key, text);
  return strtod(at + strlen(key), NULL);
}

// Calibrated without a browser: time and memory are told, the rig is right, and it is installed.
TEST(test_rig_is_installed) {
  char path[400];
  const char *bin = getenv("SV_BIN") ? getenv("SV_BIN") : "build/sim-x86/bin";
  need_solver();
  start(RUN);
  wait_for("/state", "\"state\":\"waiting\"", 20);
  assert_int_equal(code_of("POST", "/calibrate?board=9x6&mm=120", NULL), 403);
  assert_int_equal(code_of("POST", "/calibrate?board=9&mm=120", token), 400);
  assert_int_equal(code_of("POST", "/calibrate?board=9x6&mm=0", token), 400);
  assert_int_equal(code_of("POST", "/calibrate?board=9x6", token), 400);
  assert_int_equal(code_of("POST", "/calibrate?board=9x6&mm=120&lens=wide", token), 400);
  assert_int_equal(code_of("POST", "/calibrate?board=9x6&mm=120", token), 200);
  wait_for("/state", "\"state\":\"calibrating\"", 10);
  wait_for("/calibration", "\"phase\":\"done\"", 60);
  const char *json = (char *)answer;
  print_message("calibrated in %.1f s, %.0f MiB at most, baseline %.4f m, %.3f px\n",
                number(json, "\"seconds\":"), number(json, "\"peak\":") / 1048576,
                number(json, "\"baseline_m\":"), number(json, "\"rms_px\":"));
  assert_true(number(json, "\"peak\":") < 512.0 * 1048576);
  // Of the simulator's stereo rig
  assert_near(number(json, "\"baseline_m\":"), 0.837, 0.837 * 0.01);
  assert_true(number(json, "\"rms_px\":") < 0.5);
  // The page's rig is that of the next scan, and of a check
  wait_for("/state", "\"state\":\"waiting\"", 20);
  snprintf(path, sizeof path, "\"rig\":\"rig\"");
  assert_contains((char *)answer, path);
  assert_int_equal(code_of("POST", "/start", token), 200);
  wait_for("/state", "\"state\":\"done\"", 90);
  assert_int_equal(live_run_stop(&r), 0);
  assert_contains(r.err, "the rig was calibrated and installed as ");
  shell_ok("grep -q '\"rig\": *\"rig\"' '%s/out/run.json' || grep -q '\"rig\"' '%s/out/run.json'", root,
           root);
  assert_int_equal(sh("'%s/subview' run --source '%s' --rig '%s/out-rig' --check 2>&1", bin, SOURCE, root),
                   0);
  assert_contains(out, "ready: nothing speaks against a scan");
  snprintf(path, sizeof path, "%s/out-calibration/0001/capture", root);
  assert_int_equal(sh("'%s/subview-calibrate' check --rig '%s/out-rig' --images '%s/left' '%s/right' "
                      "--board 9x6 --spacing 0.12 --json 2>/dev/null",
                      bin, root, path, path),
                   0);
  assert_true(number(out, "\"rms_px\":") < 0.5);
  // A later session finds it by itself
  start(RUN "--overwrite");
  assert_contains(r.err, "as it was calibrated from the page");
  live_run_stop(&r);
}

// The board is seen in the middle of the images alone: the most exposures are taken.
TEST(test_fisheyes) {
  need_solver();
  start("--source " SOURCE ",lens=kb4:150" SCAN);
  wait_for("/state", "\"state\":\"waiting\"", 20);
  assert_int_equal(code_of("POST", "/calibrate?board=9x6&mm=120&lens=fisheye", token), 200);
  wait_for("/calibration", "\"phase\":\"done\"", 180);
  const char *json = (char *)answer;
  print_message("calibrated in %.1f s, %.0f MiB at most, baseline %.4f m, %.3f px\n",
                number(json, "\"seconds\":"), number(json, "\"peak\":") / 1048576,
                number(json, "\"baseline_m\":"), number(json, "\"rms_px\":"));
  assert_near(number(json, "\"baseline_m\":"), 0.837, 0.837 * 0.03);
  assert_true(number(json, "\"rms_px\":") < 0.5);
  wait_for("/state", "\"state\":\"waiting\"", 20);
  shell_ok("grep -rq SPLINED_STEREOGRAPHIC '%s/out-rig'", root);
  assert_int_equal(code_of("POST", "/start", token), 200);
  wait_for("/state", "\"state\":\"done\"", 90);
  assert_int_equal(live_run_stop(&r), 0);
}

// Cancelled: the run is ready again, with the rig as before, and no process is left.
TEST(test_cancel) {
  need_solver();
  start(RUN);
  wait_for("/state", "\"state\":\"waiting\"", 20);
  assert_int_equal(code_of("POST", "/calibrate?board=8x5&mm=120", token),
                   200); // another board: none is found
  wait_for("/state", "\"state\":\"calibrating\"", 10);
  assert_int_equal(code_of("POST", "/new", token), 200);
  wait_for("/calibration", "\"phase\":\"failed\"", 20);
  assert_contains((char *)answer, "was stopped");
  wait_for("/state", "\"state\":\"waiting\"", 20);
  struct stat st;
  char path[300];
  snprintf(path, sizeof path, "%s/out-rig", root);
  assert_int_not_equal(stat(path, &st), 0);
  live_run_stop(&r);
  assert_int_not_equal(sh("pgrep -f '%s/[o]ut-calibration'", root), 0);
}

#define MUST(expression, seconds)                                                                            \
  do {                                                                                                       \
    if (!browser_wait(&b, expression, seconds))                                                              \
      fail_msg("not in %d s: %s; %s", (int)(seconds), expression, r.err);                                    \
  } while (0)

static void picture(const char *name) {
  char path[600];
  const char *keep = getenv("SV_KEEP_PICTURES");
  snprintf(path, sizeof path, "%s/%s.png", keep ? keep : root, name);
  assert_true(browser_screenshot(&b, path));
}

// Two cameras without a rig (pictures in folders, a board in them): Start leads to Calibrate; the
// person types the side of a square, watches, and sees the result.
TEST(test_page) {
  char text[400], why[200];
  const char *bin = getenv("SV_BIN") ? getenv("SV_BIN") : "build/sim-x86/bin";
  need_solver();
  if (!browser_program()) skip();
  shell_ok("'%s/subview' capture --quiet --source '%s' --every 0.3 --exposures 30 --out '%s/pictures' "
           ">%s/said 2>&1 "
           "&& rm -r '%s/pictures/rig' && sed -i '/^\"rig\":/d' '%s/pictures/capture.json'",
           bin, SOURCE, root, root, root, root);
  start("--source replay:@/pictures --exposures 4 --gaussians 1500 --threads 2 --steps 60 --session");
  if (!browser_open(&b, root, 420, 860, why, sizeof why)) {
    live_run_stop(&r);
    print_message("skip the page: Chromium does not start here: %s\n", why);
    skip();
  }
  assert_true(browser_goto(&b, r.link));
  MUST(
      "$('state').textContent === 'failed' && $('start').textContent === 'Calibrate' && !$('start').disabled",
      20);
  assert_true(browser_eval(&b, "$('start').click()", text, sizeof text));
  MUST("!$('page-calibrate').hidden && $('cal-mm').value === '24' && $('cal-pdf').href.includes('9x6')", 10);
  assert_true(browser_eval(&b, "$('cal-paper').value = 'a3', $('cal-paper').onchange()", text, sizeof text));
  MUST("+$('cal-mm').value > 30", 10);
  picture("calibrate-before");
  assert_true(browser_eval(&b, "$('cal-mm').value = '120', $('cal-start').click()", text, sizeof text));
  MUST("$('state').textContent === 'calibrating' && !$('cal-cancel').hidden", 20);
  MUST("$('cal-views').children.length === 2 && cal.c.cameras.some((c) => c.boards > 0)", 30);
  poll(NULL, 0, 700); // the newest image comes by another connection
  assert_true(browser_eval(&b, "$('cal-views').scrollIntoView()", text, sizeof text));
  picture("calibrate-live");
  MUST("!$('cal-result').hidden && $('cal-verdict').textContent.includes('The next scan uses it')", 90);
  MUST("$('cal-table').rows.length === 3 && parseFloat($('cal-table').rows[1].cells[3].textContent) < 0.5",
       10);
  MUST("$('state').textContent === 'waiting' && $('start').textContent === 'Start' && !$('start').disabled",
       20);
  assert_true(browser_eval(&b, "$('cal-result').scrollIntoView()", text, sizeof text));
  picture("calibrate-done");
  browser_close(&b);
  live_run_stop(&r);
}

FIXTURE(make_root) {
  signal(SIGPIPE, SIG_IGN);
  return temp_folder_make(root, sizeof root, "calibrate");
}
FIXTURE(stop) {
  browser_close(&b);
  live_run_stop(&r);
  return sh("rm -rf '%s/out-rig' '%s/out-calibration'", root, root);
}
FIXTURE(remove_root) { return temp_folder_remove(root); }

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test_teardown(test_rig_is_installed, stop),
      cmocka_unit_test_teardown(test_fisheyes, stop),
      cmocka_unit_test_teardown(test_cancel, stop),
      cmocka_unit_test_teardown(test_page, stop),
  };
  return cmocka_run_group_tests(tests, make_root, remove_root);
}
