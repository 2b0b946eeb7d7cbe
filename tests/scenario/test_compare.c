// SPDX-License-Identifier: Apache-2.0
// Pictures for people, by the host tool as a user runs it: the sheet of `compare`, the animated
// WebP of `render --orbit`, and the dataset that the demo makes both of.
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tests/common/lab_shell.h"
#include "tests/common/test.h"
#include "tools/common/fileio.h"
#include "tools/common/imageio.h"
#include "tools/pictures/animation.h"
#include "tools/pictures/sheet.h"

#if defined(__has_include) && __has_include(<webp/demux.h>)
#include <webp/demux.h>
#define HAS_DEMUX 1
#else
#define HAS_DEMUX 0
#endif

#define W    64
#define H    48
#define GAP  4
#define SIZE "size=64x48"

static lab_shell shell = {.cwd = ""};

static int run(const char *line) { return lab_shell_run(&shell, line); }
static void run_well(const char *line) { lab_shell_run_well(&shell, line); }

FIXTURE(setup) {
  int code = lab_shell_open(&shell, "compare");
  if (code != 0) return code < 0 ? code : 0;
  shell.is_ready = run("@ import --from sim textured," SIZE ",rig=stereo,exposures=2 --out s --quiet && "
                       "@ train --data s --gaussians 200 --steps 40 --out a --quiet && "
                       "@ train --data s --gaussians 60 --steps 4 --out b --quiet") == 0;
  if (!shell.is_ready) fprintf(stderr, "%s", shell.said);
  return shell.is_ready ? 0 : -1;
}

FIXTURE(teardown) { return lab_shell_close(&shell); }

static sv_bitmap picture(const char *name) {
  char path[600];
  sv_err err = {0};
  sv_bitmap b;
  snprintf(path, sizeof path, "%s/%s", shell.root, name);
  assert_ok(sv_bitmap_read(path, &b, &err), &err);
  return b;
}

// The number behind the last `key` of what was said.
static double number_behind(const char *key) {
  const char *p = NULL;
  for (const char *q = shell.said; (q = strstr(q, key)); q += strlen(key)) p = q + strlen(key);
  if (!p) fail_msg("'%s' is not in: %s", key, shell.said);
  return strtod(p, NULL);
}

// A sheet of views r_002 and r_006 of eight, with models a and b.
static void make_sheet(void) {
  run_well("@ compare --data s --model a/model.ply b/model.ply --labels first,second --views 2 "
           "--out c/sheet.png");
}

TEST(test_layout) {
  lab_shell_need(&shell);
  make_sheet();
  sv_bitmap sheet = picture("c/sheet.png"), truth = picture("s/test/r_006.png");
  int head = lab_sheet_has_text() ? 2 * LAB_SHEET_TEXT_PX + 1 : 0;
  assert_int_equal(sheet.width_px, 3 * W + 2 * GAP);
  assert_int_equal(sheet.height_px, head + 2 * H + GAP);
  for (int y = 0; y < H / 2; y++) // the lower half has the view's name
    assert_memory_equal(sheet.u8 + 3 * (size_t)(head + H + GAP + y) * (size_t)sheet.width_px,
                        truth.u8 + 3 * (size_t)y * W, 3 * W);
  int n_ink = 0;
  for (size_t i = 0; i < (size_t)head * (size_t)sheet.width_px; i++)
    n_ink += sheet.u8[3 * i] != LAB_SHEET_PAPER;
  assert_int_equal(n_ink > 100, lab_sheet_has_text());
  sv_bitmap_free(&sheet);
  sv_bitmap_free(&truth);
}

// The figures are those of eval, of each view and of the split.
TEST(test_psnr) {
  double of_view[2], mean[2];
  lab_shell_need(&shell);
  make_sheet();
  assert_contains(shell.said, "first");
  for (int i = 0; i < 2; i++) { // "r_006  A  B"
    char *p = strstr(shell.said, i ? "mean of 8 views" : "r_006"), *end;
    assert_non_null(p);
    double *to = i ? mean : of_view;
    to[0] = strtod(p + strlen(i ? "mean of 8 views" : "r_006"), &end);
    to[1] = strtod(end, NULL);
  }
  for (int i = 0; i < 2; i++) {
    run_well(i ? "@ eval --data s --model b/model.ply" : "@ eval --data s --model a/model.ply");
    assert_true(fabs(number_behind("PSNR ") - mean[i]) < 0.011);
    assert_true(fabs(number_behind("r_006 ") - of_view[i]) < 0.011);
  }
  run_well("@ eval --data s --model b/model.ply --json --quiet");
  assert_true(fabs(number_behind("\"view\": \"r_006\", \"psnr\": ") - of_view[1]) < 0.011);
}

// Without --labels a model.ply is called by its folder; more rows than views are all views.
TEST(test_defaults) {
  lab_shell_need(&shell);
  run_well("@ compare --data s --model a/model.ply --views 50 --split train --out all.png");
  assert_contains(shell.said, " a\n");
  assert_contains(shell.said, "mean of 4 views");
}

static void refuses(const char *line, int code, const char *sentence) {
  int got = run(line);
  if (got != code || !strstr(shell.said, sentence)) fail_msg("%s: %d: %s", line, got, shell.said);
  assert_ptr_equal(strchr(shell.said, '\n'), shell.said + strlen(shell.said) - 1); // one line
}

