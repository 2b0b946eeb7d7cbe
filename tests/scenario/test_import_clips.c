// SPDX-License-Identifier: Apache-2.0
// Clips of a simulated stereo rig, made by ffmpeg, become captures again: on one clock by sound,
// flashes and creation times, or as both eyes of a spatial video; with pictures within 40 dB of
// those that were recorded, and the right baseline.
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/format/rig_file.h"
#include "tests/common/lab_shell.h"
#include "tests/common/test.h"
#include "tools/common/fileio.h"
#include "tools/common/imageio.h"

static lab_shell shell = {.cwd = ""};
static sv_err err;

// The right clip begins five frames, 0.25 s, later. Its sound is the left one's, quieter.
#define MAKE_CLIP(name, first, filters, sound)                                                               \
  "ffmpeg -v error -nostdin -y -framerate 20 -start_number " first " -i cap/" name "/%06d.jpg " sound        \
  " -vf '" filters "' -c:v libx264 -preset ultrafast -crf 4 -pix_fmt yuv444p -c:a aac -shortest "
#define NOISE "-f lavfi -i anoisesrc=d=3:c=pink:r=16000:a=0.5:seed=3"

static int setup(void **state) {
  (void)state;
  const int r = lab_shell_open(&shell, "clips");
  if (r < 0) return -1;
  shell.is_ready = r == 0 && lab_shell_run(&shell, "ffmpeg -version") == 0;
  if (!shell.is_ready) return 0;
  lab_shell_run_well(&shell,
                     "$(dirname @)/subview capture --source sim:textured,rig=stereo,size=160x120,fps=20 "
                     "--exposures 40 --quiet --out cap && mkdir heard seen told mute");
  lab_shell_run_well(&shell, MAKE_CLIP("left", "0", "null", NOISE) "heard/left.mp4");
  lab_shell_run_well(&shell,
                     MAKE_CLIP("right", "5", "null", "-ss 0.25 " NOISE) "-af volume=0.3 heard/right.mp4");
  return 0;
}
static int teardown(void **state) {
  (void)state;
  return lab_shell_close(&shell);
}

// PSNR of two images below the folder; of gray (luma) with 1 channel.
static double psnr_of(const char *a, const char *b, int n_channels) {
  char path[600];
  sv_bitmap x, y;
  double sum = 0;
  snprintf(path, sizeof path, "%s/%s", shell.root, a);
  assert_ok(sv_bitmap_read(path, &x, &err), &err);
  snprintf(path, sizeof path, "%s/%s", shell.root, b);
  assert_ok(sv_bitmap_read(path, &y, &err), &err);
  assert_int_equal(x.width_px, y.width_px);
  assert_int_equal(x.height_px, y.height_px);
  assert_ok(sv_bitmap_to_channels(&x, n_channels, &err), &err);
  assert_ok(sv_bitmap_to_channels(&y, n_channels, &err), &err);
  const int n = x.width_px * x.height_px * x.n_channels;
  for (int i = 0; i < n; i++) sum += (x.u8[i] - y.u8[i]) * (x.u8[i] - y.u8[i]);
  sv_bitmap_free(&x);
  sv_bitmap_free(&y);
  return 10 * log10(255.0 * 255 * n / (sum + 1e-3));
}

static double psnr(const char *a, const char *b) { return psnr_of(a, b, 3); }

// The distance of the first two sub-views of a rig, and the first one's focal length.
static double baseline_of(const char *folder, double *focal_px) {
  static uint8_t block[256 << 10], scratch_block[256 << 10];
  char path[600];
  double a[3], b[3];
  sv_rig rig;
  snprintf(path, sizeof path, "%s/%s", shell.root, folder);
  sv_arena arena = sv_arena_make(block, sizeof block),
           scratch = sv_arena_make(scratch_block, sizeof scratch_block);
  const sv_file_reader files = {path, sv_folder_read};
  assert_int_equal(sv_rig_init(&rig, 8, &arena), SV_OK);
  assert_ok(sv_rig_read(&rig, &files, -1, &scratch, &err), &err);
  assert_int_equal(rig.n_sub_views, 2);
  sv_pose_centre(a, &rig.sub_views[0].cam_from_rig);
  sv_pose_centre(b, &rig.sub_views[1].cam_from_rig);
  *focal_px = rig.sub_views[0].model.p[0];
  return sqrt((a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1]) + (a[2] - b[2]) * (a[2] - b[2]));
}

