// SPDX-License-Identifier: Apache-2.0
// Training at a smaller size than the cameras' (run --scale, --size), and rigs that were calibrated
// at another size than the frames have.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tests/common/test.h"

#define RUN                                                                                                  \
  "$SV_EMULATE $SV_BIN/subview run --exposures 4 --steps 300 --gaussians 3000 --json --quiet --overwrite "

// A number or word of the JSON object that a command prints.
static double number_of(const char *command, const char *key, char digest[20]) {
  static char out[4096];
  char quoted[40];
  if (shell_read(out, sizeof out, command)) fail_msg("%s\n%s", command, out);
  const char *d = strstr(out, "\"digest\": \"");
  assert_non_null(d);
  memcpy(digest, d + 11, 16);
  digest[16] = 0;
  snprintf(quoted, sizeof quoted, "\"%s\": ", key);
  const char *at = strstr(out, quoted);
  assert_non_null(at);
  return atof(at + strlen(quoted));
}

static double run(const char *source, const char *more, const char *key, char digest[20]) {
  char command[1200];
  snprintf(command, sizeof command, "%s" RUN "--source %s %s --out %s 2>&1",
           strncmp(more, "REF ", 4) ? "" : "SV_ISA=ref ", source, strncmp(more, "REF ", 4) ? more : more + 4,
           temp_path("out"));
  return number_of(command, key, digest);
}

static void refused(const char *source, const char *more, const char *says) {
  char command[1200], out[2048];
  snprintf(command, sizeof command, RUN "--source %s %s --out %s 2>&1", source, more, temp_path("bad"));
  assert_true(shell_read(out, sizeof out, command) > 0);
  assert_contains(out, says);
}

#define FULL  "sim:textured,rig=stereo,size=320x240"
#define SMALL "sim:textured,rig=stereo,size=160x120"

TEST(a_smaller_size_is_as_good_as_smaller_cameras) {
  char a[20], b[20];
  const double small = run(SMALL, "", "psnr", a), scaled = run(FULL, "--scale 2", "psnr", a);
  print_message("held-out PSNR: cameras of 160x120 %.2f dB; of 320x240, --scale 2: %.2f dB\n", small, scaled);
  assert_true(scaled > small - 1.0);
  (void)run(FULL, "--size 160x120 --threads 1", "psnr", b);
  assert_string_equal(a, b); // the same pictures
  (void)run(FULL, "REF --scale 2", "psnr", b);
  assert_string_equal(a, b);                                    // for every instruction set
  assert_true(run(FULL, "--scale 3", "psnr", b) > small - 1.0); // 106 columns of 3, 2 remain
  char command[1200], out[2048];
  snprintf(command, sizeof command, RUN "--source " FULL " --scale 2 --check --out %s 2>&1",
           temp_path("checked"));
  assert_int_equal(shell_read(out, sizeof out, command), 0);
  assert_contains(out, "2 sub-views, trained at 160x120");
  refused(FULL, "--size 160x160", "images of 320x240 pixels, which cannot be trained at 160x160");
  refused(FULL, "--size 640x480", "expected a smaller size");
  refused(FULL, "--size 160x120 --scale 2", "expected one of them");
  refused(FULL, "--size small", "expected WxH");
  refused("sim:textured,rig=multiplexed", "--scale 2", "not for multiplexed");
}

TEST(deep_pictures_too) {
  static const char more[] = ",depth=16,noise=read:1e-6:shot:1e-4,bracket=0.1";
  char a[20], b[20], full[200], small[200];
  snprintf(full, sizeof full, FULL "%s", more);
  snprintf(small, sizeof small, SMALL "%s", more);
  const double at_size = run(small, "--depth 16", "psnr", a),
               scaled = run(full, "--depth 16 --scale 2", "psnr", a);
  print_message("16 bits and brackets: cameras of 160x120 %.2f dB; of 320x240, --scale 2: %.2f dB\n", at_size,
                scaled);
  assert_true(scaled > at_size - 1.5);
  (void)run(full, "--depth 16 --size 160x120 --threads 1", "psnr", b);
  assert_string_equal(a, b);
}

TEST(a_rig_of_another_size_serves) {
  char digest[20], large[600], own[600], wide[600];
  shell_ok("$SV_EMULATE $SV_BIN/subview capture --source sim:textured,rig=stereo,size=640x480 --exposures 1 "
           "--out %s",
           temp_path("large"));
  shell_ok("$SV_EMULATE $SV_BIN/subview capture --source " FULL " --exposures 4 --out %s", temp_path("own"));
  shell_ok("$SV_EMULATE $SV_BIN/subview capture --source sim:textured,rig=stereo,size=320x180 --exposures 2 "
           "--out %s",
           temp_path("wide"));
  snprintf(own, sizeof own, "replay:%s", temp_path("own"));
  snprintf(wide, sizeof wide, "replay:%s", temp_path("wide"));
  snprintf(large, sizeof large, "--rig %s/rig", temp_path("large"));
  const double with_own = run(own, "", "train_psnr", digest),
               with_large = run(own, large, "train_psnr", digest);
  print_message("training PSNR: own rig %.3f dB; a rig of 640x480 %.3f dB\n", with_own, with_large);
  assert_near(with_large, with_own, 0.1);
  refused(wide, large, "calibrated at 640x480 pixels and its camera delivers 320x180");
}

// The poses of a handheld rig, by its own calibration and by one of four times the size: the same.
TEST(poses_are_the_same_at_any_calibrated_size) {
  shell_ok("$SV_EMULATE $SV_BIN/subview capture --quiet --exposures 8 --out %s --source "
           "sim:textured,rig=stereo,path=handheld,arc=60,size=320x240,exposures=8",
           temp_path("hand"));
  shell_ok("$SV_EMULATE $SV_BIN/subview capture --quiet --exposures 1 --out %s --source "
           "sim:textured,rig=stereo,size=1280x960",
           temp_path("huge"));
  shell_ok("$SV_EMULATE $SV_BIN/subview-calibrate pose --quiet --rig %s/rig --capture %s --out %s",
           temp_path("hand"), temp_path("hand"), temp_path("own_poses"));
  shell_ok("$SV_EMULATE $SV_BIN/subview-calibrate pose --quiet --rig %s/rig --capture %s --out %s",
           temp_path("huge"), temp_path("hand"), temp_path("huge_poses"));
  shell_ok("cmp %s/poses.json %s/poses.json", temp_path("own_poses"), temp_path("huge_poses"));
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(a_smaller_size_is_as_good_as_smaller_cameras),
      cmocka_unit_test(deep_pictures_too),
      cmocka_unit_test(a_rig_of_another_size_serves),
      cmocka_unit_test(poses_are_the_same_at_any_calibrated_size),
  };
  return cmocka_run_group_tests_name("scaled runs", tests, temp_folder_setup, temp_folder_teardown);
}
