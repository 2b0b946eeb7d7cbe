// SPDX-License-Identifier: Apache-2.0
// Every function of the page, clicked in a headless Chromium on a phone, a tablet and a desktop;
// two devices of which one controls; accessibility by axe-core.
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "tests/common/browser.h"
#include "tests/common/live_run.h"
#include "tests/common/test.h"

#define RUN                                                                                                  \
  "--source sim:textured,rig=stereo,size=160x120 --exposures 6 --steps 300 --gaussians 3000 --threads 1 "    \
  "--session --keep 5"
#define NPM    "build/npm"
#define AXE    NPM "/node_modules/axe-core/axe.min.js"
#define KB_CAP 250

static const struct {
  const char *name;
  int width_px, height_px;
  bool is_phone;
} sizes[] = {{"phone", 360, 740, true}, {"tablet", 820, 1180, true}, {"desktop", 1440, 900, false}};
#define N_SIZES 3

static char root[256];
static live_run r;
static browser b, other;
static char text[20000];

static void must(browser *at, const char *expression, double seconds) {
  if (!browser_wait(at, expression, seconds)) fail_msg("not in %g s: %s; %s", seconds, expression, r.err);
}
static void click(const char *selector) {
  if (!browser_click(&b, selector)) fail_msg("%s cannot be clicked", selector);
}
static void run(const char *script) {
  if (!browser_eval(&b, script, text, sizeof text)) fail_msg("throws: %s", script);
}
// Sets a select or a slider as a person does.
static void choose(const char *id, const char *value) {
  char script[300];
  snprintf(script, sizeof script,
           "(()=>{const e=$('%s');e.value='%s';for(const n of ['input','change'])e.dispatchEvent(new "
           "Event(n,{bubbles:true}))})()",
           id, value);
  run(script);
}
// Pictures are kept where the environment variable says, for people to look at.
static void picture(const char *name, int i_size) {
  char path[600];
  const char *keep = getenv("SV_KEEP_PICTURES");
  run("scrollTo(0,0)");
  snprintf(path, sizeof path, "%s/page-%s-%s.jpg", keep ? keep : root, name, sizes[i_size].name);
  assert_true(browser_screenshot(&b, path));
}

static void open_all(void) {
  char why[200];
  if (!browser_program()) {
    print_message("skip the page's functions: no Chromium here (package chromium)\n");
    skip();
  }
  char earlier[900];
  snprintf(
      earlier, sizeof earlier,
      "%s/subview run --source sim:textured,rig=stereo,size=96x72 --exposures 2 --steps 40 --gaussians 3000 "
      "--quiet --out %s/out/0001",
      getenv("SV_BIN") ? getenv("SV_BIN") : "build/sim-x86/bin", root);
  assert_int_equal(system(earlier), 0);
  if (!live_run_start(&r, root, RUN)) fail_msg("the run does not start: %s", r.err);
  if (!browser_open(&b, root, sizes[0].width_px, sizes[0].height_px, why, sizeof why)) {
    live_run_stop(&r);
    print_message("skip the page's functions: Chromium does not start here: %s\n", why);
    skip();
  }
}

// Nothing is wider than the screen: a phone's window would become as wide.
static int width_px;
static void fits(const char *what) {
  run("document.documentElement.scrollWidth");
  if (atoi(text) > width_px) fail_msg("%s: %s pixels wide, the screen %d", what, text, width_px);
}

// --- accessibility -------------------------------------------------------------------------------

static bool has_axe(void) {
  static int has = -1;
  if (has < 0) {
    if (access(AXE, R_OK) != 0)
      has = system("mkdir -p " NPM " && cd " NPM
                   " && timeout 90 npm install --silent --no-audit --no-fund axe-core@4 >/dev/null 2>&1");
    has = access(AXE, R_OK) == 0;
    if (!has) print_message("skip axe-core: npm or the network is not there\n");
  }
  return has > 0;
}

// Phone and desktop have all there is; a tablet has nothing else.
static bool is_tablet;
static void check_axe(const char *what) {
  if (is_tablet || !has_axe()) return;
  assert_true(browser_inject(&b, AXE));
  run("axe.run(document,{resultTypes:['violations']}).then((r)=>r.violations.filter((v)=>['serious',"
      "'critical'].includes(v.impact)).map((v)=>v.id+' '+v.nodes.map((n)=>n.target).join(' ')).join('; '))");
  if (*text) fail_msg("axe-core, %s: %s", what, text);
}

// --- functions -----------------------------------------------------------------------------------