static void expect(int code, const char *sentence, const char *line) {
  const int got = lab_shell_run(&shell, line);
  if (got != code || !strstr(shell.said, sentence)) fail_msg("%s: exit %d: %s", line, got, shell.said);
}

// --- several cameras -----------------------------------------------------------------------------

TEST(test_sound) {
  double f0, f1;
  lab_shell_need(&shell);
  expect(0, "right: starts at 0.25", "@ import --from multicam heard --rig cap/rig --out a");
  assert_contains(shell.said, "ms by the sound");
  assert_contains(shell.said, "35 exposures of 2 cameras");
  assert_psnr(psnr("a/left/000000.png", "cap/left/000005.jpg"), 40);
  assert_psnr(psnr("a/right/000000.png", "cap/right/000005.jpg"), 40);
  assert_psnr(psnr("a/right/000034.png", "cap/right/000039.jpg"), 40);
  const double want = baseline_of("cap/rig", &f0);
  assert_near(baseline_of("a/rig", &f1), want, 1e-6);
  assert_near(f1, f0, 1e-6);
  // Fewer exposures, in the same folder.
  expect(0, "9 exposures of 2 cameras", "@ import --from multicam heard --rig cap/rig --every 0.2 --out a");
  lab_shell_run_well(&shell, "@ import --from capture a --out a.data --quiet");
}

// A folder of clips is what one trains on, imported once beside the output.
TEST(test_train) {
  lab_shell_need(&shell);
  expect(1, "clips need --rig RIG", "@ train --data heard --steps 5 --out t");
  expect(1, "is one clip; --data takes a folder", "@ train --data heard/left.mp4 --steps 5 --out t");
#define TRAIN(every)                                                                                         \
  "@ train --data heard --rig cap/rig --every " every " --gaussians 200 --steps 5 --threads 1 --out t"
  expect(0, "clips of several cameras; importing to t/data", TRAIN("0.5"));
  assert_contains(shell.said, "4 exposures of 2 cameras");
  expect(0, "imported before: t/data", TRAIN("0.5"));
  expect(0, "9 exposures of 2 cameras", TRAIN("0.2"));
}

TEST(test_flash) {
  lab_shell_need(&shell);
#define FLASH(from) "eq=brightness=0.3:enable=gte(t\\," from ")"
  lab_shell_run_well(&shell, MAKE_CLIP("left", "0", FLASH("0.9"), "") "seen/left.mp4");
  lab_shell_run_well(&shell, MAKE_CLIP("right", "5", FLASH("0.65"), "") "seen/right.mp4");
  expect(0, "right: starts at 0.25", "@ import --from multicam seen --out b");
  assert_contains(shell.said, "by the changes of the light");
  assert_contains(shell.said, "not by the sound");
  assert_psnr(psnr("b/right/000000.png", "cap/right/000005.jpg"), 40);
}

TEST(test_container) {
  lab_shell_need(&shell);
  lab_shell_run_well(
      &shell, "for i in left right; do ffmpeg -v error -nostdin -y -i heard/$i.mp4 -an -c copy -metadata "
              "creation_time=2024-02-29T23:59:5$([ $i = left ] && echo 9 || echo 8).5 told/$i.mov; done");
  expect(0, "right: starts at -1.0000 s +- 408.25 ms by the creation times of the containers",
         "@ import --from multicam told --clock container --out c");
  lab_shell_run_well(
      &shell, "for i in left right; do ffmpeg -v error -nostdin -y -i heard/$i.mp4 -an -map_metadata -1 -c "
              "copy mute/$i.mp4; done");
  expect(1, "nothing tells a common clock", "@ import --from multicam mute --out d");
}

