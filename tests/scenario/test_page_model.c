// SPDX-License-Identifier: Apache-2.0
// What the page draws against what the runtime's renderer draws of the saved model: shape, SH of
// degree 2, motion, times; by WebGL2 and by the page's own rasterizer.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/base/mathx.h"
#include "src/rig/rig.h"
#include "tests/common/browser.h"
#include "tests/common/live_run.h"
#include "tests/common/test.h"
#include "tools/train/evaluate.h"
#include "tools/lab/lab.h"
#include "tools/lab/export_html.h"
#include "tools/lab/model_formats.h"

#define STEP    6   // every sixth pixel each way is compared
#define CAP_W   900 // of the drawn picture
#define LIMIT   1.0 // mean difference in 1/255: 8-bit colours and blending, SH in 8 bits
#define MOVES   0.2 // two times of the same view are at least so far apart
#define CAP_OUT 400000

static char root[256];
static live_run r;
static browser b;
static lab_session session;
static lab_model model;
static lab_viewer viewer;
static char text[CAP_OUT];

static bool skipped(void) {
  if (!browser_program()) {
    print_message("skip the page's model: no Chromium here (package chromium)\n");
    return true;
  }
  return false;
}

static void open_browser(void) {
  char why[200];
  if (browser_open(&b, root, 620, 480, why, sizeof why)) return;
  live_run_stop(&r);
  print_message("skip the page's model: Chromium does not start here: %s\n", why);
  skip();
}

static void must(const char *expression, double seconds) {
  if (!browser_wait(&b, expression, seconds)) fail_msg("not in %g s: %s; %s", seconds, expression, r.err);
}

// The camera that the page has, as the runtime's: "eye 3, target 3, up 3, focal, width, height".
static sv_view view_of_page(void) {
  double v[12], eye[3], at[3], up[3];
  assert_true(
      browser_eval(&b,
                   "(()=>{const f=view.frame(),s=view.size(),c=view.camera;return [...f.eye,...c.target,"
                   "...c.up,s.focal,s.width,s.height].join(' ')})()",
                   text, sizeof text));
  char *p = text;
  for (int i = 0; i < 12; i++) v[i] = strtod(p, &p);
  for (int k = 0; k < 3; k++) {
    eye[k] = v[k];
    at[k] = v[3 + k];
    up[k] = v[6 + k];
  }
  sv_pose pose;
  assert_true(sv_pose_look_at(&pose, eye, at, up));
  assert_true(v[10] <= CAP_W && v[11] <= CAP_W);
  return sv_view_make((int)v[10], (int)v[11], (const double[]){v[9], v[9], v[10] / 2, v[11] / 2}, &pose);
}

// Samples of the page's picture, rows from above.
static int page_pixels(uint8_t *rgb) {
  char script[500];
  snprintf(script, sizeof script,
           "(()=>{const p=view.pixels(),w=view.canvas.width,h=view.canvas.height,o=[];for(let y=0;y<h;y+=%d)"
           "for(let x=0;x<w;x+=%d){const i=4*((view.plane?y:h-1-y)*w+x);o.push(p[i],p[i+1],p[i+2])}"
           "return o.join(' ')})()",
           STEP, STEP);
  assert_true(browser_eval(&b, script, text, sizeof text));
  int n = 0;
  for (char *p = text, *end; *p; p = end) {
    rgb[n++] = (uint8_t)strtol(p, &end, 10);
    if (end == p) break;
  }
  return n;
}

static double difference(const uint8_t *a, const uint8_t *c, int n) {
  double sum = 0;
  for (int i = 0; i < n; i++) sum += fabs((double)a[i] - (double)c[i]) / n;
  return sum;
}

static int render(const sv_view *v, float time, uint8_t *rgb) {
  lab_settings st = lab_settings_default();
  st.is_antialiased = model.is_mip;
  st.dilation_px2 = model.dilation_px2;
  st.near_z = 0.05f;
  sv_render_options o = lab_render_options(&st, model.g.sh_degree, false);
  if (model.deform.kind)
    sv_deform_at(&model.deform, &(sv_compute){&session.k, &session.pool}, &model.g, time);
  assert_int_equal(sv_render(&viewer.r, &model.g, v, &o), SV_OK);
  const sv_planes *p = &viewer.r.rgb;
  int n = 0;
  for (int y = 0; y < v->height_px; y += STEP)
    for (int x = 0; x < v->width_px; x += STEP)
      for (int k = 0; k < 3; k++)
        rgb[n++] = (uint8_t)(sv_clampf(p->c[k][(long)y * p->stride + x], 0, 1) * 255 + 0.5f);
  return n;
}

