// SPDX-License-Identifier: Apache-2.0
// Instructions of a fixed run, function by function, against those on record. Unlike times they are
// the same on a busy machine, to the instruction: a few per cent more work shows.
//
// The record is a CSV: lines that begin with '#', of which "# compiler NAME" says whose code was
// counted, then isa,function,instructions.
#ifndef SV_TESTS_BUDGET_COUNTS_H
#define SV_TESTS_BUDGET_COUNTS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define COUNTS_CAP_ROWS 200
#define COUNTS_WORSE    0.03 // more than that is red

typedef struct {
  char isa[8], function[64];
  uint64_t instructions; // with those of what it calls
} counts_row;

typedef struct {
  char compiler[80];
  int n_rows;
  counts_row row[COUNTS_CAP_ROWS];
} counts_table;

// The compiler of this program.
const char *counts_compiler(void);
// Reads a record; false with one sentence in err when there is none or a line is not as above.
bool counts_read(counts_table *t, const char *path, char *err, size_t cap);
bool counts_write(const counts_table *t, const char *path);
// Adds to t the functions of a file that callgrind wrote with --compress-strings=no
// --compress-pos=no: the kernels of the table and the stages of a step. False when it cannot be
// read or holds none.
bool counts_add_callgrind(counts_table *t, const char *path, const char *isa);
const counts_row *counts_find(const counts_table *t, const char *isa, const char *function);
// Rows of `now` that take more than COUNTS_WORSE above the record; one sentence a row in text (may
// be cut).
int counts_compare(const counts_table *record, const counts_table *now, char *text, size_t cap);

#endif