TEST(test_hostile_clips) {
  lab_shell_need(&shell);
  lab_shell_run_well(&shell,
                     "mkdir bad && cp heard/left.mp4 bad && head -c 3000 heard/right.mp4 >bad/right.mp4");
  expect(1, "bad/right.mp4: ffprobe cannot read it", "@ import --from multicam bad --quiet --out e");
  shell.said[strcspn(shell.said, "\n")] = 0;
  assert_one_sentence(shell.said);
  lab_shell_run_well(&shell, "rm bad/right.mp4");
  expect(1, "holds 1 clips", "@ import --from multicam bad --out e");
  expect(1, "ffprobe was not found", "PATH=/nowhere @ import --from multicam heard --out e");
  expect(1, "sub-view left is of camera 0",
         "mkdir odd && cp heard/left.mp4 odd/a.mp4 && cp heard/right.mp4 odd/b.mp4 && "
         "@ import --from multicam odd --rig cap/rig --out e");
}

// --- spatial video -------------------------------------------------------------------------------

#define BASELINE_UM 63876
#define FOV_MDEG    63400

static uint8_t movie[4 << 20];
static size_t movie_bytes;

static void put32(uint8_t *p, uint32_t v) {
  for (int i = 0; i < 4; i++) p[i] = (uint8_t)(v >> (24 - 8 * i));
}

static uint32_t get32(const uint8_t *p) {
  return (uint32_t)p[0] << 24 | (uint32_t)p[1] << 16 | (uint32_t)p[2] << 8 | p[3];
}

// A box of the content behind it, at out; its size.
static size_t put_box(uint8_t *out, const char *type, const void *content, size_t bytes) {
  memmove(out + 8, content, bytes);
  put32(out, (uint32_t)bytes + 8);
  memcpy(out + 4, type, 4);
  return bytes + 8;
}

// A full box with one number of `bytes` bytes.
static size_t put_number(uint8_t *out, const char *type, uint32_t v, size_t bytes) {
  uint8_t content[8] = {0};
  put32(content + 4, bytes == 1 ? v << 24 : v);
  return put_box(out, type, content, 4 + bytes);
}

// vexu and hfov of a track, as Apple's extensions describe them; eyes: bits of stri.
static size_t make_boxes(uint8_t *out, uint32_t eyes, const char *packing) {
  uint8_t inner[200], outer[300];
  size_t n = put_number(inner, "stri", eyes, 1), all;
  uint8_t cams[40];
  const size_t cams_bytes = put_number(cams, "blin", BASELINE_UM, 4);
  n += put_box(inner + n, "cams", cams, cams_bytes);
  all = put_box(outer, "eyes", inner, n);
  n = put_number(inner, "prji", get32((const uint8_t *)"rect"), 4);
  all += put_box(outer + all, "proj", inner, n);
  if (packing) {
    n = put_number(inner, "pkin", get32((const uint8_t *)packing), 4);
    all += put_box(outer + all, "pack", inner, n);
  }
  n = put_box(out, "vexu", outer, all);
  put32(inner, FOV_MDEG);
  return n + put_box(out + n, "hfov", inner, 4);
}

// Adds boxes to the sample entry of the i-th track of a movie whose moov is behind its media. The
// boxes around it grow.
static void add_boxes(int i_track, const uint8_t *boxes, size_t bytes) {
  static const char *const way[] = {"moov", "trak", "mdia", "minf", "stbl", "stsd", NULL};
  size_t from = 0, to = movie_bytes, parents[8];
  int n = 0;
  for (; way[n]; n++) {
    int skip = n == 1 ? i_track : 0;
    while (memcmp(movie + from + 4, way[n], 4) != 0 || skip-- > 0) {
      assert_true(from + 8 < to);
      from += get32(movie + from);
    }
    parents[n] = from;
    to = from + get32(movie + from);
    from += 8;
  }
  parents[n++] = from + 8; // the entry, behind version, flags and count
  const size_t end = parents[n - 1] + get32(movie + parents[n - 1]);
  memmove(movie + end + bytes, movie + end, movie_bytes - end);
  memcpy(movie + end, boxes, bytes);
  movie_bytes += bytes;
  for (int i = 0; i < n; i++) put32(movie + parents[i], get32(movie + parents[i]) + (uint32_t)bytes);
}

