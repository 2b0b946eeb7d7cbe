// SPDX-License-Identifier: Apache-2.0
// What users have goes in as it is: subview-lab train recognizes captures, COLMAP folders and
// archives, and imports them once; pictures without a capture.json replay.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tests/common/lab_shell.h"
#include "tests/common/test.h"

#define TRAIN "@ train --gaussians 200 --steps 5 --threads 1 "

static lab_shell shell = {.cwd = ""};

static void expect(int code, const char *sentence, const char *line) {
  const int got = lab_shell_run(&shell, line);
  if (got != code || !strstr(shell.said, sentence)) fail_msg("%s: exit %d: %s", line, got, shell.said);
}

static int setup(void **state) {
  (void)state;
  const int r = lab_shell_open(&shell, "found");
  if (r < 0) return -1;
  shell.is_ready = r == 0;
  if (r == 0)
    lab_shell_run_well(&shell,
                       "$(dirname @)/subview capture --source sim:textured,rig=stereo,size=64x48,fps=10 "
                       "--exposures 4 --quiet --out cap && @ import --from capture cap --quiet --out ds");
  return 0;
}
static int teardown(void **state) {
  (void)state;
  return lab_shell_close(&shell);
}

TEST(test_capture) {
  lab_shell_need(&shell);
  expect(0, "cap: a capture; importing to a/data", TRAIN "--data cap --out a");
  expect(0, "cap: a capture; imported before: a/data", TRAIN "--data cap --out a");
  lab_shell_run_well(&shell, "touch -d '2001-01-01' cap/capture.json");
  expect(0, "cap: a capture; importing to a/data", TRAIN "--data cap --out a"); // it has changed
  lab_shell_run_well(&shell, "@ render --data a/data --model a/model.ply --orbit 1 --out a/orbit --quiet");
}

TEST(test_dataset_stays) {
  lab_shell_need(&shell);
  lab_shell_run_well(&shell, TRAIN "--data ds --out b --quiet && test ! -e b/data");
}

TEST(test_capture_without_rig) {
  lab_shell_need(&shell);
  lab_shell_run_well(&shell, "cp -r cap bare && rm -r bare/rig && sed -i '/^\"rig\":/d' bare/capture.json");
  expect(1, "names no rig; 'subview-lab train --data bare --rig RIG'", TRAIN "--data bare --out n");
  expect(0, "bare: a capture; importing to n/data", TRAIN "--data bare --rig cap/rig --out n");
}

// A COLMAP text model of one pinhole camera.
TEST(test_colmap) {
  lab_shell_need(&shell);
  lab_shell_run_well(
      &shell,
      "mkdir -p col/sparse/0 col/images && cp cap/left/000000.jpg col/images/a.jpg && "
      "cp cap/left/000001.jpg col/images/b.jpg && "
      "echo '1 PINHOLE 64 48 60 60 32 24' >col/sparse/0/cameras.txt && "
      "printf '1 1 0 0 0 0 0 3 1 a.jpg\\n\\n2 1 0 0 0 0.1 0 3 1 b.jpg\\n\\n' >col/sparse/0/images.txt && "
      "printf '1 0 0 0 9 9 9 0.5\\n2 0.1 0 0 9 9 9 0.5\\n' >col/sparse/0/points3D.txt");
  expect(0, "col: a COLMAP folder; importing to c/data", TRAIN "--data col --out c");
}

TEST(test_zip) {
  lab_shell_need(&shell);
  if (lab_shell_run(&shell, "command -v unzip && command -v zip") != 0) {
    print_message("no zip or unzip here\n");
    skip();
  }
  lab_shell_run_well(&shell, "zip -q -r ds.zip ds && zip -q -r cap.zip cap && head -c 3000 ds.zip >cut.zip");
  lab_shell_run_well(&shell, TRAIN "--data ds.zip --out d --quiet && test -e d/unpacked/ds/transforms.json");
  expect(0, "cap.zip: a capture; importing to e/data", TRAIN "--data cap.zip --out e");
  expect(0, "imported before", TRAIN "--data cap.zip --out e");
  expect(1, "cut.zip: unzip could not unpack it", TRAIN "--data cut.zip --out f");
}

// A page beside the model, handed to what opens pages; a word where there is nothing.
TEST(test_open) {
  lab_shell_need(&shell);
  lab_shell_run_well(&shell,
                     "mkdir opener && printf '#!/bin/sh\\necho \"$1\" >opened\\n' >opener/xdg-open && "
                     "chmod +x opener/xdg-open");
  lab_shell_run_well(&shell, "PATH=\"$PWD/opener:$PATH\" " TRAIN "--data ds --out page --open --quiet");
  lab_shell_run_well(&shell, "grep -qx page/model.html opened && grep -q '<canvas' page/model.html");
  lab_shell_run_well(&shell,
                     "printf '#!/bin/sh\\nexit 3\\n' >opener/xdg-open && PATH=\"$PWD/opener:$PATH\" " TRAIN
                     "--data ds --out page --open");
  assert_contains(shell.said, "xdg-open did not open the model; open page/model.html in a browser");
}

