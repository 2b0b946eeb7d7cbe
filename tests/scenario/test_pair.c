// SPDX-License-Identifier: Apache-2.0
// How a device gets to the page: the code in the terminal, the PIN, what may tell the link's secret
// and what never does, and the chessboard to print.
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "tests/common/browser.h"
#include "tests/common/live_run.h"
#include "tests/common/test.h"

#define RUN                                                                                                  \
  "--source sim:textured,rig=stereo,size=96x64 --exposures 4 --gaussians 1500 --threads 1 --steps 100 "      \
  "--session "

static char root[256];
static live_run r;
static browser b[2];
static uint8_t answer[1u << 20];

static void start(const char *args) {
  if (!live_run_start(&r, root, args)) fail_msg("the run does not start: %s", r.err);
}

static int code_of(const char *method, const char *path, const char *headers) {
  live_run_request(&r, method, path, headers, answer, sizeof answer);
  return live_run_code(answer);
}

static const char *body(void) {
  const char *at = strstr((const char *)answer, "\r\n\r\n");
  return at ? at + 4 : "";
}

// --- the PIN -------------------------------------------------------------------------------------

static void open_pin(char pin[8]) {
  char headers[128];
  snprintf(headers, sizeof headers, "X-Subview-Token: %s\r\n", r.token);
  assert_int_equal(code_of("POST", "/pin", headers), 200);
  assert_contains(body(), "{\"pin\":\"");
  snprintf(pin, 8, "%.6s", strstr(body(), "\"pin\":\"") + 7);
  assert_int_equal(strspn(pin, "0123456789"), 6);
}

static int try_pin(const char *pin) {
  char headers[128];
  snprintf(headers, sizeof headers, "X-Subview-Pin: %s\r\n", pin);
  return code_of("POST", "/pair", headers);
}

TEST(test_pin) {
  char pin[8], wrong[8];
  start(RUN);
  assert_int_equal(code_of("POST", "/pin", NULL), 403);
  assert_int_equal(code_of("POST", "/qr", NULL), 403);
  assert_int_equal(code_of("GET", "/pin", NULL), 404);
  assert_int_equal(code_of("POST", "/pair", NULL), 410);
  open_pin(pin);
  snprintf(wrong, sizeof wrong, "%s", pin);
  wrong[5] = pin[5] == '0' ? '1' : '0';
  assert_int_equal(try_pin(wrong), 403);
  assert_null(strstr((char *)answer, r.token));
  assert_int_equal(try_pin(pin), 200);
  assert_int_equal(strncmp(body(), r.token, strlen(r.token)), 0);
  assert_int_equal(try_pin(pin), 410); // once
  open_pin(pin);
  snprintf(wrong, sizeof wrong, "%s", pin);
  wrong[0] = pin[0] == '0' ? '1' : '0';
  for (int i = 0; i < 5; i++) assert_int_equal(try_pin(wrong), 403);
  assert_int_equal(try_pin(pin), 410); // guessed at too often
  assert_int_equal(code_of("POST", "/pair", "Origin: http://evil.example\r\n"), 403);
  live_run_stop(&r);
}

// --- where the secret is -------------------------------------------------------------------------

// With --token-file the log is a place without the secret, and no answer without it has it.
TEST(test_secret_stays) {
  static const char *const paths[] = {"/",         "/page.js",   "/pair.js", "/shared.js",
                                      "/page.css", "/icon.svg",  "/state",   "/curve",
                                      "/events",   "/board.svg", "/nothing", "/tools.js"};
  char headers[200];
  start(RUN "--token-file @/token");
  assert_int_equal(strlen(r.token), 32);
  for (size_t i = 0; i < sizeof paths / sizeof *paths; i++) {
    (void)code_of("GET", paths[i], NULL);
    assert_contains((char *)answer, "Referrer-Policy: no-referrer\r\n");
    assert_contains((char *)answer, "Cache-Control: no-store\r\n");
    assert_null(strstr((char *)answer, r.token));
  }
  snprintf(headers, sizeof headers, "X-Subview-Token: %s\r\nX-Subview-Page: aaaaaaaaaaaaaaaa\r\n", r.token);
  assert_int_equal(code_of("POST", "/enter", headers), 204);
  assert_null(strstr((char *)answer, r.token));
  assert_int_equal(code_of("POST", "/qr", headers), 200);
  assert_null(strstr((char *)answer, r.token)); // as squares alone
  assert_int_equal(code_of("POST", "/start", headers), 200);
  for (int i = 0; i < 400 && !strstr((char *)answer, "\"state\":\"done\""); i++, poll(NULL, 0, 50))
    (void)code_of("GET", "/state", NULL);
  assert_int_equal(code_of("GET", "/events", NULL), 200);
  assert_null(strstr((char *)answer, r.token));
  assert_int_equal(live_run_stop(&r), 0);
  assert_contains(r.err, "page: http://127.0.0.1:");
  assert_null(strstr(r.err, r.token));
  char command[600];
  snprintf(command, sizeof command, "grep -rlF %s %s | grep -v '/token$'", r.token, root);
  assert_int_not_equal(system(command), 0); // nor what the run has written
}

