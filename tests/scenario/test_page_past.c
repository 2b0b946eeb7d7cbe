// SPDX-License-Identifier: Apache-2.0
// The last seconds of a live run through its page: a snapshot that stays while the run goes on,
// whole and by ranges, models of its instants, and the slider in a browser.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "src/format/ply.h"
#include "src/format/sequence.h"
#include "tests/common/browser.h"
#include "tests/common/live_run.h"
#include "tests/common/test.h"

#define CAP_ANSWER (4u << 20)
#define N          400

static char root[256];
static live_run r;
static browser b;
static uint8_t answer[CAP_ANSWER], again[CAP_ANSWER];
static _Alignas(8) uint8_t workspace[1u << 20];
static sv_err err;

static void rest(void) {
  const struct timespec t = {.tv_nsec = 100 * 1000000};
  nanosleep(&t, NULL);
}

static int get(const char *path, const char *headers, uint8_t *out, size_t *n) {
  *n = live_run_get(&r, path, headers, out, CAP_ANSWER - 1);
  out[*n] = 0;
  return live_run_code(out);
}

// A number of the state's JSON behind a name; below 0: it is not there.
static double state(const char *group, const char *name) {
  size_t n;
  if (get("/state", NULL, answer, &n) != 200) return -1;
  const char *at = strstr((const char *)answer, group), *v = at ? strstr(at, name) : NULL;
  return v ? strtod(v + strlen(name), NULL) : -1;
}

static void wait_for(const char *name, double least) {
  for (int i = 0; i < 600; i++) {
    if (state("\"history\":", name) >= least) return;
    rest();
  }
  fail_msg("%s is not %g in a minute; %s", name, least, r.err);
}

// Asks for a snapshot; its number.
static double ask(void) {
  size_t n;
  const double before = state("\"history\":", "\"seq\":");
  for (int i = 0; i < 100; i++) { // one a second at most
    assert_int_equal(get("/history", NULL, answer, &n), 200);
    rest();
    if (state("\"history\":", "\"seq\":") > before) return state("\"history\":", "\"seq\":");
  }
  fail_msg("no snapshot; %s", r.err);
  return 0;
}

static void start(void) {
  if (!live_run_start(&r, root,
                      "--source sim:moving,rig=stereo,arc=0,size=64x48,fps=10 --scene dynamic --live "
                      "--gaussians 400 --threads 1 --time-limit 100 --history 3"))
    fail_msg("the run does not start: %s", r.err);
}

// Frame k as it is in the PLY of that instant.
static void check_instant(const sv_sequence_reader *q, uint32_t k, double seq, float mean[3]) {
  char path[100];
  size_t n;
  snprintf(path, sizeof path, "/history.ply?n=%.0f&at=%.4f", seq, (double)k / (q->head.n_frames - 1));
  assert_int_equal(get(path, NULL, again, &n), 200);
  const uint8_t *body = live_run_body(again, n);
  const char *end = strstr((const char *)body, "end_header\n");
  assert_true(end && strstr((const char *)body, "element vertex 400\n"));
  const uint8_t *rows = (const uint8_t *)end + 11;
  const size_t row_bytes = (n - (size_t)(rows - again)) / N; // x y z come first
  for (uint32_t i = 0; i < N; i++) {
    sv_gaussian g;
    float x[3];
    sv_sequence_get(q, i, &g);
    memcpy(x, rows + i * row_bytes, sizeof x);
    assert_memory_equal(x, g.mean, sizeof x);
  }
  memcpy(mean, rows + 7 * row_bytes, 3 * sizeof *mean);
}

static void check_ranges(const uint8_t *file, size_t bytes, double seq) {
  char path[100], line[100];
  size_t n;
  snprintf(path, sizeof path, "/history.svseq?n=%.0f", seq);
  assert_int_equal(get(path, "Range: bytes=48-351\r\n", again, &n), 206);
  snprintf(line, sizeof line, "Content-Range: bytes 48-351/%zu\r\n", bytes);
  assert_non_null(strstr((const char *)again, line));
  assert_memory_equal(live_run_body(again, n), file + 48, 304);
  assert_int_equal(get(path, "Range: bytes=-40\r\n", again, &n), 206);
  assert_memory_equal(live_run_body(again, n), file + bytes - 40, 40);
  snprintf(line, sizeof line, "Range: bytes=%zu-\r\n", bytes);
  assert_int_equal(get(path, line, again, &n), 416);
  assert_int_equal(get("/history.svseq?n=12345", NULL, again, &n), 404);
  assert_int_equal(get("/history.ply?at=2", NULL, again, &n), 400);
  assert_int_equal(get("/history.zip", NULL, again, &n), 404);
}

