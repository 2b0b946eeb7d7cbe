// SPDX-License-Identifier: Apache-2.0
// C only: sv_app is.
// Capture: from the cameras to the pool of exposures, first until the pool is full, and, in a
// continuous run, on while training goes on. Owns the cameras while they run, the thread that
// serves them, and the share of time between capture and training. Never trains, and never waits
// for a training step.
#ifndef SV_CAPTURE_CAPTURE_H
#define SV_CAPTURE_CAPTURE_H

#include <stdatomic.h>

#include "src/base/status.h"
#include "src/capture/governor.h"

typedef struct sv_app sv_app;

typedef struct {
  sv_governor governor;     // of a continuous run
  bool is_running;          // cameras run
  bool has_worker;          // and the port's worker serves them
  _Atomic bool is_ending;   // the worker is to return
  sv_ns machine_ns;         // up to which the cameras' virtual clock has followed the machine's
  uint64_t n_device_errors; // of all cameras
  uint64_t n_bad_exposures; // complete, but a compressed image in it was damaged: not kept
} sv_capture_side;

// Fills the pool. In a continuous run the cameras go on; otherwise, and when the source has ended,
// they are stopped.
sv_status sv_app_capture(sv_app *app, sv_err *err) SV_MUST_USE;
// Between capture and training: locates the exposures of a source without poses, or logs that the
// rig is assumed to be stationary (track.c).
sv_status sv_app_track(sv_app *app, sv_err *err) SV_MUST_USE;

// A continuous run's capture side: on the port's worker thread when there is one, else (virtual
// clocks) in turns between training steps. Between begin and end the queue belongs to it. All do
// nothing when the cameras are stopped.
sv_status sv_app_continuous_begin(sv_app *app, sv_err *err) SV_MUST_USE;
// One piece of work that is not training, if one is due; *is_train: none was, train.
sv_status sv_app_continuous_turn(sv_app *app, bool *is_train, sv_err *err) SV_MUST_USE;
// A training step took so long
void sv_app_continuous_trained(sv_app *app, double from_s, double now_s);
sv_status sv_app_continuous_end(sv_app *app, sv_err *err) SV_MUST_USE;

#endif
