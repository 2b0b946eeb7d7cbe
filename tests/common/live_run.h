// SPDX-License-Identifier: Apache-2.0
// `subview run --preview` as a process of a test, and plain HTTP requests to it.
#ifndef SV_TESTS_COMMON_LIVE_RUN_H
#define SV_TESTS_COMMON_LIVE_RUN_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/types.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  // Set before start: listens on all addresses, not on loopback; may not replace an earlier model.
  bool is_open, is_guarded;
  pid_t pid;
  int port;
  char token[40], link[128], folder[300];
  char err[4096]; // what it wrote to stderr, after start and stop
} live_run;

// Starts SV_BIN/subview run ARGS --preview PORT --out FOLDER/out and waits for its link. "@" in
// args: the folder.
bool live_run_start(live_run *r, const char *folder, const char *args);
// Waits for its own end; the exit code, -1 when it takes longer.
int live_run_wait(live_run *r, double seconds);
int live_run_stop(live_run *r); // SIGINT, then wait
long live_run_rss_kib(const live_run *r);
pid_t live_run_server(const live_run *r); // process number of its subview-preview, 0: none

// A connection to it, -1. From 127.0.0.HOST: each such address is a client of its own.
int live_run_connect(const live_run *r);
int live_run_connect_from(const live_run *r, int host);
// One request, headers as they are (NULL: none; lines end with \r\n); the whole answer with
// headers.
size_t live_run_get(const live_run *r, const char *path, const char *headers, uint8_t *out, size_t cap);
size_t live_run_request(const live_run *r, const char *method, const char *path, const char *headers,
                        uint8_t *out, size_t cap);
int live_run_code(const uint8_t *answer);                             // of the status line, 0: none
const uint8_t *live_run_body(const uint8_t *answer, size_t n_answer); // NULL: there is none

#ifdef __cplusplus
}
#endif
#endif
