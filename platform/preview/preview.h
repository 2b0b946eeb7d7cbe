// SPDX-License-Identifier: Apache-2.0
// C only: the feed is.
// subview-preview: a small HTTP server over the feed of a running subview, in a process and a
// sandbox of its own. It reads the feed (src/port/feed.h) and writes single bytes into a pipe
// (platform/linux/preview.h); it opens no file and no other connection once it listens. One thread;
// everything that a client can make it hold is bounded.
//
//   GET  /            the page; /page.css, the scripts and /icon.svg belong to it
//   GET  /state       JSON: what the runtime does; /curve /events: its history; /calibration
//   GET  /stream      the same as server-sent events, four a second
//   GET  /cameras     all cameras' thumbnails as one picture, multipart/x-mixed-replace JPEG
//   GET  /camera?i=N  camera N as large as the feed has it; 404 until the runtime has published it
//   GET  /picture.jpg a training picture beside its rendering, made by the device
//   GET  /model       the Gaussians, compact (model.c); 204 when ?after=N is the newest
//   GET  /model.ply /model.splat /model.spz   downloads
//   GET  /history /history.svseq /history.ply the last seconds of a live run (history.h)
//   GET  /scans /scan/NUMBER/NAME             earlier scans (scan_routes.h)
//   POST /scan/NUMBER/delete /restore /purge  likewise, from the page that has control
//   POST /scan/NUMBER/sog /html /glb          likewise: asks for that file; the list has it when it
//                     is made
//   GET  /look-key    with the token: the secret of links that show and cannot control
//   POST /draft /normal /fine                 the budget of the next Start, as /start
//   POST /start /pause /save /new             with the token in X-Subview-Token, from the page that
//                                             has control (X-Subview-Page, control.h)
//   POST /mode?i=N    likewise: a mode of the cameras
//   POST /calibrate?board=9x6&mm=24           likewise: cameras and rig by a chessboard
//   POST /enter       likewise; the answer sets a cookie that reading takes, too. It gives the page
//                     a seat, which it keeps by asking again. With the look key: the cookie alone
//   POST /ask /give /keep    asks for control; the answers of the page that has it
//   POST /pin /qr     with the token: a PIN and a code for another device (access.h)
//   POST /pair        with the PIN in X-Subview-Pin: the answer is the token
//   GET  /board.svg /board.pdf   a chessboard to print
#ifndef SV_PLATFORM_PREVIEW_PREVIEW_H
#define SV_PLATFORM_PREVIEW_PREVIEW_H

#include "platform/preview/bundle.h"
#include "platform/preview/control.h"
#include "platform/preview/scans.h"
#include "src/base/str.h"
#include "src/port/feed.h"

// --- limits --------------------------------------------------------------------------------------
#define PV_CAP_CONNECTIONS 128
#define PV_CAP_PER_ADDRESS 24 // a browser has 6 at most
#define PV_CONNECTION_MEM  (32u << 10)
#define PV_IDLE_S          10 // without a byte
#define PV_REQUEST_S       10 // until a request is whole
#define PV_CAP_BODY        1024
#define PV_STALE_S         5 // without progress of a thread that has work

// --- bytes that several connections send at the same time ----------------------------------------
typedef struct {
  int n_users;
  uint64_t seq;
  size_t bytes;
  uint8_t *data;
} pv_blob;

pv_blob *pv_blob_make(size_t bytes, uint64_t seq); // one user; NULL: no memory
void pv_blob_drop(pv_blob *b);                     // NULL is fine

// --- the feed and what is made of it -------------------------------------------------------------
typedef enum { PV_PLY, PV_SPLAT, PV_SPZ, PV_N_FILES } pv_file;

typedef struct {
  sv_feed_reader reader;
  sv_feed_state state;
  sv_feed_modes modes;
  uint64_t modes_seq, state_seq, tiles_seq, model_seq, picture_seq, view_seq;
  sv_feed_tiles *tiles;
  uint8_t *model, *picture, *view; // a snapshot each
  size_t model_cap, picture_cap, view_cap;
  pv_blob *mosaic;                         // a part of /cameras
  pv_blob *compact;                        // /model
  pv_blob *jpeg;                           // /picture.jpg
  pv_blob *camera[SV_FEED_CAP_TILES];      // /camera
  int64_t next_look_ns[SV_FEED_CAP_TILES]; // when the runtime is told again that it is looked at
  pv_blob *file[PV_N_FILES];
  pv_blob *history; // /history.svseq
  void *codec;      // sv_codec of the pictures
  int stale_s;      // seconds without progress, 0: the run is well
  pv_control control;
  pv_scans scans;
  int command_fd; // to the runtime; -1: it takes no commands
  char sandbox[128];
} pv_source;

