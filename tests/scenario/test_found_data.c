// SPDX-License-Identifier: Apache-2.0
// What users have goes in as it is: subview-lab train recognizes captures, COLMAP folders and
// archives, and imports them once; pictures without a capture.json replay.
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

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_capture), cmocka_unit_test(test_dataset_stays),
                                     cmocka_unit_test(test_colmap),  cmocka_unit_test(test_zip),
                                     cmocka_unit_test(test_open),    cmocka_unit_test(test_nothing),
                                     cmocka_unit_test(test_pictures)};
  return cmocka_run_group_tests(tests, setup, teardown);
}
