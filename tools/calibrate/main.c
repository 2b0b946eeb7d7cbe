// SPDX-License-Identifier: Apache-2.0
// subview-calibrate: rigs from pictures. Chessboards -> lenses and relative poses, multiplexed
// sensors -> footprints, lenses and poses.
#include <stdio.h>
#include <string.h>

#include "tools/calibrate/calibrate.h"

static const cal_command commands[] = {
    {{"board", "--images CAM0 CAM1 ... --board WxH --spacing M --out RIG [options]",
      "chessboard pictures -> lenses and rig",
      "Finds the chessboard in the pictures of all cameras, solves for lenses, relative poses and the "
      "board's\n"
      "bend, and writes a rig: RIG/rig.json, a .cameramodel per camera, calibration.json (figures and "
      "warnings),\n"
      "residuals.csv, plots/ and corners.txt (found corners; pictures that did not change are not searched "
      "again).\n"
      "Pictures in which the wildcards stand for the same text are of one instant. Not every camera must "
      "see\n"
      "every board, but all must be joined by boards seen together. The rig's frame is the first camera's.",
      "  subview-calibrate board --images 'left??.jpg' 'right??.jpg' --board 9x6 --spacing 0.025 --out rig",
      CAL_BOARD},
     cal_cmd_board},
    {{"lenslets", "--isolated DIR --white DIR --out RIG [options]",
      "multiplexed sensor -> footprints, lenses and poses",
      "For sensors on which the images of several lenses overlap. Cover all lenses but one and take a "
      "picture\n"
      "of an even bright field (white) and of a still, textured object (isolated); so for each lens.\n"
      "Footprints come from the white pictures; focal length, principal point and pose of each lens from\n"
      "features of the object by bundle adjustment, or, much better, from a chessboard in several exposures\n"
      "(--board, --spacing), which also gives the scale. The rig's frame is the first lens's.",
      "  subview-calibrate lenslets --isolated isolated --white white --pitch 0.004 --out rig", CAL_LENSLETS},
     cal_cmd_lenslets},
    {{"check", "--rig RIG [--images CAM0 CAM1 ... --board WxH --spacing M] [options]",
      "does a rig still hold?",
      "Tells what a rig is: its lenses, its angular baseline. With new pictures of a chessboard also how "
      "well\n"
      "each lens fits alone, how well all fit together, and how far corners are from their epipolar lines;\n"
      "warns when a lens was touched or the rig was knocked. --images are in the order of the rig's "
      "sub-views.",
      "  subview-calibrate check --rig rig --images 'l*.png' 'r*.png' --board 9x6 --spacing 0.025",
      CAL_CHECK},
     cal_cmd_check},
    {{"pose", "--rig RIG --capture DIR --out POSES [options]",
      "a moving rig's capture -> its pose in every exposure",
      "Tracks the rig through a capture folder and writes POSES/poses.json (rig_from_world of every exposure "
      "that\n"
      "could be placed; the list is what \"poses\" of a capture.json holds) and POSES/points.ply (the sparse "
      "cloud).\n"
      "The world is the rig's frame at the first exposure; metres come from the rig's baseline, and how sure "
      "that\n"
      "is is said. A rig that stood still has the same pose everywhere.",
      "  subview-calibrate pose --rig rig --capture capture --out poses", CAL_POSE},
     cal_cmd_pose},
};
#define N_COMMANDS ((int)(sizeof commands / sizeof *commands))

static void help(void) {
  printf("usage: subview-calibrate COMMAND [options]\n\n"
         "Finds out what a rig's cameras are and how they stand to each other.\n\n");
  for (int i = 0; i < N_COMMANDS; i++) printf("  %-9s %s\n", commands[i].c.name, commands[i].c.summary);
  printf("\nsubview-calibrate COMMAND --help tells more.\n\nExample:\n%s\n", commands[0].c.example);
}

int main(int argc, char **argv) {
  if (argc < 2) return cal_usage(NULL, "a command is missing");
  if (strcmp(argv[1], "--help") == 0 || strcmp(argv[1], "-h") == 0) {
    help();
    return CAL_EXIT_OK;
  }
  if (strcmp(argv[1], "--version") == 0) {
    printf("subview-calibrate %s\n", CAL_VERSION);
    return CAL_EXIT_OK;
  }
  for (int i = 0; i < N_COMMANDS; i++) {
    cal_options o;
    if (strcmp(argv[1], commands[i].c.name) != 0) continue;
    int e = cal_args_parse(&commands[i].c, argc - 2, argv + 2, &o);
    if (e != CAL_EXIT_OK) return e;
    if (o.is_help) cal_args_help(&commands[i].c);
    else if (o.is_version) printf("subview-calibrate %s\n", CAL_VERSION);
    else return commands[i].run(&o);
    return CAL_EXIT_OK;
  }
  return cal_usage(NULL, "unknown command '%.80s'", argv[1]);
}
