// SPDX-License-Identifier: Apache-2.0
// C only: the runtime's counters are atomic.
// What the files of `subview` share: options, output without heap, sources. The files in this
// folder are the only ones that see board, platform and runtime together.
#ifndef SV_BOARDS_BOARD_MAIN_H
#define SV_BOARDS_BOARD_MAIN_H

#include <stdbool.h>
#include <stddef.h>

#include "include/subview/version.h"
#include "platform/camera/pulses.h"
#include "platform/camera/tiled.h"
#include "platform/codec/codec.h"
#include "platform/libcamera/libcamera.h"
#include "platform/linux/linux.h"
#include "platform/linux/options.h"
#include "platform/replay/replay.h"
#include "platform/sim/sim.h"
#include "platform/v4l2/v4l2.h"
#include "src/run/app.h"
#include "src/format/rig_file.h"
#include "src/rig/sizes.h"

#define EXIT_USAGE   2
#define EXIT_RESCUED 3 // a run: done, but saved in the second place
#define VERSION      SUBVIEW_VERSION

// --- options -------------------------------------------------------------------------------------
// Each command's struct of options begins with a member `common` of this type, and its table ends
// with OPTIONS_COMMON.
typedef struct {
  bool is_help, is_version;
} options_common;

#define OPTIONS_COMMON(type)                                                                                 \
  {"help", SV_OPT_FLAG, 1, 0, offsetof(type, common.is_help), NULL, "this text", 0, 0, NULL},                \
      {"version", SV_OPT_FLAG, 1, 0, offsetof(type, common.is_version), NULL, "the version", 0, 0, NULL},

// Parses argv[1..] of a command into the struct at `to`. 0; EXIT_USAGE after one line on stderr; -1
// when --help or
// --version was printed.
int options_parse(const sv_tool_command *command, const sv_option *rows, int n_rows, int argc, char **argv,
                  void *to);
// One line "subview COMMAND: TEXT; try 'subview COMMAND --help'" on stderr. Returns EXIT_USAGE.
int usage_error(const char *command, const char *fmt, ...) SV_PRINTF(2, 3);
void print_version(void);
// "WxH", each 1 to 16384.
bool size_of(const char *text, int *width_px, int *height_px);
// --sync: a sv_sync_method; -1: unknown.
int sync_mode_of(const char *name);
// Text to a file descriptor in one write, without stdio's buffers.
void say(int fd, const char *fmt, ...) SV_PRINTF(2, 3);
// "subview: TEXT" on stderr. Returns 1.
int fail_with(const sv_err *err);

// --- the board's one block -----------------------------------------------------------------------
// An arena over all of it; a second one in the same program is over the same memory.
sv_status board_arena(sv_arena *arena, sv_err *err) SV_MUST_USE;
// Kernels of this CPU, or of SV_ISA, and the mask they were chosen by. False after a message.
bool board_kernels(sv_kernels *k, uint32_t *mask);

// --- sources -------------------------------------------------------------------------------------
typedef enum { SOURCE_NONE, SOURCE_SIM, SOURCE_REPLAY, SOURCE_V4L2, SOURCE_LIBCAMERA } source_kind;
typedef struct {
  source_kind kind;
  union {
    sv_sim sim;
    sv_replay replay;
    sv_v4l2 v4l2;
    sv_libcamera *libcamera;
  } u;
  sv_tiled tiled;
  sv_pulses pulses;   // of an external trigger
  sv_trigger trigger; // what the source string says of it
  // of each camera of the source inside of tiles, by the rig's photometric calibration; else 1
  float response[SV_CAMERA_CAP_CAMERAS];
  sv_rig rig_read;      // from files, or assumed
  const sv_rig *rig;    // NULL: none, and none was needed
  sv_camera_caps *caps; // [n_cameras]
  sv_source source;
  sv_clock clock;
  sv_codec codec; // of compressed frames
  sv_decoder decoder;
  char note[256];  // what the user should know, or ""
  bool is_virtual; // the clock is the source's own, not the machine's
  bool has_bounds;
  sv_bounds bounds;
  char rig_dir[SV_CAPTURE_CAP_PATH];
} board_source;