// tiles.c, model.c: memory for the largest snapshots of this feed. E_NOMEM.
sv_status pv_pictures_open(pv_source *s, sv_err *err) SV_MUST_USE;
sv_status pv_model_open(pv_source *s, sv_err *err) SV_MUST_USE;
// Brings s->state up to date; true when it changed.
bool pv_state_read(pv_source *s);
// Brings s->stale_s up to date from the heartbeats. A runtime that is stopped publishes nothing, so
// its state stays what it was.
void pv_stale_read(pv_source *s);
// state, curve, events as one line of JSON; a number that is not finite is null.
void pv_state_json(const pv_source *s, sv_str *out);
void pv_curve_json(const pv_source *s, sv_str *out);
void pv_events_json(const pv_source *s, sv_str *out);
void pv_calibration_json(const pv_source *s, sv_str *out);
// New thumbnails -> s->mosaic, as a part of a multipart stream, and the head of the next one:
// browsers show a picture when they have seen that. True when it changed.
#define PV_PART_HEAD "--frame\r\nContent-Type: image/jpeg\r\n\r\n"
bool pv_mosaic_read(pv_source *s);
void pv_mosaic_grid(int n_tiles, int *n_columns, int *n_rows);
// The newest picture as JPEG, NULL: there is none.
pv_blob *pv_picture_jpeg(pv_source *s);
// The newest full view of camera i as JPEG, NULL: there is none.
pv_blob *pv_camera_jpeg(pv_source *s, int i);
// The newest Gaussians: the compact form or a file. NULL: there are none.
pv_blob *pv_model_compact(pv_source *s);
pv_blob *pv_model_file(pv_source *s, pv_file kind);
// A file of a model with its rows behind it, checked. NULL: no memory.
pv_blob *pv_model_make(const sv_feed_model *m, pv_file kind);

// --- server and sandbox --------------------------------------------------------------------------
typedef struct {
  pv_source *source;
  const char *addr;
  int port, command_fd;
  const char *token;    // of PV_MIN_TOKEN to PV_CAP_TOKEN characters; empty: nothing can be changed
  const char *read_key; // the cookie's value: browsers send cookies to all ports of this machine
  const char *tls_pem;  // key and certificate; NULL: plain HTTP
  bool is_private;      // not on loopback: reading takes the token or the cookie
} pv_server_cfg;

typedef struct pv_server pv_server;
// Listens. The server is one of its process. E_DEVICE with the reason.
sv_status pv_server_open(pv_server **server, const pv_server_cfg *cfg, sv_err *err) SV_MUST_USE;
// Serves for at most timeout_ms.
void pv_server_step(pv_server *s, int timeout_ms);

// May a request with these headers be answered? host NULL: none was sent.
bool pv_host_is_ours(const char *host, int port, const char *machine_name);
bool pv_origin_is_ours(const char *origin, const char *scheme, const char *host);
// In a time that does not depend on where they differ. False for an empty token.
bool pv_token_is(const char *given, const char *token);
#define PV_MIN_TOKEN 16
#define PV_CAP_TOKEN 128
// E_ARG with a sentence: another length, or other characters than A-Z a-z 0-9 - _.
sv_status pv_token_check(const char *token, sv_err *err) SV_MUST_USE;

// Builds with sanitizers (SAN=...) run with a sandbox that is relaxed for their runtime; programs
// that are installed never do.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define PV_IS_SANITIZED 1
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define PV_IS_SANITIZED 1
#endif
#endif
#ifndef PV_IS_SANITIZED
#define PV_IS_SANITIZED 0
#endif

// At the start, before anything is opened: stdin is /dev/null, and all other descriptors but 1, 2,
// a_fd and b_fd (-1: none) are closed.
sv_status pv_sandbox_begin(int a_fd, int b_fd, sv_err *err) SV_MUST_USE;
// For a server that the user has started: a session of its own, without a terminal. This process
// stays behind to wait for its child, which returns from here.
void pv_sandbox_leave_terminal(void);
// From here on: user nobody when it was root, no capabilities, no new privileges, no output, no
// file, no new socket, no new process, no signal; Landlock where the kernel has it; killed when the
// parent ends. What took hold is written into text[cap]. E_DEVICE: a part of it could not be set,
// then nothing may be served.
sv_status pv_sandbox_enter(char *text, size_t cap, sv_err *err) SV_MUST_USE;
// The same for the helper of the scans, which keeps its user, the folder and its socket: reading,
// removing and renaming below the folder, no other file. False: a part of it could not be set.
bool pv_sandbox_enter_folder(int folder_fd, int socket_fd);
void pv_limits_set(size_t data_bytes);

#endif
