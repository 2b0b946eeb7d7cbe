// SPDX-License-Identifier: Apache-2.0
// C only: the feed is.
// The preview on Linux: the feed in shared memory, and the program that serves it. `subview`
// opens no socket: it starts subview-preview, hands it the feed (read-only) and the writing end of
// a pipe for the person's commands, and starts it again when it ends or hangs. Everything here is
// made before the run; nothing allocates afterwards.
#ifndef SV_PLATFORM_LINUX_LIVE_H
#define SV_PLATFORM_LINUX_LIVE_H

#include <sys/types.h>

#include "platform/linux/exporter.h"
#include "src/port/feed.h"
#include "src/port/port.h"

// What subview-preview writes into the pipe, a byte each.
#define SV_PREVIEW_READY   'r' // it listens
#define SV_PREVIEW_BEAT    'b' // about once a second
#define SV_PREVIEW_REFUSED 'x' // it cannot work and has said why; do not restart it
#define SV_PREVIEW_START   's'
#define SV_PREVIEW_PAUSE   'p'
#define SV_PREVIEW_SAVE    'v'
#define SV_PREVIEW_NEW     'n'
// With five bytes: columns and rows of inner corners, the side of a square in units of 0.1 mm, the
// high byte first, and 1 for fisheyes, else 0. All six in one write.
#define SV_PREVIEW_CALIBRATE 'c'
// With five bytes: a format (sv_linux_export_format) and the number of a scan, the high byte first;
// all in one write.
#define SV_PREVIEW_EXPORT 'e'
// With a byte, the number of a mode (sv_feed_modes), both in one write.
#define SV_PREVIEW_MODE 'm'
// With a byte, the camera's number, both in one write: somebody looks at it in full view.
#define SV_PREVIEW_LOOK    'w'
#define SV_PREVIEW_HISTORY 'h' // of a live run, into the feed
#define SV_PREVIEW_NORMAL  '1' // before Start
#define SV_PREVIEW_DRAFT   '2'
#define SV_PREVIEW_FINE    '3'

typedef struct {
  sv_feed feed;
  void *block;
  size_t block_bytes;
  int feed_fd, pipe_fd[2];                  // -1: not open
  char program[512], listen[64], token[40]; // of subview-preview
  // Earlier scans for the page (subview-preview --scans --scan-name); empty: none
  char scans[512], scan_name[128];
  char *argv[24];
  const char *tls_file; // of --tls, set before serve; NULL: plain HTTP
  pid_t pid;            // 0: not running
  sv_ns started_ns, beat_ns, next_start_ns, next_look_ns;
  bool is_served, is_refused;
  uint32_t n_restarts;
  sv_feed_modes modes;        // of the cameras; set before serve, i_mode by the page
  sv_ns looked_until_ns[32];  // of each camera
  sv_linux_exporter exporter; // of scans
  struct {
    int n_cols, n_rows;
    double spacing_m;
    bool is_fisheye; // the cameras' lenses
  } board;           // of the newest SV_COMMAND_CALIBRATE
} sv_linux_preview;

// Of the largest model and history (sv_feed_init).
typedef struct {
  uint32_t gaussians, floats;
  size_t history_bytes;
} sv_linux_preview_caps;
// Makes the feed (a sealed memfd) and the pipe. *live stays where it is.
sv_status sv_linux_preview_open(sv_linux_preview *live, const sv_linux_preview_caps *caps,
                                sv_err *err) SV_MUST_USE;
// Starts subview-preview, which lies beside this program, on ADDR:PORT, and waits until it listens
// (3 s at most). live->token: kept when it is set, else a new one. program NULL: beside
// /proc/self/exe. E_DEVICE with an empty sentence: subview-preview has said on stderr why it
// cannot.
sv_status sv_linux_preview_serve(sv_linux_preview *live, const char *program, const char *addr, int port,
                                 sv_err *err) SV_MUST_USE;
// The port's view: feed, commands (which also looks after the server).
// Hands the list of modes to the page.
void sv_linux_preview_show_modes(sv_linux_preview *live);
void sv_linux_preview_publish(sv_linux_preview *live, sv_publish *p);
void sv_linux_preview_close(sv_linux_preview *live); // ends the server, too

// "[ADDR:]PORT"; without ADDR 127.0.0.1. ADDR: a numeric address, IPv6 in brackets. E_ARG.
sv_status sv_linux_preview_parse(const char *text, char *addr, size_t cap_addr, int *port,
                                 sv_err *err) SV_MUST_USE;

#endif
