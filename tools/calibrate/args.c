// SPDX-License-Identifier: Apache-2.0
#include "tools/calibrate/args.h"

#include <stdarg.h>
#include <stddef.h>
#include <string.h>

#include "calib/solve/corners.h"
#include "src/base/str.h"
#include "src/format/board_print.h"

#define AT(field) offsetof(cal_options, field)
#define ALL                                                                                                  \
  (CAL_BOARD | CAL_LENSLETS | CAL_POSE | CAL_CHECK | CAL_SHUTTER | CAL_PRINT | CAL_NOISE | CAL_LIVE |        \
   CAL_PHOTOMETRIC)

static const sv_option table[] = {
    {"images", SV_OPT_LIST, CAL_BOARD | CAL_CHECK, CAL_BOARD, AT(images), "CAM0 CAM1 ...",
     "per camera a quoted pattern ('left*.jpg') or a folder; the text matched by the wildcard pairs frames "
     "across cameras",
     0, 0, "cameras"},
    {"board", SV_OPT_TEXT, CAL_BOARD, CAL_BOARD, AT(board), "WxH", "inner corners of the chessboard: 9x6", 0,
     0, 0},
    {"isolated", SV_OPT_TEXT, CAL_LENSLETS, CAL_LENSLETS, AT(isolated), "DIR",
     "images with one lens open: LENS.png, LENS/*.png (exposures by name) or EXPOSURE/LENS.png", 0, 0, 0},
    {"white", SV_OPT_TEXT, CAL_LENSLETS, CAL_LENSLETS, AT(white), "DIR",
     "images of an evenly lit bright field: LENS.png, one per lens", 0, 0, 0},
    {"pitch", SV_OPT_REAL, CAL_LENSLETS, 0, AT(pitch_m), "M",
     "meters between neighboring lenses: sets the scale [1, in unknown units]", 1e-9, 1e3, 0},
    {"focal", SV_OPT_REAL, CAL_LENSLETS, 0, AT(focal_px), "PX",
     "mean focal length of the lenses, if known [estimated; a narrow array constrains it poorly]", 1, 1e6, 0},
    {"dark", SV_OPT_REAL, CAL_LENSLETS, 0, AT(dark), "V", "black level, 0 to 1 [measured]", 0, 1, 0},
    {"linear", SV_OPT_FLAG, CAL_LENSLETS, 0, AT(is_linear), 0, "values are linear light, not sRGB-encoded", 0,
     0, 0},
    {"board", SV_OPT_TEXT, CAL_LENSLETS, 0, AT(board), "WxH",
     "the object is a chessboard with this many inner corners, in several exposures", 0, 0, 0},
    {"spacing", SV_OPT_REAL, CAL_LENSLETS, 0, AT(spacing_m), "M", "side of its squares in meters", 1e-6, 100,
     0},
    {"board", SV_OPT_TEXT, CAL_CHECK, 0, AT(board), "WxH", "inner corners of the chessboard: 9x6", 0, 0, 0},
    {"spacing", SV_OPT_REAL, CAL_BOARD, CAL_BOARD, AT(spacing_m), "M", "side of a square in meters", 1e-6,
     100, 0},
    {"spacing", SV_OPT_REAL, CAL_CHECK, 0, AT(spacing_m), "M", "side of a square in meters", 1e-6, 100, 0},
    {"rig", SV_OPT_TEXT, CAL_SHUTTER, CAL_SHUTTER, AT(rig), "RIG",
     "calibrated rig: a folder with rig.json, to which the readout times are added", 0, 0, 0},
    {"capture", SV_OPT_TEXT, CAL_SHUTTER, CAL_SHUTTER, AT(capture), "DIR",
     "capture folder: a board that moves, at the cameras' full frame rate", 0, 0, 0},
    {"board", SV_OPT_TEXT, CAL_SHUTTER, CAL_SHUTTER, AT(board), "WxH", "inner corners of the chessboard: 9x6",
     0, 0, 0},
    {"spacing", SV_OPT_REAL, CAL_SHUTTER, CAL_SHUTTER, AT(spacing_m), "M", "side of a square in meters", 1e-6,
     100, 0},
    {"rig", SV_OPT_TEXT, CAL_NOISE, CAL_NOISE, AT(rig), "RIG",
     "rig: a folder with rig.json, to which the noise is added", 0, 0, 0},
    {"images", SV_OPT_LIST, CAL_NOISE, CAL_NOISE, AT(images), "CAM0 CAM1 ...",
     "per camera of the rig a quoted pattern ('left/*.png') or a folder of 16-bit PNG files, in the order of "
     "their names",
     0, 0, "cameras"},
    {"board", SV_OPT_TEXT, CAL_PRINT, CAL_PRINT, AT(board), "WxH", "inner corners of the chessboard: 9x6", 0,
     0, 0},
    {"paper", SV_OPT_WORD, CAL_PRINT, 0, AT(paper), SV_BOARD_PAPERS, "size of the paper [a4]", 0, 0, 0},
    {"spacing", SV_OPT_REAL, CAL_PRINT, 0, AT(spacing_m), "M",
     "side of a square in meters [the largest whole millimeter that fits]", 1e-3, 1, 0},
    {"out", SV_OPT_TEXT, CAL_PRINT, 0, AT(out), "FILE", "output file, .pdf or .svg [board-WxH-PAPER.pdf]", 0,
     0, 0},
    {"capture", SV_OPT_TEXT, CAL_LIVE, CAL_LIVE, AT(capture), "DIR",
     "capture folder that is being written: the board in many poses", 0, 0, 0},
    {"board", SV_OPT_TEXT, CAL_LIVE, CAL_LIVE, AT(board), "WxH", "inner corners of the chessboard: 9x6", 0, 0,
     0},
    {"spacing", SV_OPT_REAL, CAL_LIVE, CAL_LIVE, AT(spacing_m), "M", "side of a square in meters", 1e-6, 100,
     0},
    {"rig", SV_OPT_TEXT, CAL_LIVE, 0, AT(rig), "RIG", "earlier rig, to compare with", 0, 0, 0},
    {"memory", SV_OPT_INT, CAL_LIVE, 0, AT(memory_mib), "MIB",
     "fails rather than take more than this [no limit]", 64, 1 << 20, 0},
    {"feed-fd", SV_OPT_INT, CAL_LIVE, 0, AT(feed_fd), "N", "used by subview itself", 3, 1 << 20, 0},
    {"out", SV_OPT_TEXT, CAL_LIVE, CAL_LIVE, AT(out), "RIG", "output folder", 0, 0, 0},
    {"rig", SV_OPT_TEXT, CAL_PHOTOMETRIC, CAL_PHOTOMETRIC, AT(rig), "RIG",
     "calibrated rig: a folder with rig.json, to which the result is added", 0, 0, 0},
    {"white", SV_OPT_LIST, CAL_PHOTOMETRIC, 0, AT(whites), "CAM0 CAM1 ...",
     "pictures of an evenly lit white surface: per camera a quoted pattern ('left*.png') or a folder", 0, 0,
     "cameras"},
    {"images", SV_OPT_LIST, CAL_PHOTOMETRIC, 0, AT(images), "CAM0 CAM1 ...",
     "pictures of a chessboard, likewise, in the order of the rig's sub-views", 0, 0, "cameras"},
    {"run", SV_OPT_TEXT, CAL_PHOTOMETRIC, 0, AT(run), "DIR",
     "or a scene: folder of a 'subview run --appearance cameras' with this rig, which measured the cameras",
     0, 0, 0},
    {"board", SV_OPT_TEXT, CAL_PHOTOMETRIC, 0, AT(board), "WxH", "inner corners of the chessboard: 9x6", 0, 0,
     0},
    {"model", SV_OPT_WORD, CAL_BOARD | CAL_LIVE, 0, AT(model),
     "LENSMODEL_PINHOLE|LENSMODEL_OPENCV4|LENSMODEL_OPENCV5|LENSMODEL_OPENCV8|LENSMODEL_SPLINED_"
     "STEREOGRAPHIC",
     "lens model [LENSMODEL_OPENCV5]; of fisheyes the last one", 0, 0, 0},
    {"flat", SV_OPT_FLAG, CAL_BOARD, 0, AT(is_flat), 0,
     "assume a flat board: do not estimate its deformation", 0, 0, 0},
    {"name", SV_OPT_TEXT, CAL_BOARD | CAL_LENSLETS, 0, AT(name), "NAME",
     "name of the rig [the folder's name]", 0, 0, 0},
    {"rig", SV_OPT_TEXT, CAL_CHECK, CAL_CHECK, AT(rig), "RIG", "rig: a folder with rig.json", 0, 0, 0},
    {"threads", SV_OPT_INT, ALL & ~(CAL_POSE | CAL_PRINT), 0, AT(threads), "N", "threads [all CPUs]", 1, 64,
     0},
    {"json", SV_OPT_FLAG, ALL, 0, AT(is_json), 0, "print one JSON object on stdout", 0, 0, 0},
    {"quiet", SV_OPT_FLAG, ALL, 0, AT(is_quiet), 0, "no progress messages on stderr", 0, 0, 0},
    {"out", SV_OPT_TEXT, CAL_BOARD | CAL_LENSLETS, CAL_BOARD | CAL_LENSLETS, AT(out), "RIG", "output folder",
     0, 0, 0},
    {"rig", SV_OPT_TEXT, CAL_POSE, CAL_POSE, AT(rig), "RIG", "folder with rig.json", 0, 0, 0},
    {"capture", SV_OPT_TEXT, CAL_POSE, CAL_POSE, AT(capture), "DIR", "capture folder", 0, 0, 0},
    {"out", SV_OPT_TEXT, CAL_POSE, CAL_POSE, AT(out), "POSES", "output folder", 0, 0, 0},
    {"help", SV_OPT_FLAG, ALL, 0, AT(is_help), 0, "show this help", 0, 0, 0},
    {"version", SV_OPT_FLAG, ALL, 0, AT(is_version), 0, "show the version", 0, 0, 0},
};

