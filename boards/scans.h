// SPDX-License-Identifier: Apache-2.0
// Numbered scans below one folder, as a service keeps them: 0001, 0002, ... Owns nothing; the
// scans' files are the runs'.
// Never removes a scan that is not yet older than the newest N, nor a folder without a number.
#ifndef SV_BOARDS_SCANS_H
#define SV_BOARDS_SCANS_H

#include <stdbool.h>
#include <stddef.h>

#include "src/base/status.h"

// Fills in path and is_interrupted, the folder of the next run: that of the newest scan if it left
// a checkpoint and no report (it was interrupted) or nothing at all, else a new one. is_new: always
// a new one, unless the newest is empty. Then removes the oldest scans beyond n_kept.
typedef struct {
  char *path; // [cap]
  size_t cap;
  bool is_interrupted;
} scans_run;
sv_status scans_next(const char *folder, int n_kept, bool is_new, scans_run *out, sv_err *err) SV_MUST_USE;

#endif