static int compare(const char *how, double time, uint8_t *page) {
  static uint8_t ours[CAP_W * CAP_W];
  char script[160];
  snprintf(script, sizeof script, "(view.set_time(%g),view.touch(),0)", time);
  browser_number(&b, script);
  must("!view.is_busy && !view.wants_more && !view.is_dirty && !view.is_moving() && view.scale === 1", 30);
  sv_view v = view_of_page();
  int n = page_pixels(page);
  assert_int_equal(render(&v, (float)time, ours), n);
  double d = difference(page, ours, n), lit = 0;
  for (int i = 0; i < n; i++) lit += ours[i] / (double)n;
  print_message("%s, time %.2f: %.2f of 255 from the runtime's picture (mean brightness %.1f)\n", how, time,
                d, lit);
  assert_true(lit > 5);
  assert_true(d < LIMIT);
  return n;
}

// Depth of the surface at places of the page's view, in which one measures, against that of the
// runtime's renderer.
static void compare_depth(void) {
  static float depth[CAP_W * CAP_W];
  sv_view v = view_of_page();
  char script[160];
  int n = 0;
  double sum = 0;
  lab_settings st = lab_settings_default();
  st.is_antialiased = model.is_mip;
  st.dilation_px2 = model.dilation_px2;
  st.near_z = 0.05f;
  const sv_render_options o = lab_render_options(&st, model.g.sh_degree, false);
  assert_int_equal(sv_render(&viewer.r, &model.g, &v, &o), SV_OK);
  sv_render_surface(&viewer.r, &model.g, &v, sv_surface_slab, depth);
  for (int y = 5; y < 10; y++)
    for (int x = 5; x < 10; x++) {
      const int px = x * v.width_px / 15, py = y * v.height_px / 15;
      const double ours = (double)depth[(long)py * viewer.r.rgb.stride + px];
      snprintf(script, sizeof script, "view.pick(%d.5,%d.5).then((p)=>p?p.depth:0)", px, py);
      const double page = browser_number(&b, script);
      if (!(ours > 0) || !(page > 0)) continue;
      sum += fabs(page - ours) / ours;
      n++;
    }
  print_message("depth: %.3f %% from the runtime's in the mean of %d places\n", 100 * sum / n, n);
  assert_true(n > 5);
  assert_true(sum / n < 0.003);
}

static void open_model(void) {
  sv_err err;
  char path[400];
  snprintf(path, sizeof path, "%s/out/model.ply", root);
  assert_ok(lab_session_start(&session, 1, true, &err), &err);
  assert_ok(lab_model_read(&model, path, &err), &err);
  if (lab_viewer_start(&viewer, &session,
                       (sv_renderer_cfg){.cap_gaussians = model.g.cap,
                                         .cap_width_px = CAP_W,
                                         .cap_height_px = CAP_W,
                                         .cap_pixels = sv_plane_floats(CAP_W, CAP_W)},
                       &err) < 0)
    fail_msg("%s", err.text);
}

static void close_model(void) {
  lab_viewer_stop(&viewer);
  lab_model_free(&model);
  lab_session_stop(&session);
}

static void look(const char *draw, bool is_moving) {
  static uint8_t first[CAP_W * CAP_W], second[CAP_W * CAP_W];
  char url[400];
  snprintf(url, sizeof url, "http://127.0.0.1:%d/?draw=%s#%s", r.port, draw, r.token);
  assert_true(browser_goto(&b, url));
  must("view && view.n > 0 && view.drawn > 0", 60);
  must(!strcmp(draw, "gl") ? "!!view.graphics" : "!!view.plane", 1);
  must(is_moving ? "view.clip && !$('clip').hidden" : "!view.clip && $('clip').hidden", 5);
  compare(draw, 0.1, first);
  if (!is_moving) return;
  assert_true(model.deform.motion.bodies.n > 1); // the scene's parts go as rigid bodies
  int n = compare(draw, 0.8, second);
  assert_true(difference(first, second, n) > MOVES);
  // It plays: time goes on by itself, and stops.
  browser_number(&b, "($('play').click(),0)");
  must("view.is_playing && Math.abs(view.time - 0.8) > 0.05", 20);
  browser_number(&b, "(($('moment').value = 250), $('moment').oninput(),0)");
  must("!view.is_playing && view.time === 0.25 && $('moment-line').textContent.includes(' of ')", 5);
}