TEST(test_bad_input) {
  lab_shell_need(&shell);
  refuses("@ compare --data s --out x.png", 2, "--model is missing");
  refuses("@ compare --data s --model a/model.ply --labels a,b --out x.png", 2, "one name per model");
  refuses("@ compare --data s --model a/model.ply --out x.jpg", 2, "ends in .png");
  refuses("@ compare --data s --model a/model.ply gone.ply --out x.png", 1, "gone.ply: cannot open");
  refuses("@ compare --data gone --model a/model.ply --out x.png", 1, "gone: no such folder");
  refuses("@ compare --data s --model a/model.ply --split none --out x.png", 1, "split none");
  refuses("@ render --data s --model a/model.ply --width 40 --out x", 2, "--width needs --orbit");
  assert_int_not_equal(run("ls x.png"), 0);
}

#if HAS_DEMUX
static void must_play(const char *name, int n_frames, int w, int h) {
  char path[600];
  void *bytes;
  size_t n;
  sv_err err;
  snprintf(path, sizeof path, "%s/%s", shell.root, name);
  assert_int_equal(sv_file_read(path, &bytes, &n, &err), SV_OK);
  WebPData data = {bytes, n};
  WebPAnimInfo info;
  WebPAnimDecoder *d = WebPAnimDecoderNew(&data, NULL);
  assert_non_null(d);
  assert_true(WebPAnimDecoderGetInfo(d, &info));
  assert_int_equal(info.frame_count, n_frames);
  assert_int_equal(info.canvas_width, w);
  assert_int_equal(info.canvas_height, h);
  assert_int_equal(info.loop_count, 0);
  int n_decoded = 0, at_ms = 0;
  uint8_t *rgba;
  while (WebPAnimDecoderHasMoreFrames(d) && WebPAnimDecoderGetNext(d, &rgba, &at_ms)) n_decoded++;
  assert_int_equal(n_decoded, n_frames);
  assert_in_range(at_ms, 5900, 6000); // a round takes six seconds
  WebPAnimDecoderDelete(d);
  free(bytes);
}
#endif

TEST(test_turntable) {
  lab_shell_need(&shell);
  run_well("@ render --data s --model a/model.ply --orbit 7 --width 40 --out o");
  sv_bitmap b = picture("o/orbit_0006.png");
  assert_int_equal(b.width_px, 40);
  assert_int_equal(b.height_px, 30);
  sv_bitmap_free(&b);
  if (!lab_animation_is_built()) {
    assert_contains(shell.said, "built without libwebp");
    return;
  }
  assert_contains(shell.said, "animation: o/orbit.webp");
#if HAS_DEMUX
  must_play("o/orbit.webp", 7, 40, 30);
#else
  print_message("the WebP is not decoded: no webp/demux.h here\n");
#endif
}

// A film alone, by the name of --out, with and without the dataset.
TEST(test_film) {
  lab_shell_need(&shell);
  run_well("@ render --model a/model.ply --orbit 6 --width 48 --out around");
  sv_bitmap b = picture("around/orbit_0005.png");
  assert_int_equal(b.width_px, 48);
  assert_int_equal(b.height_px, 36);
  long sum = 0; // the model fills a good part of the image
  for (int i = 0; i < 48 * 36; i++) sum += b.u8[3 * i] + b.u8[3 * i + 1] + b.u8[3 * i + 2] > 30;
  assert_in_range(sum, 48 * 36 / 20, 48 * 36);
  sv_bitmap_free(&b);
  refuses("@ render --model a/model.ply --out x", 2, "--data is missing; only --orbit renders without it");
  refuses("@ render --data s --model a/model.ply --out x.mp4", 2, "needs --orbit or --frames");
  refuses("@ render --model a/model.ply --orbit 6 --depth --out x.mp4", 2, "--depth needs a folder");
  if (lab_animation_is_built()) {
    run_well("@ render --model a/model.ply --orbit 7 --width 40 --out o.webp");
#if HAS_DEMUX
    must_play("o.webp", 7, 40, 30);
#endif
  }
  refuses("PATH=/nowhere @ render --model a/model.ply --orbit 2 --width 40 --out n.mp4", 1, "needs ffmpeg");
  if (run("command -v ffprobe") != 0) skip();
  run_well("@ render --data s --model a/model.ply --orbit 9 --width 41 --out o.mp4");
  run_well("ffprobe -v error -count_frames -show_entries stream=width,height,nb_read_frames -of csv o.mp4");
  assert_contains(shell.said, "42,32,9"); // H.264 has even sides
  run_well("test ! -e n.mp4 && test ! -d o.mp4");
}

// import of one rig gives the views that a run of that source is measured on.
TEST(test_heldout) {
  lab_shell_need(&shell);
  run_well("\"$(dirname @)/subview\" run --source sim:textured," SIZE ",rig=stereo --exposures 2 --steps 40 "
           "--gaussians 200 --quiet --json --out r");
  double of_run = number_behind("\"psnr\": ");
  run_well("@ eval --data s --model r/model.ply --quiet");
  double of_eval = number_behind("PSNR ");
  if (!(fabs(of_run - of_eval) < 0.015)) fail_msg("run %f, eval %f", of_run, of_eval);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_layout),    cmocka_unit_test(test_psnr),
                                     cmocka_unit_test(test_defaults),  cmocka_unit_test(test_bad_input),
                                     cmocka_unit_test(test_turntable), cmocka_unit_test(test_film),
                                     cmocka_unit_test(test_heldout)};
  return cmocka_run_group_tests(tests, setup, teardown);
}
