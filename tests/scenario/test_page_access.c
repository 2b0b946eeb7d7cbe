// SPDX-License-Identifier: Apache-2.0
// The page's server: who may ask what, tokens and cookies, paths that are not there, how much one
// address gets, and what the server's process has taken off.
#include <errno.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include "tests/common/live_run.h"
#include "tests/common/test.h"

#define BASE "--source sim:textured,rig=stereo,size=96x64 --exposures 4 --gaussians 1500 --threads 1 "

static char root[256];
static live_run r;
static uint8_t answer[1u << 20];

static void start(const char *args) {
  if (!live_run_start(&r, root, args)) fail_msg("the run does not start: %s", r.err);
}

static int code_of(const char *method, const char *path, const char *headers) {
  live_run_request(&r, method, path, headers, answer, sizeof answer);
  return live_run_code(answer);
}

// A value of the state's JSON.
static bool state_has(const char *text) {
  return code_of("GET", "/state", NULL) == 200 && strstr((const char *)answer, text) != NULL;
}
static bool wait_for(const char *text, double seconds) {
  for (int i = 0; i < 20 * seconds; i++, poll(NULL, 0, 50))
    if (state_has(text)) return true;
  return false;
}

// --- who may ask ---------------------------------------------------------------------------------

static void test_commands_need_the_token(void **state) {
  (void)state;
  static const char *const paths[] = {"/start", "/pause", "/save", "/new", "/scan/1/delete"};
  char headers[256], wrong[40];
  start(BASE "--steps 100 --session");
  assert_true(wait_for("\"state\":\"waiting\"", 10));
  snprintf(wrong, sizeof wrong, "%s", r.token);
  wrong[31] = wrong[31] == '0' ? '1' : '0';
  for (int i = 0; i < 5; i++) {
    assert_int_equal(code_of("POST", paths[i], NULL), 403);
    assert_int_equal(code_of("POST", paths[i], "X-Subview-Token: \r\n"), 403);
    snprintf(headers, sizeof headers, "X-Subview-Token: %s\r\n", wrong);
    assert_int_equal(code_of("POST", paths[i], headers), 403);
    snprintf(headers, sizeof headers, "X-Subview-Token: %.31s\r\n", r.token);
    assert_int_equal(code_of("POST", paths[i], headers), 403);
    // what a browser sends by itself is no proof
    snprintf(headers, sizeof headers, "Cookie: subview-%d=%s\r\n", r.port, r.token);
    assert_int_equal(code_of("POST", paths[i], headers), 403);
    snprintf(headers, sizeof headers, "X-Subview-Token: %s\r\n", r.token);
    assert_int_equal(code_of("GET", paths[i], headers), 404);
    snprintf(headers, sizeof headers, "X-Subview-Token: %s\r\nOrigin: http://evil.example\r\n", r.token);
    assert_int_equal(code_of("POST", paths[i], headers), 403);
    snprintf(headers, sizeof headers, "X-Subview-Token: %s\r\nHost: evil.example:%d\r\n", r.token, r.port);
    assert_int_equal(code_of("POST", paths[i], headers), 403);
    snprintf(headers, sizeof headers, "X-Subview-Token: %s\r\nHost: 127.0.0.1:1\r\n", r.token);
    assert_int_equal(code_of("POST", paths[i], headers), 403);
    snprintf(headers, sizeof headers, "X-Subview-Token: %s\r\nSec-Fetch-Site: cross-site\r\n", r.token);
    assert_int_equal(code_of("POST", paths[i], headers), 403);
  }
  assert_int_equal(code_of("GET", "/state", "Host: evil.example\r\n"), 403);
  assert_int_equal(code_of("GET", "/state", "Origin: http://evil.example\r\n"), 403);
  assert_int_equal(code_of("DELETE", "/state", NULL), 405);
  poll(NULL, 0, 300);
  assert_true(state_has("\"state\":\"waiting\"")); // nothing of all that did anything
  assert_true(state_has("seccomp, no_new_privs"));
  snprintf(headers, sizeof headers, "X-Subview-Token: %s\r\nOrigin: http://127.0.0.1:%d\r\n", r.token,
           r.port);
  assert_int_equal(code_of("POST", "/start", headers), 200);
  assert_true(wait_for("\"state\":\"done\"", 60));
  assert_int_equal(live_run_stop(&r), 0);
}

