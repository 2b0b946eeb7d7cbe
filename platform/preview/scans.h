// SPDX-License-Identifier: Apache-2.0
// The scans of a folder for the page: list, files, delete with undo. The page's server can open no
// file, so a helper process does, in a sandbox that reaches that folder alone: it is asked by
// number over a socket, opens only files of the names below, and hands the server descriptors to
// read.
// Never follows a link, never touches a folder that is no scan.
#ifndef SV_PLATFORM_PREVIEW_SCANS_H
#define SV_PLATFORM_PREVIEW_SCANS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "src/base/status.h"
#include "src/base/str.h"

#ifdef __cplusplus
extern "C" {
#endif

#define PV_CAP_SCANS   256 // listed: the newest
#define PV_N_SCAN_FILE 11  // pv_scan_file_name
// The last of these are made of the model on request, and not listed when it is newer.
#define PV_N_SCAN_MADE 3
#define PV_UNDO_S      600 // a deleted scan can be restored so long, then it goes

// Where scans are. name empty: FOLDER/0001, FOLDER/0002, ...; else FOLDER/NAME (number 1),
// FOLDER/NAME-2, FOLDER/NAME-3, ...
typedef struct {
  const char *folder, *name;
} pv_scans_place;

typedef enum { PV_SCANS_LIST, PV_SCANS_OPEN, PV_SCANS_DELETE, PV_SCANS_RESTORE, PV_SCANS_PURGE } pv_scans_op;

typedef struct {
  uint32_t op, file, number;
  int64_t from; // first byte to read; below 0: counted from the end
} pv_scans_ask;

typedef struct {
  uint32_t number, is_deleted;
  int64_t time_s;                      // of its model, since 1970
  uint64_t bytes;                      // of all its files
  uint64_t file_bytes[PV_N_SCAN_FILE]; // 0: it has none
} pv_scan;

typedef struct {
  int32_t error; // errno, 0: done
  uint32_t n;
  uint64_t free_bytes, total_bytes; // of the disk
  uint64_t file_bytes;              // of the opened file
  pv_scan scan[PV_CAP_SCANS];       // newest first
} pv_scans_answer;

const char *pv_scan_file_name(int i); // "model.ply"; NULL beyond the last
// Name of a scan's folder. False: cap is too small.
bool pv_scan_folder_name(const pv_scans_place *p, uint32_t number, char *out, size_t cap);

// --- the helper's side (scans_helper.c) ----------------------------------------------------------
// Starts the helper; *fd is the server's end of the socket. Call it before the server's sandbox.
sv_status pv_scans_start(const pv_scans_place *p, int *fd, sv_err *err) SV_MUST_USE;
// The helper's answer to one question. *file_fd: an opened file, -1: none.
void pv_scans_do(int folder_fd, const char *name, const pv_scans_ask *ask, pv_scans_answer *a, int *file_fd);

// --- the server's side (scans.c) -----------------------------------------------------------------
typedef struct {
  pv_scans_place place;
  int fd;           // -1: there are no scans to show
  bool has_exports; // the last files can be made
  pv_scans_answer answer;
} pv_scans;
// Asks, and waits for the answer 2 s at most. E_IO: the helper is gone or late. file_fd NULL: none
// is wanted.
sv_status pv_scans_request(pv_scans *s, pv_scans_ask ask, int *file_fd) SV_MUST_USE;
// The list as one line of JSON.
void pv_scans_json(pv_scans *s, sv_str *out);

#ifdef __cplusplus
}
#endif
#endif