static void must_download(const char *url, const char *path) {
  static uint8_t answer[2u << 20];
  void *file;
  size_t bytes;
  sv_err err;
  size_t n = live_run_get(&r, url, NULL, answer, sizeof answer);
  const uint8_t *body = live_run_body(answer, n);
  assert_ok(sv_file_read(path, &file, &bytes, &err), &err);
  assert_non_null(body);
  assert_int_equal(n - (size_t)(body - answer), bytes);
  assert_memory_equal(body, file, bytes);
  free(file);
}

// What the page hands out is, byte by byte, what the run has saved, and what the host tool exports
// from that: the simulator's worlds have z up, so SPZ is turned.
static void check_downloads(void) {
  char path[400];
  sv_err err;
  assert_string_equal(model.up, "z");
  snprintf(path, sizeof path, "%s/out/model.ply", root);
  must_download("/model.ply", path);
  snprintf(path, sizeof path, "%s/model.spz", root);
  const sv_model_notes notes = lab_model_notes(&model);
  assert_int_equal(lab_write_spz(&model.g, &notes, 3, path, &err), SV_OK);
  must_download("/model.spz", path);
  snprintf(path, sizeof path, "%s/model.splat", root);
  assert_int_equal(lab_write_splat(&model.g, path, &err), SV_OK);
  must_download("/model.splat", path);
}

// The exported page, from disk: no server, no network.
static void look_at_file(void) {
  static uint8_t first[CAP_W * CAP_W];
  char path[400], url[420];
  sv_err err;
  const lab_settings st = {.radius = 1.2f, .dilation_px2 = model.dilation_px2};
  snprintf(path, sizeof path, "%s/model.html", root);
  assert_ok(lab_write_html(&model, &st, path, &err), &err);
  snprintf(url, sizeof url, "file://%s", path);
  assert_true(browser_goto(&b, url));
  must("view && view.n > 0 && view.drawn > 0", 60);
  compare("file", 1, first);
  const char *keep = getenv("SV_KEEP_PICTURES");
  snprintf(path, sizeof path, "%s/viewer.png", keep ? keep : root);
  assert_true(browser_screenshot(&b, path));
}

static void run_and_look(const char *args, bool is_moving) {
  if (skipped()) skip();
  if (!live_run_start(&r, root, args)) fail_msg("the run does not start: %s", r.err);
  char headers[128];
  static uint8_t answer[1u << 16];
  snprintf(headers, sizeof headers, "X-Subview-Token: %s\r\n", r.token);
  live_run_request(&r, "POST", "/start", headers, answer, sizeof answer);
  open_browser();
  assert_true(browser_goto(&b, r.link));
  must("page.state && page.state.state === 'done'", 120);
  open_model();
  check_downloads();
  look("flat", is_moving);
  look("gl", is_moving);
  if (!is_moving) look_at_file();
  if (!is_moving) compare_depth();
  close_model();
}

TEST(test_still) {
  run_and_look(
      "--source sim:textured,rig=stereo,size=160x120 --exposures 4 --steps 250 --gaussians 2500 --sh 2 "
      "--session",
      false);
}

TEST(test_moving) {
  run_and_look("--source sim:moving,rig=stereo,arc=0,size=160x120 --scene dynamic --exposures 12 --steps 300 "
               "--gaussians 2500 --sh 1 --session",
               true);
}

FIXTURE(make_root) { return temp_folder_make(root, sizeof root, "model"); }
FIXTURE(clean) {
  browser_close(&b);
  live_run_stop(&r);
  return 0;
}
FIXTURE(remove_root) { return temp_folder_remove(root); }

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test_teardown(test_still, clean),
      cmocka_unit_test_teardown(test_moving, clean),
  };
  return cmocka_run_group_tests(tests, make_root, remove_root);
}