// The first page has control. What another page asks for has no effect, until it gets control.
TEST(test_one_controls) {
  static const char *const ids[] = {"aaaaaaaaaaaaaaaa", "bbbbbbbbbbbbbbbb"};
  static const char *const paths[] = {"/start",         "/pause",          "/save", "/new",
                                      "/scan/1/delete", "/scan/1/restore", "/give", "/keep"};
  char page[2][200];
  start(BASE "--steps 100 --session");
  assert_true(wait_for("\"state\":\"waiting\"", 10));
  assert_true(state_has("\"control\":{\"by\":0,\"asked\":0}"));
  for (int i = 0; i < 2; i++) {
    snprintf(page[i], sizeof page[i], "X-Subview-Token: %s\r\nX-Subview-Page: %s\r\n", r.token, ids[i]);
    assert_int_equal(code_of("POST", "/enter", page[i]), 204);
    assert_contains((char *)answer, i ? "X-Subview-Seat: 2\r\n" : "X-Subview-Seat: 1\r\n");
  }
  assert_true(state_has("\"control\":{\"by\":1,\"asked\":0}"));
  for (int i = 0; i < 8; i++) {
    assert_int_equal(code_of("POST", paths[i], page[1]), i < 6 ? 423 : 409);
    char headers[120]; // a program that is no page
    snprintf(headers, sizeof headers, "X-Subview-Token: %s\r\n", r.token);
    assert_int_equal(code_of("POST", paths[i], headers), i < 6 ? 423 : 409);
  }
  assert_int_equal(code_of("POST", "/ask", "X-Subview-Page: bbbbbbbbbbbbbbbb\r\n"), 403);
  poll(NULL, 0, 300);
  assert_true(state_has("\"state\":\"waiting\""));
  assert_null(strstr((char *)answer, ids[0])); // what would let others pass for it
  assert_int_equal(code_of("POST", "/ask", page[1]), 200);
  assert_true(state_has("\"control\":{\"by\":1,\"asked\":2}"));
  assert_int_equal(code_of("POST", "/keep", page[0]), 200);
  assert_true(state_has("\"control\":{\"by\":1,\"asked\":0}"));
  assert_int_equal(code_of("POST", "/ask", page[1]), 200);
  assert_int_equal(code_of("POST", "/give", page[0]), 200);
  assert_true(state_has("\"control\":{\"by\":2,\"asked\":0}"));
  assert_int_equal(code_of("POST", "/start", page[0]), 423);
  assert_int_equal(code_of("POST", "/start", page[1]), 200);
  assert_true(wait_for("\"state\":\"done\"", 60));
  live_run_stop(&r);
}

// The cookie of an answer, "" when there is none.
static void cookie_of(char *out, size_t cap) {
  const char *line = strstr((const char *)answer, "Set-Cookie: ");
  snprintf(out, cap, "%.*s", line ? (int)strcspn(line + 12, "\r") : 0, line ? line + 12 : "");
}

// On an address that others reach, reading takes the token, too, or the cookie that it gives.
static void test_private(void **state) {
  (void)state;
  char headers[256], cookie[200], name[32];
  r.is_open = true;
  start(BASE "--steps 100 --session");
  r.is_open = false;
  assert_int_equal(code_of("GET", "/", NULL), 200);
  assert_int_equal(code_of("GET", "/state", NULL), 403);
  assert_int_equal(code_of("GET", "/cameras", NULL), 403);
  assert_int_equal(code_of("GET", "/camera?i=0", NULL), 403);
  assert_int_equal(code_of("GET", "/model.ply", NULL), 403);
  assert_int_equal(code_of("GET", "/scans", NULL), 403);
  assert_int_equal(code_of("GET", "/scan/1/model.ply", NULL), 403);
  assert_int_equal(code_of("GET", "/look-key", NULL), 403);
  assert_int_equal(code_of("POST", "/enter", NULL), 403);
  cookie_of(cookie, sizeof cookie);
  assert_string_equal(cookie, "");
  snprintf(headers, sizeof headers, "X-Subview-Token: %s\r\n", r.token);
  assert_int_equal(code_of("GET", "/state", headers), 200);
  assert_int_equal(code_of("POST", "/enter", headers), 204);
  cookie_of(cookie, sizeof cookie);
  snprintf(name, sizeof name, "subview-%d=", r.port); // browsers send it to every port
  assert_int_equal(strncmp(cookie, name, strlen(name)), 0);
  assert_contains(cookie, "; HttpOnly");
  assert_contains(cookie, "; SameSite=Strict");
  assert_null(strstr(cookie, r.token));
  cookie[strcspn(cookie, ";")] = 0;
  snprintf(headers, sizeof headers, "Cookie: %s\r\n", cookie);
  assert_int_equal(code_of("GET", "/state", headers), 200);
  assert_int_equal(code_of("POST", "/start", headers), 403);
  assert_int_equal(code_of("POST", "/enter", headers), 403);
  snprintf(headers, sizeof headers, "Cookie: subview%s\r\n", strchr(cookie, '='));
  assert_int_equal(code_of("GET", "/state", headers), 403);
  snprintf(headers, sizeof headers, "Cookie: %s%s\r\n", name, r.token);
  assert_int_equal(code_of("GET", "/state", headers), 403);
  live_run_stop(&r);
}

