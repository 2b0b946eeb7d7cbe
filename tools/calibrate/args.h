// SPDX-License-Identifier: Apache-2.0
// The options of all commands, in one table (args.c) for platform/linux/options.h, and what goes
// together.
#ifndef SV_TOOLS_CALIBRATE_ARGS_H
#define SV_TOOLS_CALIBRATE_ARGS_H

#include <stdbool.h>

#include "platform/linux/options.h"

#define CAL_EXIT_OK     SV_OPTIONS_OK
#define CAL_EXIT_FAILED 1
#define CAL_EXIT_USAGE  SV_OPTIONS_USAGE

enum {
  CAL_BOARD = 1,
  CAL_LENSLETS = 2,
  CAL_POSE = 4,
  CAL_CHECK = 8,
  CAL_SHUTTER = 16,
  CAL_PRINT = 32,
  CAL_NOISE = 64,
  CAL_LIVE = 128,
  CAL_PHOTOMETRIC = 256
};

// NULL and -1 stand for "not given"; a given number is inside its range.
typedef struct {
  sv_option_list images; // of --images: one for each camera
  sv_option_list whites; // of --white, likewise
  const char *board, *model, *out, *name, *rig, *isolated, *white, *capture, *paper, *run;
  int n_cols, n_rows; // of --board
  double spacing_m, pitch_m, focal_px, dark;
  long threads, feed_fd, memory_mib;
  bool is_flat, is_linear, is_json, is_quiet, is_help, is_version;
} cal_options;

typedef struct {
  sv_tool_command c;
  int (*run)(const cal_options *o);
} cal_command;

// CAL_EXIT_OK, or CAL_EXIT_USAGE after one line on stderr. Strings stay where argv has them.
int cal_args_parse(const sv_tool_command *c, int argc, char **argv, cal_options *o);
void cal_args_help(const sv_tool_command *c); // on stdout
// One line: "subview-calibrate board: TEXT; try 'subview-calibrate board --help'". Returns
// CAL_EXIT_USAGE.
int cal_usage(const char *command, const char *fmt, ...) SV_PRINTF(2, 3);

#endif
