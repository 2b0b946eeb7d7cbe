// SPDX-License-Identifier: Apache-2.0
// The page of a running simulator in a headless Chromium: what the person in front of the rig sees
// and does.
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "src/format/ply.h"
#include "tests/common/browser.h"
#include "tests/common/live_run.h"
#include "tests/common/test.h"

#define GAUSSIANS 20000
#if defined(__SANITIZE_ADDRESS__)
#define STEPS 600 // a sixth of the speed
#else
#define STEPS 2000
#endif

static char root[256];
static live_run r;
static browser b;

static double now_s(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

// Pictures are kept where the environment variable says, for people to look at.
static void picture(const char *name) {
  char path[600];
  const char *keep = getenv("SV_KEEP_PICTURES");
  snprintf(path, sizeof path, "%s/%s.png", keep ? keep : root, name);
  assert_true(browser_screenshot(&b, path));
  struct stat st;
  assert_int_equal(stat(path, &st), 0);
  assert_true(st.st_size > 10000);
}

static bool skipped(void) {
  if (!browser_program()) {
    print_message("skip the page: no Chromium here (package chromium)\n");
    return true;
  }
  return false;
}

// A machine may have the program and still not let it run (sandboxes): that is as good as not
// having it.
static void open_browser(int w, int h) {
  char why[200];
  if (browser_open(&b, root, w, h, why, sizeof why)) return;
  live_run_stop(&r);
  print_message("skip the page: Chromium does not start here: %s\n", why);
  skip();
}

#define MUST(expression, seconds)                                                                            \
  do {                                                                                                       \
    if (!browser_wait(&b, expression, seconds))                                                              \
      fail_msg("not in %d s: %s; %s", (int)(seconds), expression, r.err);                                    \
  } while (0)

static void watch_and_start(void) {
  double opened = now_s();
  assert_true(browser_goto(&b, r.link));
  MUST("document.querySelector('#tiles').naturalWidth > 0", 20);
  print_message("first tile after %.2f s, %.2f s of the page's own\n", now_s() - opened,
                browser_number(&b, "performance.now() / 1000"));
  MUST("$('state').textContent === 'waiting' && !$('start').disabled", 10);
  // The tiles move: the mosaic's pixels and the counters change.
  double n = browser_number(&b, "page.state.cameras[0].tiles");
  MUST("page.state.cameras[0].fps > 1", 20);
  char text[96];
  snprintf(text, sizeof text, "page.state.cameras.every((c) => c.tiles > %g)", n + 5);
  MUST(text, 20);
  picture("page-waiting");
  // A camera in full view comes in its own size, not in that of its thumbnail.
  assert_true(browser_click(&b, "#labels button"));
  MUST("$('camera').open && $('camera-image').width === 320 && $('camera-image').height === 240", 10);
  MUST("$('camera-figures').textContent.includes('Sharpness')", 5);
  assert_true(browser_click(&b, "#camera-close"));
  double started = now_s();
  assert_true(browser_eval(&b, "$('start').click()", (char[8]){0}, 8));
  MUST("view.n > 0 && view.drawn > 0", 60);
  print_message("first model %.2f s after Start\n", now_s() - started);
}

// Pause is pressed by the page itself as soon as the PSNR has risen, with a curve and a picture to
// see: a fast machine is done soon after.
static void watch_training(void) {
  // The dome and its sentence.
  MUST("page.state.guidance.good > 0 && page.state.guidance.coverage > 0 && !$('guide-box').hidden", 20);
  MUST("$('dome').getContext('2d').getImageData($('dome').width / 2, $('dome').height * 0.92, 1, 1).data[3] "
       "> 0",
       20);
  MUST("$('dome').getAttribute('aria-label').includes('% covered') && "
       "$('guide-line').textContent.includes('good of')",
       20);
  MUST("page.state.psnr > 0", 60);
  assert_true(browser_eval(&b,
                           "(()=>{const p=page.state.psnr;window.watch=setInterval(()=>{"
                           "if(page.state.psnr>p+2&&page.points.length>2&&!$('picture').hidden)"
                           "{clearInterval(watch);$('pause').click()}},10)})()",
                           (char[16]){0}, 16));
  MUST("$('state').textContent === 'paused'", 90);
  assert_int_equal((int)browser_number(&b, "view.n"), GAUSSIANS);
}

// The drawn model's pixels change when it is turned; the share that is not empty.
static const char coverage[] =
    "(async()=>{while(view.is_busy||view.is_dirty||view.is_moving())await new Promise((f)=>setTimeout(f,50));"
    "const p=view.pixels();let n=0,s=0;for(let i=0;i<p.length;i+=4){const v=p[i]+p[i+1]+p[i+2];if(v>60)n++;"
    "s=(s*31+v)%1000003;}return (4*n/p.length).toFixed(6)+' '+s})()";

static void turn_it(void) {
  char before[64], after[64];
  assert_true(browser_eval(&b, coverage, before, sizeof before));
  assert_true(strtod(before, NULL) > 0.05);
  double yaw = browser_number(&b, "view.camera.yaw");
  assert_true(browser_drag(&b, 200, 300, 520, 330, 8));
  assert_true(fabs(browser_number(&b, "view.camera.yaw") - yaw) > 0.3);
  assert_true(browser_eval(&b, coverage, after, sizeof after));
  assert_true(strtod(after, NULL) > 0.05);
  assert_string_not_equal(before, after);
  double distance = browser_number(&b, "view.camera.distance");
  browser_number(&b, "view.zoom(0.8)");
  assert_true(browser_number(&b, "view.camera.distance") < distance);
  browser_number(&b, "view.reset()");
}

// A runtime that is stopped does nothing any more, whatever its last state was.
static void stop_it(void) {
  char text[96];
  assert_int_equal(kill(r.pid, SIGSTOP), 0);
  MUST("/^stale since [0-9]+ s$/.test($('state').textContent)", 15);
  assert_true(browser_eval(&b, "$('notice').textContent", text, sizeof text));
  assert_contains(text, "thread of subview makes no progress");
  MUST("['start', 'pause', 'save', 'new'].every((id) => $(id).disabled)", 5);
  picture("page-stale");
  assert_true(browser_size(&b, 390, 844, true));
  poll(NULL, 0, 600);
  picture("page-stale-phone");
  assert_true(browser_size(&b, 1180, 760, false));
  assert_int_equal(kill(r.pid, SIGCONT), 0);
  MUST("$('state').textContent === 'paused' && $('notice').hidden", 10);
}

static void measure_rate(void) {
  // The rate of a steady turn, once the number of pixels has settled.
  double fps = browser_number(
      &b, "new Promise((done)=>{let m=0,u=0;const t0=performance.now();"
          "const go=()=>{view.turn(0.02,0);const t=performance.now()-t0;if(t>3000&&!u){m=view.frames;u=t}"
          "if(t>6000)done(1000*(view.frames-m)/(t-u));else requestAnimationFrame(go)};go()})");
  print_message(
      "turning: %.1f pictures a second (no graphics processor, %d Gaussians, %.0f %% of the pixels a "
      "side)\n",
      fps, GAUSSIANS, 100 * browser_number(&b, "view.quality"));
  assert_true(fps > 0); // a busy machine without a GPU; what it reaches is printed
}

static void save_download(void) {
  char text[96], head[300];
  double step = browser_number(&b, "page.state.step");
  poll(NULL, 0, 700);
  assert_true(browser_number(&b, "page.state.step") == step);
  picture("page-training");
  assert_true(browser_eval(&b, "$('save').click()", text, sizeof text));
  MUST("page.state.saves === 1 && page.state.state === 'paused'", 20);
  snprintf(head, sizeof head, "%s/out/model.ply", root);
  assert_int_equal(access(head, R_OK), 0);
  // The download, byte by byte the header of a PLY; the whole file is read back below.
  assert_true(browser_eval(&b, "(async()=>(await (await fetch($('get-ply').href)).text()).slice(0,3))()",
                           text, sizeof text));
  assert_string_equal(text, "ply");
  assert_true(browser_eval(&b, "$('start').click()", text, sizeof text)); // "Go on"
  snprintf(text, sizeof text, "page.state.step > %g || page.state.state === 'done'", step);
  MUST(text, 30);
}

static void read_download(void) {
  static uint8_t file[GAUSSIANS * 140];
  size_t n = live_run_get(&r, "/model.ply", NULL, file, sizeof file);
  const uint8_t *body = live_run_body(file, n);
  assert_int_equal(live_run_code(file), 200);
  assert_non_null(body);
  sv_ply ply;
  sv_err err;
  assert_ok(sv_ply_open(&ply, "download", body, n - (size_t)(body - file), &err), &err);
  assert_int_equal(ply.n, GAUSSIANS);
  assert_int_equal(ply.kind, SV_PLY_GAUSSIANS);
  sv_gaussian g;
  for (uint32_t i = 0; i < ply.n; i++) assert_int_equal(sv_ply_read_gaussian(&ply, i, &g, &err), SV_OK);
}

static void test_page(void **state) {
  (void)state;
  char text[64], args[256];
  if (skipped()) skip();
  snprintf(args, sizeof args,
           "--source sim:textured,rig=stereo --exposures 4 --steps %d --gaussians %d --session", STEPS,
           GAUSSIANS);
  if (!live_run_start(&r, root, args)) fail_msg("the run does not start: %s", r.err);
  open_browser(1180, 760);
  watch_and_start();
  watch_training();
  stop_it();
  turn_it();
  save_download();
  read_download();
  MUST("$('state').textContent === 'done'", 180);
  MUST("$('new').disabled === false", 5);
  measure_rate();
  assert_true(browser_size(&b, 390, 844, true));
  poll(NULL, 0, 600);
  picture("page-phone");
  // New asks twice, then the cameras are live again.
  assert_true(browser_eval(&b, "$('new').click()", text, sizeof text));
  assert_true(browser_eval(&b, "$('new').textContent", text, sizeof text));
  assert_string_equal(text, "Discard?");
  assert_true(browser_eval(&b, "$('new').click()", text, sizeof text));
  MUST("$('state').textContent === 'waiting' && view.n === 0", 20);
  browser_close(&b);
  assert_int_equal(live_run_stop(&r), 1); // stopped before anything was captured
}

// A rig that is not there: the page says what is missing, and New tries again.
TEST(test_failed) {
  if (skipped()) skip();
  if (!live_run_start(&r, root, "--source replay:@/nowhere --session"))
    fail_msg("the run does not start: %s", r.err);
  open_browser(900, 600);
  assert_true(browser_goto(&b, r.link));
  MUST("$('message-title').textContent === 'No camera' && $('message-text').textContent.includes('nowhere')",
       20);
  picture("page-no-camera");
  browser_close(&b);
  live_run_stop(&r);
}

// Over the network: the page gets its cookie from the server, no script reads it, and a server that
// was started again gives a new one.
TEST(test_private_page) {
  char text[96];
  if (skipped()) skip();
  r.is_open = true;
  bool is_started = live_run_start(&r, root, "--source sim:textured,rig=stereo --exposures 4 --session");
  r.is_open = false;
  if (!is_started) fail_msg("the run does not start: %s", r.err);
  open_browser(900, 600);
  assert_true(browser_goto(&b, r.link));
  MUST("document.querySelector('#tiles').naturalWidth > 0 && $('state').textContent === 'waiting'", 20);
  assert_true(browser_eval(&b, "document.cookie", text, sizeof text));
  assert_string_equal(text, "");
  assert_int_equal(kill(live_run_server(&r), SIGKILL), 0);
  MUST("$('state').textContent === 'not connected'", 10);
  MUST("$('state').textContent === 'waiting'", 20);
  browser_close(&b);
  live_run_stop(&r);
}

FIXTURE(make_root) { return temp_folder_make(root, sizeof root, "page"); }
FIXTURE(clean) {
  browser_close(&b);
  if (r.pid > 0) kill(r.pid, SIGCONT);
  live_run_stop(&r);
  return 0;
}
FIXTURE(remove_root) { return temp_folder_remove(root); }

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test_teardown(test_page, clean),
      cmocka_unit_test_teardown(test_failed, clean),
      cmocka_unit_test_teardown(test_private_page, clean),
  };
  return cmocka_run_group_tests(tests, make_root, remove_root);
}