// --- one address among many ----------------------------------------------------------------------

// How many of the connections the server has not closed.
static int n_open(const int *fd, int n) {
  int n_left = 0;
  for (int i = 0; i < n; i++) {
    char byte;
    n_left += fd[i] >= 0 && recv(fd[i], &byte, 1, MSG_DONTWAIT) < 0 && errno == EAGAIN;
  }
  return n_left;
}

// Three other addresses take all that they get, and hold it; everyone else is served.
TEST(test_one_address_cannot_take_all) {
  enum { N = 64 };
  static int fd[3][N];
  start(BASE "--steps 100 --session");
  for (int a = 0; a < 3; a++)
    for (int i = 0; i < N; i++) fd[a][i] = live_run_connect_from(&r, 2 + a);
  poll(NULL, 0, 500);
  for (int a = 0; a < 3; a++) {
    int n_left = n_open(fd[a], N);
    print_message("127.0.0.%d holds %d of %d connections\n", 2 + a, n_left, N);
    assert_in_range(n_left, 16, 24);
  }
  for (int i = 0; i < 20; i++) assert_int_equal(code_of("GET", "/state", NULL), 200);
  for (int a = 0; a < 3; a++)
    for (int i = 0; i < N; i++)
      if (fd[a][i] >= 0) close(fd[a][i]);
  live_run_stop(&r);
}

// What the server of a run has taken off.
TEST(test_server_is_shut_in) {
  char path[64], text[4096], target[64];
  start(BASE "--steps 100 --session");
  assert_true(wait_for("\"state\":\"waiting\"", 10));
  pid_t server = live_run_server(&r);
  snprintf(path, sizeof path, "/proc/%d/status", (int)server);
  FILE *f = fopen(path, "r");
  assert_non_null(f);
  text[fread(text, 1, sizeof text - 1, f)] = 0;
  fclose(f);
  assert_contains(text, "Seccomp:\t2");
  assert_contains(text, "NoNewPrivs:\t1");
  assert_contains(text, "CapPrm:\t0000000000000000");
  assert_int_equal(getsid(server), server);
  assert_int_not_equal(getsid(0), server);
  if (geteuid() == 0) {
    assert_contains(text, "Uid:\t65534\t65534\t65534\t65534");
    snprintf(path, sizeof path, "/proc/%d/fd/0", (int)server);
    ssize_t n = readlink(path, target, sizeof target - 1);
    target[n > 0 ? n : 0] = 0;
    assert_string_equal(target, "/dev/null");
  }
  live_run_stop(&r);
}

// --- tokens that are refused ---------------------------------------------------------------------

// What the server says of a token of so many letters and an ending.
static void say_of_token(int n_letters, const char *ending, char *said, size_t cap) {
  char token[400], command[900];
  const char *bin = getenv("SV_BIN"), *emulate = getenv("SV_EMULATE");
  memset(token, 'a', sizeof token);
  snprintf(token + n_letters, sizeof token - (size_t)n_letters, "%s", ending);
  snprintf(command, sizeof command,
           "SUBVIEW_PREVIEW_TOKEN='%s' timeout 2 %s %s/subview-preview --attach %d --listen %d 2>&1", token,
           emulate ? emulate : "", bin ? bin : "build/sim-x86/bin", (int)r.pid, r.port + 1);
  FILE *p = popen(command, "r");
  assert_non_null(p);
  said[fread(said, 1, cap - 1, p)] = 0;
  pclose(p);
}

TEST(test_tokens_of_the_user) {
  char said[1024];
  start(BASE "--steps 100 --session");
  say_of_token(1, "", said, sizeof said);
  assert_string_equal(said, "subview-preview: SUBVIEW_PREVIEW_TOKEN has 1 characters; expected 16 to 128\n");
  say_of_token(129, "", said, sizeof said);
  assert_string_equal(said,
                      "subview-preview: SUBVIEW_PREVIEW_TOKEN has 129 characters; expected 16 to 128\n");
  say_of_token(20, "&", said, sizeof said);
  assert_contains(said, "character 21 is none of A-Z a-z 0-9 - _");
  say_of_token(125, "-_9", said, sizeof said);
  assert_contains(said, "aaa-_9\n"); // the link has the whole token
  say_of_token(16, "", said, sizeof said);
  assert_contains(said, "/#aaaaaaaaaaaaaaaa\n");
  live_run_stop(&r);
}