TEST(test_nothing) {
  lab_shell_need(&shell);
  lab_shell_run_well(&shell, "mkdir -p other/docs && touch other/notes.txt");
  expect(1, "other: holds docs, notes.txt; expected transforms.json, sparse/0/ (COLMAP), capture.json, ",
         TRAIN "--data other --out g");
  expect(1, "nowhere: no such folder", TRAIN "--data nowhere --out g");
}

TEST(test_pictures) {
  lab_shell_need(&shell);
  lab_shell_run_well(&shell, "mkdir pics && cp -r cap/left cap/right pics");
#define RUN "$(dirname @)/subview run --gaussians 50 --steps 2 --source replay:"
  lab_shell_run_well(&shell, RUN "pics --rig cap/rig --exposures 4 --quiet --out h");
  lab_shell_run_well(&shell, RUN "cap --exposures 4 --quiet --out i");
  lab_shell_run_well(&shell, "cp -r cap/rig pics"); // its own rig
  expect(0, "ready", RUN "pics --exposures 4 --check");
  expect(0, "rig stereo: 2 sub-views", RUN "pics --exposures 4 --check");
  lab_shell_run_well(&shell, "rm pics/left/000001.jpg");
  expect(1, "left has 3 pictures and right has 4", RUN "pics --check");
  expect(0, "camera 0 camera: 64x48", RUN "cap/left --check");
  expect(1, "other: holds neither capture.json nor pictures", RUN "other --check");
}

static double score(const char *data) {
  char line[160];
  snprintf(line, sizeof line,
           "@ train --data %s --gaussians 2000 --steps 300 --threads 1 --eval --quiet --json --out score",
           data);
  lab_shell_run_well(&shell, line);
  const char *at = strstr(shell.said, "\"psnr\": ");
  assert_non_null(at);
  return strtod(at + 8, NULL);
}

// A rig in a hand: folders of pictures in another order than the rig's cameras, which it finds by
// their names. Odometry's poses are as good as the true ones.
TEST(test_pictures_of_a_moving_rig) {
  lab_shell_need(&shell);
  lab_shell_run_well(&shell,
                     "$(dirname @)/subview capture --source sim:room,rig=phone,size=320x240,fps=10,arc=50 "
                     "--exposures 12 --quiet --out walk && mkdir hand && "
                     "cp -r walk/wide walk/ultrawide walk/tele hand");
  expect(1, "hand: pictures of 3 cameras need --rig RIG", TRAIN "--data hand --out j");
  expect(0, "odometry: located 12 of 12 exposures", TRAIN "--data hand --rig walk/rig --out j");
  assert_contains(shell.said, "hand: pictures of a rig's cameras; importing to j/data");
  expect(0, "imported before: j/data", TRAIN "--data hand --rig walk/rig --out j");
  lab_shell_run_well(&shell, "touch -d '2040-01-01' hand/tele");
  expect(0, "importing to j/data", TRAIN "--data hand --rig walk/rig --out j");
  lab_shell_run_well(&shell, "mv hand/tele hand/zoom");
  expect(1, "hand: its folders are ultrawide, wide, zoom; expected one named tele",
         TRAIN "--data hand --rig walk/rig --out k");
  lab_shell_run_well(&shell, "rm -r hand/zoom hand/wide");
  expect(1, "expected transforms.json", TRAIN "--data hand --out k");
  expect(1, "hand/ultrawide: holds pictures of one camera without poses; run COLMAP",
         TRAIN "--data hand/ultrawide --out k");
  lab_shell_run_well(&shell, "@ import --from capture walk --quiet --out true");
  const double known = score("true"), found = score("j/data");
  print_message("%.2f dB with known poses, %.2f dB with those found\n", known, found);
  assert_true(found > known - 1);
}

TEST(test_pictures_of_a_standing_rig) {
  lab_shell_need(&shell);
  lab_shell_run_well(&shell, "$(dirname @)/subview capture --source "
                             "sim:textured,rig=stereo,size=160x120,fps=10,arc=0,exposures=100000 "
                             "--exposures 8 --quiet --out stand && mkdir tripod && "
                             "cp -r stand/left stand/right stand/rig tripod");
  expect(0, "odometry: stationary rig", TRAIN "--data tripod --out m");
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_capture),
                                     cmocka_unit_test(test_dataset_stays),
                                     cmocka_unit_test(test_capture_without_rig),
                                     cmocka_unit_test(test_colmap),
                                     cmocka_unit_test(test_zip),
                                     cmocka_unit_test(test_open),
                                     cmocka_unit_test(test_nothing),
                                     cmocka_unit_test(test_pictures),
                                     cmocka_unit_test(test_pictures_of_a_moving_rig),
                                     cmocka_unit_test(test_pictures_of_a_standing_rig)};
  return cmocka_run_group_tests(tests, setup, teardown);
}