static void test_waiting(int i) {
  fits("waiting");
  must(&b, "[...document.querySelectorAll('#actions button')].filter((e)=>!e.hidden).length===2", 5);
  check_axe("waiting");
  must(&b,
       "!$('budget').hidden && [...document.querySelectorAll('#budget span')].every((e)=>/about [0-9]+ "
       "s/.test(e.textContent))",
       10);
  click("[name=budget][value=draft]");
  must(&b, "page.state.budget === 1", 5);
  click("[name=budget][value=fine]");
  must(&b, "page.state.budget === 2", 5);
  picture("waiting", i);
  click("#labels button"); // a camera in full view
  must(&b, "$('camera').open && $('camera-figures').textContent.includes('Sharpness')", 5);
  check_axe("camera");
  click("#camera-close");
  must(&b, "!$('camera').open", 2);
}

static void test_pages(int i) {
  click("[data-page=settings]");
  must(&b, "$('camera-table').rows.length===3 && $('page-scan').hidden", 5);
  if (i == 0) { // another mode of the cameras, and back
    must(&b, "!$('mode-box').hidden && page.state.modes.includes('320x240@30') && page.state.mode === -1", 5);
    choose("mode", "2");
    must(&b, "page.state.modes[2] === '320x240@30' && page.state.cameras[0].width === 320", 20);
    must(&b, "page.state.state === 'waiting' && page.state.mode === 2", 10);
    choose("mode", "0");
    must(&b, "page.state.cameras[0].width === 160 && page.state.state === 'waiting'", 20);
  }
  fits("settings");
  check_axe("settings");
  choose("preview-quality", "0.35");
  run("view ? view.most : page.quality");
  assert_string_equal(text, "0.35");
  choose("preview-quality", "1");
  picture("settings", i);
  click("[data-page=help]");
  must(&b, "!$('page-help').hidden && $('page-settings').hidden", 2);
  fits("help");
  check_axe("help");
  click("[data-page=scan]");
  must(&b, "!$('page-scan').hidden && $('page-help').hidden", 2);
}

// The list has the scan of this run and one before, which is looked at, downloaded, deleted and
// restored.
static void test_scans(int i) {
  click("[data-page=scans]");
  must(&b, "scans.list && scans.list.scans.length === 2 && $('scan-1').querySelector('img').naturalWidth > 0",
       10);
  must(&b, "/free of/.test($('scans-line').textContent) && !scans.list.scans[0].deleted", 2);
  if (i == 0) { // formats that the device makes on request, at once for all sizes of the page
    must(&b, "$('scan-1').querySelectorAll('a').length === 3", 5);
    click("#scan-1 [aria-label^=\"Make .sog\"]");
    must(&b, "!!$('scan-1').querySelector('a[href$=\"model.sog\"]')", 60);
    click("#scan-1 [aria-label^=\"Make .html\"]");
    click("#scan-1 [aria-label^=\"Make .glb\"]"); // waits for the other
    must(&b, "$('scan-1').querySelectorAll('a').length === 6", 60);
  }
  must(&b,
       "[...$('scan-1').querySelectorAll('a')].length === 6 && "
       "[...$('scan-1').querySelectorAll('a')].every((a)=>/[0-9] [KM]iB$/.test(a.textContent))",
       10);
  fits("scans");
  check_axe("scans");
  picture("scans", i);
  run("(async()=>{const r=[];for(const a of $('scan-1').querySelectorAll('a'))r.push((await (await "
      "fetch(a.href)).arrayBuffer()).byteLength>5000);return r.join()})()");
  assert_string_equal(text, "true,true,true,true,true,true");
  click("#scan-1 [aria-label^=\"Delete\"]");
  must(&b, "!!$('scan-1').querySelector('[aria-label^=Undo]')", 5);
  click("#scan-1 [aria-label^=Undo]");
  must(&b, "!!$('scan-1').querySelector('[aria-label^=View]')", 5);
  click("#scan-1 [aria-label^=View]");
  must(&b, "!$('viewing').hidden && view.n === 3000 && $('get-spz').href.endsWith('/scan/1/model.spz')", 10);
  picture("earlier", i);
  click("#viewing-end");
  must(&b, "$('viewing').hidden && view.n === 3000", 10);
}

static const char settled[] = "!view.is_busy && !view.wants_more && !view.is_dirty && !view.is_moving()";
static const char look[] =
    "(()=>{const p=view.pixels();let s=0;for(let i=0;i<p.length;i+=4)s=(s*31+p[i]+2*p[i+1]+3*p[i+2])%1000003;"
    "return s})()";

