// SPDX-License-Identifier: Apache-2.0
// A run as one line of shell, and the program that executes such lines. A line needs nothing but a
// shell and this program: GNU parallel, make or a batch system can run it, anywhere where the paths
// are the same. What a line's commands print stays in the run's folder, each under its own name
// once it is whole, so that a line that runs again does only what is missing.
#ifndef SV_TOOLS_TABLES_JOBS_H
#define SV_TOOLS_TABLES_JOBS_H

#include <stdio.h>

#include "src/base/str.h"
#include "tools/tables/tables.h"

#define TABLES_CAP_STEPS 4
#define TABLES_CAP_LINE  (8 * SV_CAP_PATH)

typedef struct {
  const char *file; // that it prints
  const char *args[40];
  long must_have_steps; // above 0: a training that ended before is not taken
} tables_step;

typedef struct {
  char folder[SV_CAP_PATH]; // of the run
  char what[200];           // in words
  tables_step step[TABLES_CAP_STEPS];
  int n;
  bool is_model_kept;
} tables_job;

// OUT/runs/KEY.
sv_status tables_job_begin(tables_job *j, const tables *t, const char *key, sv_err *err) SV_MUST_USE;
// A command of this program; its arguments follow with tables_job_add, and must outlive the job.
tables_step *tables_job_step(tables_job *j, const char *file, const char *command);
void tables_job_add(tables_step *s, const char *option, const char *value); // value NULL: a flag
// The line, with its end.
void tables_job_line(const tables_job *j, const tables *t, FILE *f);

// A file of the run, as text: malloc'ed. E_NOT_FOUND: it is not there.
sv_status tables_job_read(const tables_job *j, const char *file, char **text, sv_err *err) SV_MUST_USE;
// A file that cannot be used: says so and, unless results are only collected, removes it.
void tables_job_drop(const tables_job *j, tables *t, const char *file, const sv_err *why);

// Executes the lines of a file, t->n_jobs at a time by GNU parallel, or one after the other where
// it is not installed. E_INTERRUPTED after a stop request, when no job is left; E_DEVICE: one
// failed.
sv_status tables_jobs_run(tables *t, const char *path, sv_err *err) SV_MUST_USE;

#endif