// --- the board -----------------------------------------------------------------------------------

TEST(test_board) {
  start(RUN);
  assert_int_equal(code_of("GET", "/board.pdf", NULL), 200);
  assert_contains((char *)answer, "Content-Type: application/pdf\r\n");
  assert_int_equal(strncmp(body(), "%PDF-1.4\n", 9), 0);
  assert_int_equal(code_of("GET", "/board.svg?board=7x10&paper=letter", NULL), 200);
  assert_contains(body(), "Squares of 22 mm: --board 7x10 --spacing 0.022");
  assert_int_equal(code_of("GET", "/board.svg?board=7", NULL), 400);
  assert_int_equal(code_of("GET", "/board.svg?paper=%3cb%3e", NULL), 400);
  assert_int_equal(code_of("GET", "/board.svg?board=64x64&paper=a4", NULL), 200);
  live_run_stop(&r);
}

// --- the terminal --------------------------------------------------------------------------------

// A pseudo-terminal of util-linux: the link, and below it the code, as long as it is no loopback.
// The second terminal is that of --console.
TEST(test_terminal) {
  char command[900];
  static char said[64 << 10];
  const char *bin = getenv("SV_BIN"), *emulate = getenv("SV_EMULATE");
  if (system("command -v script >/dev/null 2>&1") != 0) skip();
  for (int k = 0; k < 2; k++) {
    snprintf(
        command, sizeof command,
        "timeout 2 script -qec 'SUBVIEW_PREVIEW_TOKEN= %s %s/subview run --source sim:textured,size=96x64 "
        "--preview %s%d --session --overwrite --out %s/tty%s' /dev/null </dev/null 2>&1",
        emulate ? emulate : "", bin ? bin : "build/sim-x86/bin", k ? "0.0.0.0:" : "",
        18471 + (int)getpid() % 999, root, k ? " --console $(tty) 2>/dev/null" : "");
    FILE *p = popen(command, "r");
    assert_non_null(p);
    said[fread(said, 1, sizeof said - 1, p)] = 0;
    pclose(p);
    if (k == 0) assert_contains(said, "page: http://127.0.0.1:");
    const char *code = strstr(said, "\033[38;5;16;48;5;231m    \u2588\u2580\u2580\u2580\u2580\u2580\u2588 ");
    if (k == 1 && !strstr(said, "subview: http://")) skip(); // this machine has no network
    if (k == 1) assert_non_null(code);
    else assert_null(code);
  }
}

// --- TLS -----------------------------------------------------------------------------------------

// Code of a request by curl over https, which does not know the certificate.
static int code_over_tls(const char *more, const char *path) {
  static char command[700], said[64];
  snprintf(command, sizeof command,
           "curl -sk -m 10 -D '%s/head' -o '%s/body' -w '%%{http_code}' %s https://127.0.0.1:%d%s", root,
           root, more, r.port, path);
  FILE *p = popen(command, "r");
  assert_non_null(p);
  said[fread(said, 1, sizeof said - 1, p)] = 0;
  pclose(p);
  return atoi(said);
}

// The certificate is made at the first start, for its owner's eyes, and stays. Nothing is answered
// in the clear.
TEST(test_tls) {
  char fingerprint[2][200] = {"", ""}, path[400];
  struct stat st;
  if (system("command -v curl >/dev/null 2>&1") != 0) skip();
  for (int k = 0; k < 2; k++) {
    if (!live_run_start(&r, root, RUN "--tls @/page.pem")) {
      if (strstr(r.err, "was missing")) skip(); // built without it
      fail_msg("the run does not start: %s", r.err);
    }
    assert_contains(r.err, "page: https://127.0.0.1:");
    assert_contains(r.err, k ? "certificate: SHA-256 " : "certificate: new, browsers ask once; SHA-256 ");
    snprintf(fingerprint[k], 96, "%s", strstr(r.err, "SHA-256 "));
    assert_int_equal(code_over_tls("", "/state"), 200);
    snprintf(path, sizeof path, "-X POST -H 'Origin: https://127.0.0.1:%d' -H 'X-Subview-Token: %s'", r.port,
             r.token);
    assert_int_equal(code_over_tls(path, "/enter"), 204);
    shell_ok("grep -qi '^set-cookie: .*; Secure' '%s/head'", root);
    snprintf(path, sizeof path, "-X POST -H 'Origin: http://127.0.0.1:%d' -H 'X-Subview-Token: %s'", r.port,
             r.token);
    assert_int_equal(code_over_tls(path, "/enter"), 403);
    assert_int_equal(code_of("GET", "/state", NULL), 0);
    assert_null(strstr(r.err, "PRIVATE"));
    live_run_stop(&r);
  }
  assert_string_equal(fingerprint[0], fingerprint[1]);
  snprintf(path, sizeof path, "%s/page.pem", root);
  assert_int_equal(stat(path, &st), 0);
  assert_int_equal(st.st_mode & 0777, 0600);
  shell_ok("sed -i '/CERTIFICATE/,$d' '%s'", path); // a key alone
  assert_false(live_run_start(&r, root, RUN "--tls @/page.pem"));
  assert_contains(r.err, "no key with its certificate");
}