static void looks_other(const char *what) {
  static char before[64];
  must(&b, settled, 20);
  run(look);
  if (what && !strcmp(before, text)) fail_msg("%s: the same picture", what);
  snprintf(before, sizeof before, "%.60s", text);
}

static void test_views(int i) {
  click("#home");
  looks_other(NULL);
  choose("show", "depth");
  looks_other("depth");
  picture("depth", i);
  choose("show", "coverage");
  looks_other("coverage");
  picture("coverage", i);
  choose("show", "");
  looks_other("colors");
  run("view.camera.yaw");
  const double yaw = strtod(text, NULL);
  click("#turn");
  snprintf(text, sizeof text, "Math.abs(view.camera.yaw - %g) > 0.05", yaw);
  must(&b, text, 10);
  click("#turn");
  click("#fly");
  run("(()=>{const e=view.frame().eye;view.turn(0.2,0);const f=view.frame().eye;"
      "return Math.hypot(...e.map((v,i)=>v-f[i]))<1e-6})()");
  assert_string_equal(text, "true"); // flying turns about the eye
  run("(()=>{const e=view.frame().eye;$('view').dispatchEvent(new KeyboardEvent('keydown',{key:'w'}));"
      "const f=view.frame().eye;return Math.hypot(...e.map((v,i)=>v-f[i]))>1e-3})()");
  assert_string_equal(text, "true");
  click("#fly");
  click("#home");
  click("#full");
  must(&b, "$('viewer').classList.contains('whole') && $('stage').clientWidth >= innerWidth - 2", 5);
  click("#full");
  must(&b, "!$('viewer').classList.contains('whole')", 5);
}

static void test_measuring(int i) {
  run("$('stage').scrollIntoView({block:'center'})");
  click("#measure");
  must(&b, "$('measured').textContent === 'Tap the first point.'", 2);
  must(&b, settled, 10);
  run("(()=>{const r=$('view').getBoundingClientRect();return r.x+r.width/2+' '+(r.y+r.height/2)})()");
  char *end;
  const double x = strtod(text, &end), y = strtod(end, NULL);
  browser_drag(&b, x - 20, y + 30, x - 20, y + 30, 0);
  must(&b, "$('measured').textContent === 'Tap the second point.'", 10);
  browser_drag(&b, x + 20, y + 30, x + 20, y + 30, 0);
  must(&b, "/^[0-9.]+ \\u00b1 [0-9.]+ (m|mm)$/.test($('measured').textContent)", 10);
  picture("measure", i);
  click("#measure");
  must(&b, "$('measured').hidden", 2);
  click("#box");
  must(&b, "/^Width [0-9.]+ m, depth [0-9.]+ m, height [0-9.]+ m$/.test($('box-line').textContent)", 10);
  looks_other(NULL);
  click("#box-crop");
  choose("side-right", "500");
  looks_other("crop");
  picture("box", i);
  check_axe("box");
  click("#box-ply");
  must(&b, "tools.downloaded && tools.downloaded.name === 'subview-part.ply'", 10);
  run("(async()=>{const t=await (await fetch('/model.ply')).arrayBuffer();"
      "return tools.downloaded.bytes > 2000 && tools.downloaded.bytes < t.byteLength - 2000})()");
  assert_string_equal(text, "true");
  click("#box-crop");
  looks_other("all again");
  click("#box");
  must(&b, "$('box-panel').hidden && !view.box", 2);
}

static void test_pictures(int i) {
  click("#before");
  must(&b, "!$('compare').hidden && $('both').width > 50", 5);
  choose("edge", "250");
  picture("before-after", i);
  click("#before");
  must(&b, "$('compare').hidden", 2);
  click("#shot");
  must(&b, "tools.downloaded.name === 'subview.png' && tools.downloaded.bytes > 2000", 10);
  run("(view.turn(0.5,0.1),0)");
  click("#share");
  must(&b, "tools.link && tools.link.includes('/?view=') && !tools.link.includes(page.token)", 5);
  must(&b, "[...document.querySelectorAll('[data-size]')].every((e)=>/[0-9] [KM]iB/.test(e.textContent))",
       15);
  click("#details > summary");
  must(&b, "$('details').open && $('ledger').rows.length===3", 2);
  fits("details");
  check_axe("details");
  click("#details > summary");
}

static void open_other(const char *link) {
  char why[200], folder[300];
  snprintf(folder, sizeof folder, "%s/other", root);
  mkdir(folder, 0700);
  if (!browser_open(&other, folder, 360, 740, why, sizeof why)) fail_msg("%s", why);
  assert_true(browser_goto(&other, link));
}