static const sv_options options = {.program = "subview-calibrate",
                                   .rows = table,
                                   .n_rows = (int)(sizeof table / sizeof *table),
                                   .is_empty_missing = true};

int cal_usage(const char *command, const char *fmt, ...) {
  va_list ap;
  va_start(ap, fmt);
  int e = sv_options_vusage(options.program, command, fmt, ap);
  va_end(ap);
  return e;
}

static int parse_board(const sv_tool_command *c, cal_options *o) {
  if (!o->board) return CAL_EXIT_OK;
  size_t n = strcspn(o->board, "xX");
  long long w, h;
  if (!o->board[n] || !sv_parse_int(o->board, n, &w) ||
      !sv_parse_int(o->board + n + 1, strlen(o->board + n + 1), &h) || w < 3 || h < 3 ||
      w > SV_BOARD_CAP_SIDE || h > SV_BOARD_CAP_SIDE)
    return cal_usage(c->name, "--board is WxH inner corners, each from 3 to %d, not '%.80s'",
                     SV_BOARD_CAP_SIDE, o->board);
  o->n_cols = (int)w;
  o->n_rows = (int)h;
  return CAL_EXIT_OK;
}

int cal_args_parse(const sv_tool_command *c, int argc, char **argv, cal_options *o) {
  *o = (cal_options){.spacing_m = -1,
                     .pitch_m = -1,
                     .focal_px = -1,
                     .dark = -1,
                     .threads = -1,
                     .feed_fd = -1,
                     .memory_mib = -1};
  int e = sv_options_parse(&options, c, argc, argv, o);
  if (o->is_help || o->is_version) return e;
  if (e == CAL_EXIT_OK && c->bit != CAL_PRINT && c->bit != CAL_PHOTOMETRIC &&
      (o->board != NULL) != (o->spacing_m >= 0))
    e = cal_usage(c->name, "--board and --spacing must be given together");
  // only lenslets has these
  if (e == CAL_EXIT_OK && o->board && (o->pitch_m >= 0 || o->focal_px >= 0))
    e = cal_usage(c->name, "--board cannot be combined with --pitch or --focal: the board gives both");
  return e != CAL_EXIT_OK ? e : parse_board(c, o);
}

void cal_args_help(const sv_tool_command *c) { sv_options_help(&options, c); }
