// SPDX-License-Identifier: Apache-2.0
// An earlier scan of a moving scene on the page, in a headless Chromium: its frames are read by
// ranges of the sequence as its time is chosen.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tests/common/browser.h"
#include "tests/common/live_run.h"
#include "tests/common/test.h"

#define RUN                                                                                                  \
  "--source sim:textured,rig=stereo,size=64x48 --exposures 2 --gaussians 300 --threads 1 --session --keep 5"
#define JUMP_MS 150 // the goal; a loaded machine gets four times as long

static char root[256];
static live_run r;
static browser b;
static char text[4000];
static uint8_t answer[65536];

static void must(const char *expression, double seconds) {
  if (!browser_wait(&b, expression, seconds)) fail_msg("not in %g s: %s; %s", seconds, expression, r.err);
}
static void run(const char *script) {
  if (!browser_eval(&b, script, text, sizeof text)) fail_msg("throws: %s", script);
}

static void start(void) {
  char earlier[900];
  snprintf(earlier, sizeof earlier,
           "%s/subview run --source sim:moving,rig=stereo,size=96x72,arc=0 --scene dynamic --exposures 30 "
           "--steps 200 --gaussians 2000 --quiet --out %s/out/0001",
           getenv("SV_BIN") ? getenv("SV_BIN") : "build/sim-x86/bin", root);
  assert_int_equal(system(earlier), 0);
  if (!live_run_start(&r, root, RUN)) fail_msg("the run does not start: %s", r.err);
}

static const char *get(const char *range) {
  live_run_get(&r, "/scan/1/model.svseq", range, answer, sizeof answer);
  return (const char *)answer;
}

// Parts of a file, as RFC 9110 has them.
static void test_ranges(void) {
  assert_contains(get("Range: bytes=0-7\r\n"), "206");
  assert_contains(get("Range: bytes=0-7\r\n"), "SVSECT");
  assert_contains(get("Range: bytes=8-11\r\n"), "Content-Range: bytes 8-11/");
  assert_contains(get("Range: bytes=8-11\r\n"), "\r\n\r\nSEQN");
  assert_contains(get("Range: bytes=-32\r\n"), "\r\n\r\nEND ");
  assert_contains(get("Range: bytes=99999999-\r\n"), "416");
  assert_contains(get("Range: bytes=7-3\r\n"), "200"); // no range
  assert_contains(get("Range: bytes=0-1,4-5\r\n"), "200");
  assert_contains(get("Range: bytes=a-b\r\n"), "200");
}

TEST(test_frames) {
  char why[200];
  start();
  test_ranges();
  if (!browser_program()) {
    print_message("skip the page: no Chromium here (package chromium)\n");
    skip();
  }
  if (!browser_open(&b, root, 900, 700, why, sizeof why)) {
    print_message("skip the page: Chromium does not start here: %s\n", why);
    skip();
  }
  assert_true(browser_goto(&b, r.link));
  must("$('tiles').naturalWidth > 0 && scans.list && scans.list.scans.length === 1", 20);
  run("view_scan(scans.list.scans[0])");
  must("view.n === 2000 && view.clip && view.clip.seconds > 1 && !$('clip').hidden", 20);
  // Each place in time looks different, and the same again.
  run("(async()=>{const look=async(t)=>{view.set_time(t);for(;;){await new Promise((d)=>setTimeout(d,20));"
      "if(!view.is_busy&&!view.wants_more&&!view.is_dirty&&!view.is_moving())break}"
      "const p=view.pixels();let s=0;for(let i=0;i<p.length;i++)s=(s*31+p[i])%1000003;return s};"
      "const s=[];for(const t of [0,0.5,1,0.5])s.push(await look(t));"
      "return s[1]===s[3]&&new Set(s).size===3})()");
  assert_string_equal(text, "true");
  // Jumps into groups that are not there yet.
  run("(async()=>{view.load_sequence('/scan/1/model.svseq');await new Promise((d)=>setTimeout(d,500));"
      "let most=0;for(const t of [0.9,0.1,0.5]){const t0=performance.now();view.set_time(t);"
      "while(view.is_busy||view.wants_more)await new Promise((d)=>setTimeout(d,1));"
      "most=Math.max(most,performance.now()-t0)}return most})()");
  print_message("longest jump in time: %.0f ms\n", strtod(text, NULL));
  if (!(strtod(text, NULL) < 4 * JUMP_MS)) fail_msg("a jump in time takes %s ms", text);
  run("view.play(true)");
  must("view.is_playing && view.time > 0.6", 10);
}

FIXTURE(make_root) { return temp_folder_make(root, sizeof root, "frames"); }
FIXTURE(clean) {
  browser_close(&b);
  live_run_stop(&r);
  return 0;
}
FIXTURE(remove_root) { return temp_folder_remove(root); }

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test_teardown(test_frames, clean)};
  return cmocka_run_group_tests(tests, make_root, remove_root);
}