static void load_movie(const char *name) {
  char path[600];
  void *data;
  snprintf(path, sizeof path, "%s/%s", shell.root, name);
  assert_ok(sv_file_read(path, &data, &movie_bytes, &err), &err);
  assert_true(movie_bytes + 1000 < sizeof movie);
  memcpy(movie, data, movie_bytes);
  free(data);
}

static void save_movie(const char *name) {
  char path[600];
  snprintf(path, sizeof path, "%s/%s", shell.root, name);
  assert_ok(sv_file_write(path, movie, movie_bytes, &err), &err);
}

static void check_eyes(const char *out, int left, int right) {
  char name[2][100], want[2][100];
  double focal;
  snprintf(name[0], 100, "%s/left/000003.png", out);
  snprintf(name[1], 100, "%s/right/000003.png", out);
  snprintf(want[0], 100, "cap/%s/000003.jpg", left ? "right" : "left");
  snprintf(want[1], 100, "cap/%s/000003.jpg", right ? "right" : "left");
  assert_psnr(psnr(name[0], want[0]), 40);
  assert_psnr(psnr(name[1], want[1]), 40);
  snprintf(name[0], 100, "%s/rig", out);
  assert_near(baseline_of(name[0], &focal), BASELINE_UM * 1e-6, 1e-9);
  assert_near(focal, 80 / tan(0.5 * FOV_MDEG * 1e-3 * 3.14159265358979 / 180), 1e-3);
}

#define BOTH                                                                                                 \
  "ffmpeg -v error -nostdin -y -framerate 20 -i cap/left/%06d.jpg -framerate 20 -i cap/right/%06d.jpg "      \
  "-t 0.4 "
#define HEVC "-c:v libx265 -preset ultrafast -x265-params crf=4:log-level=error -pix_fmt yuv444p -tag:v hvc1 "

TEST(test_two_tracks) {
  uint8_t boxes[400];
  lab_shell_need(&shell);
  lab_shell_run_well(&shell, BOTH "-map 0 -map 1 " HEVC "two.mov");
  expect(1, "no spatial video", "@ import --from spatial two.mov --out f");
  load_movie("two.mov");
  add_boxes(0, boxes, make_boxes(boxes, 1, NULL));
  add_boxes(1, boxes, make_boxes(boxes, 2, NULL));
  save_movie("two.mov");
  expect(0, "8 exposures of two eyes, baseline 0.0639 m", "@ import --from spatial two.mov --out f");
  check_eyes("f", 0, 1);
  expect(0, "baseline 0.0200 m, focal length 100.00 px",
         "@ import --from spatial two.mov --baseline 0.02 --focal 100 --every 0.1 --out f");
  lab_shell_run_well(&shell, "@ import --from capture f --out f.data --quiet");
}

TEST(test_packed) {
  uint8_t boxes[400];
  lab_shell_need(&shell);
  lab_shell_run_well(&shell, BOTH "-filter_complex hstack " HEVC "side.mov");
  load_movie("side.mov");
  add_boxes(0, boxes, make_boxes(boxes, 3 | 8, "side")); // the right eye is first
  save_movie("side.mov");
  expect(0, "8 exposures of two eyes", "@ import --from spatial side.mov --out g");
  check_eyes("g", 1, 0);
}

static bool has_views(void) {
  return lab_shell_run(&shell, "ffmpeg -v error -h decoder=hevc | grep -q view_ids") == 0;
}

