// SPDX-License-Identifier: Apache-2.0
// Other programs: what they print is read through a pipe. Owns the child until it is closed. Never
// runs a shell.
#ifndef SV_TOOLS_COMMON_PROGRAM_H
#define SV_TOOLS_COMMON_PROGRAM_H

#include <stddef.h>
#include <stdio.h>

#include "src/base/status.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  long pid;
  FILE *out; // what it prints on stdout
} sv_program;

// argv ends with NULL; the program is looked up in PATH. Its stdin is empty. E_NOT_FOUND: it is not
// there.
sv_status sv_program_start(sv_program *p, const char *const *argv, sv_err *err) SV_MUST_USE;
// Closes the pipe and waits. Its exit code; -1 when a signal ended it.
int sv_program_end(sv_program *p);
// All that it prints, at most cap bytes, terminated, in a malloc'ed block. E_DEVICE: it failed.
sv_status sv_program_text(const char *const *argv, size_t cap, char **text, sv_err *err) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