// A second device watches: what it presses has no effect, until it is given control.
static void test_second_device(void) {
  open_other(r.link);
  must(&other, "page.seat > 0 && page.state && !$('control').hidden && !$('ask').hidden", 20);
  must(&other, "['start','pause','save','new'].every((id)=>$(id).disabled)", 5);
  // Not by another way either
  assert_true(
      browser_eval(&other, "Promise.all(['start','pause','save','new'].map(ask))", text, sizeof text));
  must(&other, "$('notice').textContent.includes('another device controls')", 5);
  poll(NULL, 0, 500);
  must(&b, "page.state.state === 'waiting' && page.state.saves === 0", 1);
  if (!browser_click(&other, "#ask")) fail_msg("#ask cannot be clicked");
  must(&b, "!$('give').hidden && !$('keep').hidden", 5);
  click("#keep");
  must(&other, "!$('ask').disabled", 5);
  if (!browser_click(&other, "#ask")) fail_msg("#ask cannot be clicked");
  must(&b, "!$('give').hidden", 5);
  check_axe("asked for control");
  picture("control", 0);
  click("#give");
  must(&other, "!$('start').disabled && $('control').hidden", 5);
  must(&b, "$('start').disabled && !$('ask').hidden", 5);
  if (!browser_click(&other, "[name=budget][value=fine]")) fail_msg("the budget cannot be chosen");
  must(&other, "page.state.budget === 2", 5);
  if (!browser_click(&other, "#start")) fail_msg("the second device cannot start");
  must(&b, "page.state.state === 'training' || page.state.state === 'done'", 30);
  click("#ask");
  must(&other, "!$('give').hidden", 5);
  if (!browser_click(&other, "#give")) fail_msg("#give cannot be clicked");
  must(&b, "$('control').hidden && page.state.control.by === page.seat", 5);
  browser_close(&other);
}

// A link to a view shows that view on another device, and controls nothing.
static void test_link(void) {
  char link[700], place[200];
  run("tools.link");
  snprintf(link, sizeof link, "%.690s", text);
  run("new URL(tools.link).searchParams.get('view')");
  snprintf(place, sizeof place, "%.190s", text);
  open_other(link);
  must(&other, "view && view.n > 0 && !!view.camera", 20);
  assert_true(browser_eval(&other, "view.place()", text, sizeof text));
  assert_string_equal(text, place);
  must(&other, "page.seat === 0 && ['start','pause','save','new'].every((id)=>$(id).disabled)", 5);
  must(&other, "$('notice').textContent.startsWith('View only')", 5);
  browser_close(&other);
}

TEST(test_functions) {
  open_all();
  assert_true(browser_goto(&b, r.link));
  must(&b, "$('tiles').naturalWidth > 0 && !$('start').disabled && page.state.cameras[0].fps > 1", 20);
  run("performance.getEntriesByType('resource').concat(performance.getEntriesByType('navigation'))"
      ".filter((e)=>!/cameras|stream/.test(e.name)).reduce((s,e)=>s+e.decodedBodySize,0)/1000");
  print_message("the page: %s kB\n", text);
  assert_true(strtod(text, NULL) > 30 && strtod(text, NULL) < KB_CAP);
  for (int i = 0; i < N_SIZES; i++) {
    assert_true(browser_size(&b, sizes[i].width_px, sizes[i].height_px, sizes[i].is_phone));
    is_tablet = i == 1;
    width_px = sizes[i].width_px;
    test_waiting(i);
    test_pages(i);
  }
  assert_true(browser_size(&b, sizes[0].width_px, sizes[0].height_px, sizes[0].is_phone));
  test_second_device();
  must(&b,
       "page.state.state === 'done' && page.state.step === 900 && view.n === 3000 && !$('picture').hidden",
       60);
  for (int i = 0; i < N_SIZES; i++) {
    assert_true(browser_size(&b, sizes[i].width_px, sizes[i].height_px, sizes[i].is_phone));
    is_tablet = i == 1;
    width_px = sizes[i].width_px;
    fits("done");
    run("document.documentElement.classList.add('light')");
    check_axe("light");
    run("document.documentElement.classList.remove('light')");
    check_axe("dark");
    test_views(i);
    picture("done", i);
    test_measuring(i);
    test_pictures(i);
    test_scans(i);
  }
  test_link();
}

FIXTURE(make_root) { return temp_folder_make(root, sizeof root, "tools"); }
FIXTURE(clean) {
  browser_close(&b);
  browser_close(&other);
  live_run_stop(&r);
  return 0;
}
FIXTURE(remove_root) { return temp_folder_remove(root); }

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test_teardown(test_functions, clean)};
  return cmocka_run_group_tests(tests, make_root, remove_root);
}
