// SPDX-License-Identifier: Apache-2.0
// C only: the feed is.
// The live view of `subview run`: its feed, its server, and what a first run tells.
#ifndef SV_BOARDS_PREVIEW_H
#define SV_BOARDS_PREVIEW_H

#include "boards/board_main.h"
#include "boards/run_options.h"
#include "platform/linux/preview.h"

// Makes the feed, opens the screen and starts the server as the options say, and prints the link on
// stderr. Nothing without --preview, --feed and --display. A screen that is missing costs a session
// its picture, and any other run is refused.
sv_status preview_open(const run_options *o, sv_err *err) SV_MUST_USE;
void preview_publish(sv_publish *p); // fills in the live part; nothing when it is not open
// The screen of --display, with the page's link; begin is NULL when there is none.
sv_display preview_display(void);
sv_beat_of *preview_beats(void); // where the page looks for heartbeats; NULL: it is not open
typedef struct {
  sv_feed_cause cause;
  const char *sentence;
} preview_failure;
typedef enum { PREVIEW_STOP, PREVIEW_NEW, PREVIEW_RETRY, PREVIEW_CALIBRATE } preview_answer;
// A run that could not begin: the page says why. In a session: waits for New or a stop request. One
// that keeps scans (--keep) tries cameras again after some seconds.
preview_answer preview_failed(const run_options *o, const preview_failure *why, const sv_console *console,
                              sv_heartbeats *beats);
// The session's source string with the mode that the page chose; the options' own otherwise.
const char *preview_source(const char *source);
// The chessboard of the newest request to calibrate, and whether the lenses are fisheyes.
typedef struct {
  int n_cols, n_rows;
  double spacing_m;
  bool is_fisheye;
} preview_calibration;
preview_calibration preview_board(void);
void preview_close(void);

// What is there, a line each: board, cameras, rig, memory, folder, page.
void check_list(const run_options *o, const board_source *src, const sv_arena *arena, const sv_kernels *k);
// "[--] WHAT: SENTENCE".
void check_list_fails(const char *what, const char *sentence);

#endif
