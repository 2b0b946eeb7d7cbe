// SPDX-License-Identifier: Apache-2.0
// The options of all commands, in one table (args.c) for platform/linux/options.h, and what goes
// together.
#ifndef SV_TOOLS_LAB_ARGS_H
#define SV_TOOLS_LAB_ARGS_H

#include <stdbool.h>
#include <stdint.h>

#include "src/dynamic/dynamic.h"
#include "platform/linux/options.h"

#define LAB_EXIT_OK     SV_OPTIONS_OK
#define LAB_EXIT_FAILED 1
#define LAB_EXIT_USAGE  SV_OPTIONS_USAGE

enum {
  LAB_TRAIN = 1,
  LAB_EVAL = 2,
  LAB_RENDER = 4,
  LAB_EXPORT = 8,
  LAB_IMPORT = 16,
  LAB_BENCH = 32,
  LAB_TABLES = 64,
  LAB_COMPARE = 128,
  LAB_MESH = 256,
  LAB_MEASURE = 512,
  LAB_INFO = 1024
};

// NULL and -1 stand for "not given"; a given number is inside its range.
typedef struct {
  const char *data, *transforms, *model, *split, *out, *format, *up, *from, *input;
  const char *viewer, *crop; // export
  const char *method, *motion, *camera, *prior, *init, *background, *loss, *mask, *mask_with, *masks, *noise,
      *antialias, *optimizer, *appearance;
  bool is_opened; // of train: --open
  bool is_noise_on_prediction;
  const char *plan; // of tables, like the next two
  bool is_collected, is_sub_views;
  long n_jobs;
  long exposures, gaussians, sh, steps, scale, seed, threads, orbit, frames, keep, spz_version;
  double time_limit_s, baseline_m, focal_px, focus_m;
  const char *rig, *stream;
  const char *refine, *free_lenses, *images, *white; // of import, like the next two
  const char *clock;
  const char *lpips_vgg; // of train and eval
  double every_s;        // below 0: not given
  const char *film;      // of render
  double unit_m;         // 0: not given
  double distance_m;     // of info
  double voxel;          // of mesh
  const char *measure_from, *measure_to;
  long view;             // of measure
  long faces;            // of mesh; 0: all
  long min_views;        // of mesh and --keep-supported
  sv_option_list models; // of compare
  const char *labels;
  long n_views, width_px;
  long prior_views, prior_calls;
  double prior_limit_s, prior_weight;
  bool is_refining, is_eval, is_json, is_quiet, is_quick, is_supported, has_depth, has_lpips, is_help,
      is_version;
  // Of --loss; below 0: not given
  float ssim, tv, opacity, size, tv_novel, n_novel, novel_every, novel_px, novel_deg, region_px, min_scale_px,
      dilation_px2, supersample, dropout;
  float noise_read, noise_shot; // of --noise, 0: none
} lab_options;

typedef struct {
  sv_tool_command c;
  int (*run)(const lab_options *o);
} lab_command;

// LAB_EXIT_OK, or LAB_EXIT_USAGE after one line on stderr. Strings stay where argv has them.
int lab_args_parse(const sv_tool_command *c, int argc, char **argv, lab_options *o);
void lab_args_help(const sv_tool_command *c); // on stdout
// Sets what --motion says in *d. text may be NULL: clip. LAB_EXIT_USAGE when it cannot be read.
int lab_parse_motion(const char *text, sv_dynamic_cfg *d);
// --out of render that names a film instead of a folder.
bool lab_is_film(const char *path);
// One line: "subview-lab train: TEXT; try 'subview-lab train --help'". Returns LAB_EXIT_USAGE.
int lab_usage(const char *command, const char *fmt, ...) SV_PRINTF(2, 3);

#endif