// --- paths that are not there --------------------------------------------------------------------

static int n_paths;
static void must_be_404(const char *path) {
  n_paths++;
  int code = code_of("GET", path, NULL);
  if (code != 404) fail_msg("%s: %d, expected 404", path, code);
}

static void test_traversal(void **state) {
  (void)state;
  static const char *const up[] = {"../",   "..%2f",    "%2e%2e/", "%2e%2e%2f",       "..\\",
                                   "..%5c", "..%c0%af", "....//",  "%252e%252e%252f", "..;/"};
  static const char *const targets[] = {"etc/passwd", "proc/self/environ", "proc/self/maps", "etc/shadow",
                                        "model.ply"};
  char path[512];
  start(BASE "--steps 100 --session");
  n_paths = 0;
  for (int u = 0; u < 10; u++)
    for (int t = 0; t < 5; t++)
      for (int depth = 1; depth <= 7; depth += 2) {
        size_t n = 1;
        path[0] = '/';
        for (int d = 0; d < depth; d++) n += (size_t)snprintf(path + n, sizeof path - n, "%s", up[u]);
        snprintf(path + n, sizeof path - n, "%s", targets[t]);
        must_be_404(path);
      }
  static const char *const more[] = {"//etc/passwd",
                                     "/./state",
                                     "/state/",
                                     "/state%00",
                                     "/page.js/../state",
                                     "/%2fstate",
                                     "/STATE",
                                     "/model.ply/",
                                     "/model",
                                     "/model.ply%20",
                                     "/scan/1/../../etc/passwd",
                                     "/scan/01/model.ply",
                                     "/scan/1/checkpoint.bin",
                                     "/scan/-1/model.ply",
                                     "/scan//model.ply",
                                     "/scans/",
                                     "/index.html",
                                     "/.git/config",
                                     "/~root",
                                     "/cgi-bin/x"};
  for (size_t i = 0; i < sizeof more / sizeof *more; i++) must_be_404(more[i]);
  print_message("%d paths, none is there\n", n_paths);
  assert_true(n_paths >= 200);
  assert_true(state_has("\"state\":\"waiting\""));
  live_run_stop(&r);
}

// --- a save that fails ---------------------------------------------------------------------------

// The page says "saved" after a save that succeeded, and the reason after one that did not.
TEST(test_failed_save) {
  char headers[128], command[400];
  start(BASE "--time-limit 600 --rescue @/rescue");
  assert_true(wait_for("\"state\":\"training\"", 20));
  snprintf(headers, sizeof headers, "X-Subview-Token: %s\r\n", r.token);
  snprintf(command, sizeof command, "rm -r '%s/out'", root); // the disk is pulled
  assert_int_equal(system(command), 0);
  assert_int_equal(code_of("POST", "/save", headers), 200);
  for (int i = 0; i < 100 && !strstr((char *)answer, "model.ply"); i++, poll(NULL, 0, 50))
    (void)code_of("GET", "/events", NULL);
  assert_contains((char *)answer, "model.ply");
  assert_null(strstr((char *)answer, "saved model.ply"));
  assert_true(state_has("\"saves\":0,"));
  assert_true(wait_for("\"state\":\"training\"", 5));
  assert_int_equal(live_run_stop(&r), 3); // the model is in the second place
}

// --- setup ---------------------------------------------------------------------------------------

FIXTURE(make_root) {
  signal(SIGPIPE, SIG_IGN);
  return temp_folder_make(root, sizeof root, "access");
}
FIXTURE(stop) {
  live_run_stop(&r);
  return 0;
}
FIXTURE(remove_root) { return temp_folder_remove(root); }

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test_teardown(test_commands_need_the_token, stop),
      cmocka_unit_test_teardown(test_one_controls, stop),
      cmocka_unit_test_teardown(test_private, stop),
      cmocka_unit_test_teardown(test_tokens_of_the_user, stop),
      cmocka_unit_test_teardown(test_one_address_cannot_take_all, stop),
      cmocka_unit_test_teardown(test_server_is_shut_in, stop),
      cmocka_unit_test_teardown(test_traversal, stop),
      cmocka_unit_test_teardown(test_failed_save, stop),
  };
  return cmocka_run_group_tests(tests, make_root, remove_root);
}
