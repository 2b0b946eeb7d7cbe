// SPDX-License-Identifier: Apache-2.0
// subview-calibrate: rigs from pictures. Chessboards -> lenses and relative poses, multiplexed
// sensors -> footprints, lenses and poses.
#include <stdio.h>
#include <string.h>

#include "src/base/str.h"
#include "tools/calibrate/calibrate.h"

static const cal_command commands[] = {
    {{"board", "--images CAM0 CAM1 ... --board WxH --spacing M --out RIG [options]",
      "chessboard images -> lens models and rig",
      "Finds the chessboard in the images of all cameras, solves for lens models, relative poses and "
      "the\nboard's deformation, and writes a rig: RIG/rig.json, a .cameramodel per camera, calibration.json "
      "(results and warnings),\nresiduals.csv, plots/ and corners.txt (found corners; unchanged images are "
      "not searched again).\nImages whose wildcards match the same text were taken at the same time. Not "
      "every camera must see every\nboard, but boards seen together must link all cameras. The rig's frame "
      "is the first camera's.",
      "  subview-calibrate board --images 'left??.jpg' 'right??.jpg' --board 9x6 --spacing 0.025 --out rig",
      CAL_BOARD},
     cal_cmd_board},
    {{"print", "--board WxH [--paper a4] [--spacing M] [--out FILE] [options]",
      "chessboard to print, as PDF or SVG",
      "Writes a chessboard with the largest squares that fit on the paper. Its foot states their side and "
      "has "
      "a\nbar of 100 mm: print at 100 %, not fitted to the page, and measure the bar. Glue the sheet flat on "
      "a stiff\nboard. One odd and one even number of corners tell the board's two ends apart.",
      "  subview-calibrate print --board 9x6 --paper a4", CAL_PRINT},
     cal_cmd_print},
    {{"live", "--capture DIR --board WxH --spacing M --out RIG [options]",
      "capture that is being written -> lens models and rig",
      "Searches each new exposure of a capture for the chessboard. When every camera has seen 15 boards in "
      "60 "
      "%\nof its image, or the capture has ended, it solves for the rig as `board` does, writes and checks "
      "it: a "
      "rig in\nwhich the boards are more than 1 px off is refused. The page's Calibrate starts it (subview "
      "run "
      "--preview\n--session).",
      "  subview-calibrate live --capture capture --board 9x6 --spacing 0.024 --out rig", CAL_LIVE},
     cal_cmd_live},
    {{"lenslets", "--isolated DIR --white DIR --out RIG [options]",
      "multiplexed sensor -> footprints, lens models and poses",
      "For sensors on which the images of several lenses overlap. For each lens, cover all others and take "
      "an\nimage of an evenly lit bright field (white) and of a static, textured object (isolated). The "
      "white images\ngive the footprints. Focal length, principal point and pose of each lens come from "
      "bundle adjustment of\nthe object's features or, much better, from a chessboard in several exposures "
      "(--board, --spacing), which\nalso gives the scale. The rig's frame is the first lens's.",
      "  subview-calibrate lenslets --isolated isolated --white white --pitch 0.004 --out rig", CAL_LENSLETS},
     cal_cmd_lenslets},
    {{"check", "--rig RIG [--images CAM0 CAM1 ... --board WxH --spacing M] [options]",
      "check that a rig is still calibrated",
      "Prints the lenses and the angular baseline of a rig. With new images of a chessboard, also how well "
      "each\nlens fits alone, how well all fit together, and how far corners are from their epipolar lines; "
      "warns if\na lens was changed or the rig was knocked. --images follow the order of the rig's "
      "sub-views.",
      "  subview-calibrate check --rig rig --images 'l*.png' 'r*.png' --board 9x6 --spacing 0.025",
      CAL_CHECK},
     cal_cmd_check},
    {{"pose", "--rig RIG --capture DIR --out POSES [options]",
      "capture of a moving rig -> rig pose of every exposure",
      "Tracks the rig through a capture folder and writes POSES/poses.json (rig_from_world of every\nlocated "
      "exposure; the list that \"poses\" of a capture.json holds) and POSES/points.ply (sparse points).\nThe "
      "world is the rig's frame at the first exposure. The rig's baseline gives the scale in meters; "
      "its\nuncertainty is printed. A stationary rig has the same pose everywhere.",
      "  subview-calibrate pose --rig rig --capture capture --out poses", CAL_POSE},
     cal_cmd_pose},
    {{"shutter", "--rig RIG --capture DIR --board WxH --spacing M [options]",
      "capture of a moving chessboard -> readout time and direction of rolling shutters",
      "Finds the chessboard in all frames of a capture, and for each camera the time from its first line to "
      "its\nlast and the direction of its lines, from how the board's motion distorts its images. Adds "
      "readout_ms and\nshutter to RIG/rig.json. Move the board (or the rig) by hand, fast and in all "
      "directions, for some\nseconds, in bright light: a short exposure keeps corners sharp.",
      "  subview capture --source v4l2:/dev/video0 --duration 10 --out moving\n"
      "  subview-calibrate shutter --rig rig --capture moving --board 9x6 --spacing 0.025",
      CAL_SHUTTER},
     cal_cmd_shutter},
    {{"noise", "--rig RIG --images CAM0 CAM1 ... [options]",
      "flat frames -> read noise and shot noise of the cameras",
      "Photon transfer: pictures are taken in pairs, in the order of their names. Each pair shows the same "
      "light. The\nvariance of a camera's values against the light is a line, whose ends are the read noise "
      "and the shot noise.\nTake flat frames at several exposure times, or frames of a still scene with "
      "light "
      "and dark parts, and\nchange nothing meanwhile. Adds noise to RIG/rig.json.",
      "  subview capture --source sim:textured,flat=0.8,vignetting=-0.97,depth=16,noise=read:1e-5:shot:2e-4 "
      "\\\n    --duration 2 --out flat\n"
      "  subview-calibrate noise --rig flat/rig --images flat/left flat/right",
      CAL_NOISE},
     cal_cmd_noise},
    {{"photometric",
      "--rig RIG (--white CAM0 CAM1 ... | --images CAM0 CAM1 ... --board WxH | --run DIR) [options]",
      "white pictures, chessboards or a scene -> vignetting, gains and color matrix of each camera",
      "Measures what each camera makes of the same light: the lens's falloff towards the corners, and gain "
      "and\nwhite balance relative to the first camera. Adds \"photometric\" to RIG/rig.json; 'subview run' "
      "then corrects\nframes as they come. Cameras must be locked at the exposure, gain and white balance "
      "that scans use.\nWhite: fill all images with an evenly lit white surface (a wall, a sheet before the "
      "lens), some pictures, not\nsaturated; text matched by the wildcards pairs pictures of one instant. "
      "Chessboard: its white squares, in the\npictures of 'subview-calibrate board'; vignetting needs boards "
      "in all corners. Scene: a run of 'subview run\n--appearance cameras' compares surfaces that several "
      "images show: 20 exposures and more of a textured room, or of\nwhat else fills the images, with "
      "overlap of all cameras with the first. Scenes of several colors give the color\nmatrix, too.",
      "  subview-calibrate photometric --rig rig --white 'left*.png' 'right*.png'\n"
      "  subview run --source CAMERAS --rig rig --exposures 24 --steps 1 --appearance cameras --out scene\n"
      "  subview-calibrate photometric --rig rig --run scene",
      CAL_PHOTOMETRIC},
     cal_cmd_photometric},
};
#define N_COMMANDS ((int)(sizeof commands / sizeof *commands))

static void help(void) {
  printf("usage: subview-calibrate COMMAND [options]\n\n"
         "Calibrates the cameras of a rig: lens models and relative poses.\n\n");
  for (int i = 0; i < N_COMMANDS; i++) printf("  %-11s %s\n", commands[i].c.name, commands[i].c.summary);
  printf("\nsubview-calibrate COMMAND --help explains a command.\n\nExample:\n%s\n", commands[0].c.example);
}

static int run_command(int argc, char **argv) {
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
  sv_near_name near = sv_near_make(argv[1], strlen(argv[1]));
  for (int i = 0; i < N_COMMANDS; i++) sv_near_try(&near, commands[i].c.name);
  if (near.name) return cal_usage(NULL, "unknown command '%.80s' (did you mean %s?)", argv[1], near.name);
  return cal_usage(NULL, "unknown command '%.80s'", argv[1]);
}

int main(int argc, char **argv) {
  sv_linux_begin_program();
  return sv_linux_end_program("subview-calibrate", run_command(argc, argv));
}
