// SPDX-License-Identifier: Apache-2.0
// C only: board_main.h holds the runtime.
// The options of `subview run`.
#ifndef SV_BOARDS_RUN_OPTIONS_H
#define SV_BOARDS_RUN_OPTIONS_H

#include "boards/board_main.h"

typedef struct {
  options_common common;
  const char *source, *rig, *scene, *out, *rescue, *sub_views, *sync, *preview, *token_file, *console, *tls,
      *display, *config, *capture_cpu;
  long exposures, steps, gaussians, sh, threads, seed, skew_ms, orbit, keep;
  double time_limit, save_every, picture_every;
  double exposure_s, history_s;
  const char *shutter; // auto or global
  const char *imu;     // its file, or NULL
  const char *every;   // NULL: as the source suits
  double hold_out, arc_deg;
  bool is_mesh;
  const char *quality;    // draft, normal or fine; NULL: --steps alone
  double least_db_per_s;  // of --quality, else 0
  bool is_held_released;  // of --quality without --hold-out
  double every_s;         // of --every
  bool is_by_motion;      // likewise
  long scale;             // of --scale, at least 1
  const char *size;       // of --size, or NULL
  sv_reduction reduction; // of both
  const char *depth;      // 8 or 16
  const char *appearance; // auto, off, cameras or exposures
  const char *optimizer;  // NULL: the one that suits the exposures
  const char *prior;
  int i_prior; // an sv_prior_method
  sv_appearance_mode appearance_mode;
  int i_optimizer; // an sv_optimizer, -1
  bool is_dynamic, is_refining, is_blur_kept;
  bool is_interrupted; // of --keep: the scan in --out was, and starts at once
  bool is_overwriting;
  bool is_resume, is_continuous, is_json, is_quiet, is_session, has_feed, is_check;
  char preview_addr[64];    // of --preview; port 0: none
  int preview_port, i_sync; // of --sync, in the order of sv_sync_method
  int i_capture_cpu;        // -1: none
} run_options;

// 0; the exit code after a message; -1 when --help was printed.
int run_options_parse(int argc, char **argv, run_options *o);

#endif
