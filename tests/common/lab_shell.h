// SPDX-License-Identifier: Apache-2.0
// subview-lab as a user runs it, from a shell in a folder of the test's own.
#ifndef SV_TESTS_COMMON_LAB_SHELL_H
#define SV_TESTS_COMMON_LAB_SHELL_H

#include <stdbool.h>

typedef struct {
  char root[256]; // "" before it is made
  char lab[512];  // the program
  char said[64 << 10];
  const char *cwd;      // below root; "": root itself
  bool is_stdout_apart; // `said` is stderr alone, stdout goes to out.txt
  bool is_ready;        // set by who has prepared it
} lab_shell;

// Finds the program in the folder SV_BIN and makes root. 0; 1: it is not here, or would run under
// emulation, which its starting itself again does not survive; -1: failed.
int lab_shell_open(lab_shell *s, const char *name);
int lab_shell_close(lab_shell *s); // removes root; 0 when it is gone
// A command; @ stands for the program. Its exit code, or 128 and the signal; `said` is what it
// printed.
int lab_shell_run(lab_shell *s, const char *line);
void lab_shell_run_well(lab_shell *s, const char *line); // fails the test otherwise
void lab_shell_need(const lab_shell *s);                 // skips the test when it is not ready

#endif
