// SPDX-License-Identifier: Apache-2.0
// --prior: knowledge beyond the captured images. external:CMD calls a program with a folder of
// renderings and passes the images and depth maps that it writes there to the core
// (src/prior/views.h; docs/priors.md is the folder's contract).
#ifndef SV_TOOLS_TRAIN_PRIOR_H
#define SV_TOOLS_TRAIN_PRIOR_H

#include "src/prior/methods.h"
#include "src/prior/views.h"
#include "src/train/driver.h"
#include "tools/lab/lab.h"
#include "tools/common/report.h"

#define LAB_PRIOR_VIEWS   8   // asked for in one call, unless said otherwise
#define LAB_PRIOR_LIMIT_S 600 // for one call

typedef struct {
  const lab_options *o;
  lab_session *session;
  sv_trainer *trainer;
  sv_prior *prior; // of that trainer
  const lab_views *views;
  sv_prior_method method;
  const char *command; // of external:, else NULL
  int n_views;         // of a call
  double limit_s, depth_unit;
  float next; // progress of the next call
  int n_calls, n_pictures, n_depths;
  int n_files, n_maps; // depth maps of the dataset, and of the views themselves
  int n_aligned;       // relative maps whose scale and shift were solved
  bool is_off;         // a call failed; training goes on without
  double seconds;
  sv_view *request;  // [n_views] of the last call
  uint8_t *rgba;     // [cap_pixels][4]
  uint16_t *units;   // [cap_pixels]
  float *map;        // [cap_pixels]
  char folder[1024]; // of the last call
} lab_prior;

// LAB_EXIT_OK, or LAB_EXIT_USAGE after one line.
int lab_prior_check(const lab_options *o);
// Room for what the prior will hand in. n_views: that are trained on.
void lab_prior_cfg(const lab_options *o, const lab_views *v, sv_prior_cfg *c);
// Depth maps of the dataset, then the first call, with the training pictures, then what a method
// needs: before the first step. A command that fails here stops the run. bounds, scratch: as for a
// stereo start.
typedef struct {
  lab_session *session;
  const lab_options *o;
  const lab_views *views;
  sv_prior *prior;
} lab_prior_input;
sv_status lab_prior_begin(lab_prior *p, const lab_prior_input *run, const sv_bounds *bounds,
                          sv_arena *scratch, sv_err *err) SV_MUST_USE;
// Before a step: calls when it is time. A call that fails is told in a line, and is the last.
void lab_prior_tick(lab_prior *p, float progress);
void lab_prior_report(lab_report *j, const lab_prior *p); // what came of it
void lab_prior_end(lab_prior *p);

// --- pieces --------------------------------------------------------------------------------------
// "CMD FOLDER" by the shell, in a group of its own, its stdout and stderr into `log`. E_TIMEOUT
// after limit_s, E_INTERRUPTED when a stop is requested, E_DEVICE when it cannot be started or
// fails; then the group is ended.
sv_status lab_prior_run(const char *command, const char *folder, const char *log, double limit_s,
                        const sv_console *console, sv_err *err) SV_MUST_USE;
// What came back for view i of a call (prior_answer.c): `id` of a view that has a number, -1: one
// of the request.
sv_status lab_prior_take(lab_prior *p, int i, int id, float until, sv_err *err) SV_MUST_USE;
// The depth maps that the dataset names (depth_prior, disparity_prior).
sv_status lab_prior_load(lab_prior *p, sv_err *err) SV_MUST_USE;

#endif