TEST(a_snapshot_stays) {
  size_t n;
  float first[3], last[3];
  sv_sequence_reader q;
  start();
  wait_for("\"seconds\":", 2);
  assert_int_equal(get("/history.svseq", NULL, answer, &n), 404); // nobody has asked
  const double seq = ask();
  assert_int_equal(get("/history.svseq", NULL, answer, &n), 200);
  const uint8_t *body = live_run_body(answer, n);
  const size_t bytes = n - (size_t)(body - answer);
  uint8_t *file = workspace + sizeof workspace / 2;
  assert_true(bytes <= sizeof workspace / 2);
  memcpy(file, body, bytes);
  assert_ok(sv_sequence_open(&q, &(sv_file_data){"history", file, bytes}, &err), &err);
  assert_true(q.head.n == N && q.head.n_moving == N && q.head.seconds >= 2 && q.head.n_frames > 20);
  assert_true(sv_sequence_reader_bytes(&q.head) <= sizeof workspace / 2);
  assert_ok(sv_sequence_read_base(&q, workspace, &err), &err);
  const uint32_t k_last = q.head.n_frames - 1;
  assert_ok(sv_sequence_read_frame(&q, 0, &err), &err);
  check_instant(&q, 0, seq, first);
  assert_ok(sv_sequence_read_frame(&q, k_last, &err), &err);
  check_instant(&q, k_last, seq, last);
  assert_true(memcmp(first, last, sizeof first) != 0); // it was another model
  check_ranges(file, bytes, seq);
  assert_true(ask() > seq); // the run goes on, and so does the past
  assert_int_equal(get("/history.svseq", NULL, answer, &n), 200);
  assert_true(n < CAP_ANSWER && memcmp(live_run_body(answer, n), file, 400) != 0);
  live_run_stop(&r);
}

static void must(const char *expression, double seconds) {
  if (!browser_wait(&b, expression, seconds)) fail_msg("not in %g s: %s; %s", seconds, expression, r.err);
}

#define IS_DRAWN "!view.is_busy && !view.wants_more && !view.is_dirty"
#define SUM                                                                                                  \
  "(()=>{const p=view.pixels();let s=0;for(let i=0;i<p.length;i++)s=(31*s+p[i])%1000003;return s})()"

TEST(the_slider_goes_back) {
  char why[200];
  if (!browser_program()) skip();
  start();
  if (!browser_open(&b, root, 620, 480, why, sizeof why)) {
    print_message("skip the page's past: Chromium does not start here: %s\n", why);
    skip();
  }
  assert_true(browser_goto(&b, r.link));
  must("page.state && page.state.history.seconds > 2 && view && view.n > 0", 60);
  must("!document.getElementById('past').hidden", 10);
  assert_true(browser_click(&b, "#past"));
  must("page.past && page.past.seq > 0 && view.clip && view.clip.first === 0 && view.clip.seconds > 2", 30);
  must(IS_DRAWN, 30);
  const double now = browser_number(&b, SUM);
  assert_true(browser_number(&b, "($('moment').value=0,$('moment').oninput(),0)") == 0);
  must("view.time === 0 && " IS_DRAWN, 30);
  must(SUM " !== 0", 5);
  const double then = browser_number(&b, SUM);
  assert_true(then != now);
  must("$('get-ply').href.includes('at=0.000') && !$('past-files').hidden", 5);
  must("$('moment-line').textContent.endsWith('s ago')", 5);
  assert_true(browser_click(&b, "#past"));
  must("!page.past && $('get-ply').href.endsWith('/model.ply') && page.model_seq > 0", 30);
  browser_close(&b);
  live_run_stop(&r);
}

FIXTURE(make_root) { return temp_folder_make(root, sizeof root, "past"); }
FIXTURE(clean) {
  browser_close(&b);
  live_run_stop(&r);
  return 0;
}
FIXTURE(remove_root) { return temp_folder_remove(root); }

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test_teardown(a_snapshot_stays, clean),
                                     cmocka_unit_test_teardown(the_slider_goes_back, clean)};
  return cmocka_run_group_tests(tests, make_root, remove_root);
}