// Layers of MV-HEVC: an ffmpeg without them is told; one that has them is asked for each view. A
// program stands in for it, which takes view 1 from a second track.
TEST(test_layers) {
  uint8_t boxes[400];
  lab_shell_need(&shell);
  if (has_views()) {
    print_message("skip  this ffmpeg needs no program that stands in for it\n");
    skip();
  }
  lab_shell_run_well(&shell, BOTH "-map 0 -map 1 " HEVC "layers.mov");
  load_movie("layers.mov");
  size_t n = make_boxes(boxes, 3, NULL);
  n += put_box(boxes + n, "lhvC", "\1\0", 2);
  add_boxes(0, boxes, n);
  save_movie("layers.mov");
  expect(1, "needs ffmpeg 7.1 or newer", "@ import --from spatial layers.mov --out h");
  lab_shell_run_well(
      &shell, "mkdir bin && printf '#!/bin/sh\\ncase \"$*\" in *decoder=hevc*) echo view_ids; exit;; "
              "esac\\nfor a; do shift; case $a in 0:v:0:vidx:*) a=0:v:${a##*:};; esac; set -- \"$\\100\" "
              "\"$a\"; done\\nexec '$(command -v ffmpeg)' \"$\\100\"\\n' >bin/ffmpeg && chmod +x bin/ffmpeg");
  expect(0, "8 exposures of two eyes", "PATH=$PWD/bin:$PATH @ import --from spatial layers.mov --out h");
  check_eyes("h", 0, 1);
}

// A file of two real layers (tests/data), where ffmpeg decodes them.
TEST(test_real_layers) {
  char path[PATH_MAX], line[PATH_MAX + 60], name[100], want[100];
  double focal;
  lab_shell_need(&shell);
  if (!has_views()) {
    print_message("skip  this ffmpeg decodes no layers of MV-HEVC\n");
    skip();
  }
  assert_non_null(realpath("tests/data/mv_hevc/layers.mov", path));
  snprintf(line, sizeof line, "@ import --from spatial '%s' --out j", path);
  expect(0, "5 exposures of two eyes, baseline 0.0639 m, focal length 129.53 px", line);
  for (int i = 0; i < 10; i++) {
    snprintf(name, sizeof name, "j/%s/%06d.png", i % 2 ? "right" : "left", i / 2);
    snprintf(want, sizeof want, "cap/%s/%06d.jpg", i % 2 ? "right" : "left", i / 2);
    assert_psnr(psnr_of(name, want, 1), 44.5); // its colors have half the size
  }
  assert_near(baseline_of("j/rig", &focal), BASELINE_UM * 1e-6, 1e-9);
}

TEST(test_hostile_movie) {
  uint8_t boxes[400];
  lab_shell_need(&shell);
  lab_shell_run_well(&shell, BOTH "-map 0 -map 1 -c:v libx264 -preset ultrafast plain.mov");
  expect(1, "No such file", "@ import --from spatial absent.mov --out i");
  expect(1, "has no box moov", "@ import --from spatial cap/left/000000.jpg --out i");
  load_movie("plain.mov");
  const size_t n = make_boxes(boxes, 1, NULL);
  put32(boxes + 8, 0x7fffffff); // eyes
  add_boxes(0, boxes, n);
  save_movie("odd.mov");
  expect(1, "does not fit into the one around it", "@ import --from spatial odd.mov --out i");
  expect(2, "--every multicam, spatial, realsense, oak or rosbag",
         "@ import --from capture cap --every 1 --out i");
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_sound),         cmocka_unit_test(test_train),
      cmocka_unit_test(test_flash),         cmocka_unit_test(test_container),
      cmocka_unit_test(test_hostile_clips), cmocka_unit_test(test_two_tracks),
      cmocka_unit_test(test_packed),        cmocka_unit_test(test_layers),
      cmocka_unit_test(test_real_layers),   cmocka_unit_test(test_hostile_movie),
  };
  return cmocka_run_group_tests(tests, setup, teardown);
}
