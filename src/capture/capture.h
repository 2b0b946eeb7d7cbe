// SPDX-License-Identifier: Apache-2.0
// C only: its counters are atomic.
// Capture: from the cameras to the pool of exposures, first until the pool is full, and, in a
// continuous run, on while training goes on. Owns the cameras while they run, the thread that
// serves them, and the share of time between capture and training; borrows queue and pool. Never
// trains, never waits for a training step, and knows the run by callbacks alone.
#ifndef SV_CAPTURE_CAPTURE_H
#define SV_CAPTURE_CAPTURE_H

#include <stdatomic.h>

#include "src/base/status.h"
#include "src/capture/exposures.h"
#include "src/capture/governor.h"
#include "src/capture/guidance.h"
#include "src/capture/odometry.h"
#include "src/sync/capture_queue.h"

#define SV_CAPTURE_CAP_CLOUD 512 // points that guidance weighs the regions by

// What a run answers. self is its own.
typedef struct {
  void *self;
  void (*log)(void *self, sv_log_level level, const char *line);
  // Before each piece of work: below 0 ends it (a stop request).
  sv_status (*poll)(void *self);
  // Besides, while the cameras fill the pool: serves the page. Below 0 ends the capture.
  sv_status (*serve)(void *self);
  void (*kept)(void *self); // an exposure entered the pool
  // Of a continuous run, between training steps.
  sv_heat (*heat)(void *self);                   // of the processor, now
  bool (*is_exposure_due)(void *self);           // the newest exposure has had its turn
  sv_status (*replace)(void *self, sv_err *err); // the oldest exposure, with sv_capture_side_keep
  sv_status (*publish)(void *self);              // a preview image
} sv_capture_calls;

typedef struct {
  sv_capture_queue *queue;
  sv_exposures *exposures;
  const sv_port *port;
  const sv_kernels *k;
  const sv_rig *rig;
  const sv_camera_caps *caps; // [n_cameras]
  int n_cameras, n_exposures; // exposures that fill the pool
  sv_ns skew_limit_ns;
  sv_ns timeout_ns;       // without an exposure
  bool is_continuous;     // cameras go on when the pool is full
  double preview_every_s; // of a continuous run; 0: no images
  sv_odometry *odometry;  // its tracker places exposures as they come, when it is on; or NULL
  sv_guidance_cfg guidance;
  sv_capture_calls calls;
} sv_capture_side_cfg;

typedef struct {
  sv_capture_side_cfg cfg;
  sv_governor governor;     // of a continuous run
  bool is_running;          // cameras run
  bool has_worker;          // and the port's worker serves them
  _Atomic bool is_ending;   // the worker is to return
  sv_ns machine_ns;         // the cameras' virtual clock has followed the machine's up to here
  uint64_t n_device_errors; // of all cameras
  uint64_t n_blurred;       // exposures that were not kept for that
  uint64_t n_not_due;       // came sooner than they are wanted
  sv_guidance guidance;     // of who holds the cameras
  sv_sharpness recent;      // of what was metered
  uint64_t n_bad_exposures; // complete, but a compressed image in it was damaged: not kept

  // Points that odometry has found so far.
  sv_point cloud[SV_CAPTURE_CAP_CLOUD];
} sv_capture_side;

// What cfg points to must outlive the capture side.
void sv_capture_side_init(sv_capture_side *c, const sv_capture_side_cfg *cfg);
void sv_capture_side_log(sv_capture_side *c, sv_log_level level, const char *fmt, ...) SV_PRINTF(3, 4);

// Fills the pool. In a continuous run the cameras go on; otherwise, and when the source has ended,
// they are stopped.
sv_status sv_capture_side_run(sv_capture_side *c, sv_err *err) SV_MUST_USE;
// The next exposure into the pool. AGAIN: none is ready; DROPPED: there was one, but damaged,
// blurred or not due.
sv_status sv_capture_side_keep(sv_capture_side *c, sv_err *err) SV_MUST_USE;
// Between capture and training: locates the exposures of a source without poses, or logs that the
// rig is assumed to be stationary, and why (track.c).
sv_status sv_capture_side_track(sv_capture_side *c, sv_odometry *o, const char *why_untracked,
                                sv_err *err) SV_MUST_USE;

// A continuous run's capture side: on the port's worker thread when there is one, else (virtual
// clocks) in turns between training steps. Between begin and end the queue belongs to it. All do
// nothing when the cameras are stopped.
sv_status sv_capture_side_begin(sv_capture_side *c, sv_err *err) SV_MUST_USE;
// One piece of work that is not training, if one is due; *is_train: none was, train.
sv_status sv_capture_side_turn(sv_capture_side *c, bool *is_train, sv_err *err) SV_MUST_USE;
// A training step took so long.
void sv_capture_side_trained(sv_capture_side *c, double from_s, double now_s);
sv_status sv_capture_side_end(sv_capture_side *c, sv_err *err) SV_MUST_USE;

#endif
