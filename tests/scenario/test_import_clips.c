// SPDX-License-Identifier: Apache-2.0
// Clips of a simulated stereo rig, made by ffmpeg, become captures again: on one clock by sound,
// flashes and creation times, with pictures within 40 dB of those that were recorded.
#include <math.h>
#include <stdio.h>
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

// PSNR of two images below the folder.
static double psnr(const char *a, const char *b) {
  char path[600];
  sv_bitmap x, y;
  double sum = 0;
  snprintf(path, sizeof path, "%s/%s", shell.root, a);
  assert_ok(sv_bitmap_read(path, &x, &err), &err);
  snprintf(path, sizeof path, "%s/%s", shell.root, b);
  assert_ok(sv_bitmap_read(path, &y, &err), &err);
  assert_int_equal(x.width_px, y.width_px);
  assert_int_equal(x.height_px, y.height_px);
  assert_int_equal(x.n_channels, y.n_channels);
  const int n = x.width_px * x.height_px * x.n_channels;
  for (int i = 0; i < n; i++) sum += (x.u8[i] - y.u8[i]) * (x.u8[i] - y.u8[i]);
  sv_bitmap_free(&x);
  sv_bitmap_free(&y);
  return 10 * log10(255.0 * 255 * n / (sum + 1e-3));
}

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

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_sound),
      cmocka_unit_test(test_flash),
      cmocka_unit_test(test_container),
      cmocka_unit_test(test_hostile_clips),
  };
  return cmocka_run_group_tests(tests, setup, teardown);
}