#define SOURCE_KINDS "sim:SCENE, replay:DIR, v4l2:/dev/videoN or libcamera:N"

typedef struct {
  // The source string: SOURCE_KINDS, several cameras separated by commas, then options
  const char *spec;
  const char *rig_path;   // folder of the rig; NULL: the source's own rig
  int n_exposures;        // that will be captured, for sources of a known length; 0: not known
  bool needs_rig;         // without a rig E_NOT_FOUND; else rig stays NULL
  bool reads_shutters;    // --shutter rolling: shutters_read
  bool is_triggered;      // --sync trigger: the line is opened, too
  sv_reduction reduction; // of the images for training; k 1, or all 0: none
} source_cfg;

// Opens a source inside the arena. Options of all sources: tiles=CxR (one image holds C x R
// cameras), fov=DEG (of a single camera without a rig, for which a pinhole lens is then assumed).
sv_status source_open(board_source *s, const source_cfg *cfg, sv_arena *arena, sv_err *err) SV_MUST_USE;
void source_close(board_source *s);
// The accelerations of a file (imu.c), in the arena.
sv_status imu_read(sv_imu *imu, const char *path, sv_arena *arena, sv_err *err) SV_MUST_USE;
bool source_tells_poses(const board_source *s); // of all exposures; else of none

// Fits the rig to what the cameras deliver and makes its images smaller (sizes.c).
sv_status sizes_fit(board_source *s, const source_cfg *cfg, sv_arena *arena, sv_err *err) SV_MUST_USE;
// Makes a sub-view's pictures and its mask smaller.
sv_status sizes_reduce(sv_sub_view *v, const sv_reduction *r, sv_arena *arena, sv_err *err) SV_MUST_USE;

// Readout times of sub-views whose rig has none, from the cameras. E_NOT_FOUND names one that does
// not report it (sizes.c).
sv_status shutters_read(board_source *s, sv_arena *arena, sv_err *err) SV_MUST_USE;

// --- the trigger line (trigger.c) ----------------------------------------------------------------
// An option trigger=, trigger-period=, trigger-width=, trigger-polarity= or trigger-mode= of the
// source string; AGAIN: the word is another option.
sv_status trigger_option(sv_trigger *t, const char *word, size_t n, sv_err *err);
// Opens the line that the source string or the rig names. E_UNSUPPORTED and others with the reason
// why this source has none. caps get the rate of the pulses.
sv_status trigger_open(board_source *s, sv_err *err) SV_MUST_USE;
// "trigger": {...} with the figures of the pulses; adds nothing where there was no line.
void trigger_report(sv_str *out, const board_source *s);
// A line for people: how late the pulses were.
void trigger_say(const board_source *s);
// Gives the line back, and says so if it failed.
void trigger_close(board_source *s);

// Pictures of coverage and masks that names tells of, decoded into the arena at footprint.coverage
// and mask; dir is for sentences. What is needed only meanwhile is given back.
sv_status coverage_read(sv_rig *rig, const sv_coverage_names *names, const sv_file_reader *files,
                        const char *dir, sv_arena *arena, sv_err *err) SV_MUST_USE;
// Writes <sub-view>.coverage.png and <sub-view>.mask.png of each sub-view that has them, and fills
// in names for rig.json.
sv_status coverage_write(const sv_rig *rig, sv_coverage_names *names, const sv_store *st, sv_arena *arena,
                         sv_err *err) SV_MUST_USE;

// --- commands ------------------------------------------------------------------------------------
int cmd_run(int argc, char **argv);
int cmd_capture(int argc, char **argv);
int cmd_cameras(int argc, char **argv);
int cmd_plan(int argc, char **argv);
int cmd_selftest(int argc, char **argv);
int cmd_status(int argc, char **argv);
int cmd_bench(int argc, char **argv);

#endif