// The name that avahi gives to the device is ours, and no other name of its kind.
TEST(test_name) {
  char host[64];
  start(RUN);
  snprintf(host, sizeof host, "Host: subview.local:%d\r\n", r.port);
  assert_int_equal(code_of("GET", "/state", host), 200);
  snprintf(host, sizeof host, "Host: subview.example:%d\r\n", r.port);
  assert_int_equal(code_of("GET", "/state", host), 403);
  live_run_stop(&r);
}

// --- in browsers ---------------------------------------------------------------------------------

#define MUST(browser, expression, seconds)                                                                   \
  do {                                                                                                       \
    if (!browser_wait(browser, expression, seconds))                                                         \
      fail_msg("not in %d s: %s; %s", (int)(seconds), expression, r.err);                                    \
  } while (0)

static void open_browser(int i) {
  char why[200], folder[300];
  snprintf(folder, sizeof folder, "%s/browser%d", root, i);
  shell_ok("mkdir -p %s", folder);
  if (browser_open(&b[i], folder, 420, 860, why, sizeof why)) return;
  live_run_stop(&r);
  print_message("skip the page: Chromium does not start here: %s\n", why);
  skip();
}

TEST(test_two_devices) {
  char text[4096], script[200];
  if (!browser_program()) skip();
  r.is_open = true; // reading takes the token, too
  bool is_started = live_run_start(&r, root, RUN);
  r.is_open = false;
  if (!is_started) fail_msg("the run does not start: %s", r.err);
  open_browser(0);
  assert_true(browser_goto(&b[0], r.link));
  MUST(&b[0], "page.seat === 1 && $('state').textContent === 'waiting'", 20);
  // The secret has left the address and is nowhere in the document; a reload keeps the seat.
  snprintf(script, sizeof script, "[location.href, document.documentElement.outerHTML].join().includes('%s')",
           r.token);
  assert_true(browser_eval(&b[0], script, text, sizeof text));
  assert_string_equal(text, "false");
  assert_true(browser_eval(&b[0], "window.is_old = true, location.reload()", text, sizeof text));
  MUST(&b[0], "!window.is_old && typeof page !== 'undefined' && page.seat === 1 && $('pair').hidden", 20);
  assert_true(browser_eval(&b[0], "$('pair-open').click()", text, sizeof text));
  MUST(&b[0], "!$('pair-shown').hidden && $('pair-code').naturalWidth > 100", 10);
  char pin[16];
  assert_true(browser_eval(&b[0], "$('pair-pin').textContent", pin, sizeof pin));
  assert_int_equal(strlen(pin), 7);
  // The other one has only the address
  open_browser(1);
  snprintf(text, sizeof text, "http://127.0.0.1:%d/", r.port);
  assert_true(browser_goto(&b[1], text));
  MUST(&b[1], "!$('pair').hidden && page.seat === 0", 10);
  snprintf(script, sizeof script, "$('pair-given').value = '%s', $('pair').requestSubmit()", pin);
  assert_true(browser_eval(&b[1], script, text, sizeof text));
  MUST(&b[1], "page.seat > 1 && $('state').textContent === 'waiting' && $('pair').hidden", 20);
  assert_true(browser_eval(&b[1], "location.href", text, sizeof text));
  assert_null(strstr(text, r.token));
  browser_close(&b[1]);
  browser_close(&b[0]);
  live_run_stop(&r);
}

FIXTURE(make_root) {
  signal(SIGPIPE, SIG_IGN);
  return temp_folder_make(root, sizeof root, "pair");
}
FIXTURE(stop) {
  browser_close(&b[0]);
  browser_close(&b[1]);
  live_run_stop(&r);
  return 0;
}
FIXTURE(remove_root) { return temp_folder_remove(root); }

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test_teardown(test_pin, stop),         cmocka_unit_test_teardown(test_secret_stays, stop),
      cmocka_unit_test_teardown(test_board, stop),       cmocka_unit_test(test_terminal),
      cmocka_unit_test_teardown(test_tls, stop),         cmocka_unit_test_teardown(test_name, stop),
      cmocka_unit_test_teardown(test_two_devices, stop),
  };
  return cmocka_run_group_tests(tests, make_root, remove_root);
}
