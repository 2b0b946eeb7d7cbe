// SPDX-License-Identifier: Apache-2.0
// C only: the rings are atomic.
// The capture queue: takes frames from a source the moment they come, puts exposures together, and
// hands them to one user, who may be busy and on another thread. Exposures that nobody has time for
// are dropped as a whole. Owns the table of exposure slots, and with it the frames that are on loan
// from the source. Never copies, decodes or converts an image.
//
//   capture side (its own thread, or the user's between two pieces of work):
//     sv_capture_queue_step(&q, until), repeatedly
//   user's side:
//     while (sv_capture_queue_take(&q, &slot) == SV_OK) sv_capture_queue_give_back(&q, slot, true);
//
// One thread a side. Everything else (start, stop, reading sync) only while the other side rests.
// At most cap_ready exposures are ready or with the user; a source needs cap_ready + queue_len + 2
// buffers a camera to lose nothing meanwhile.
#ifndef SV_SYNC_CAPTURE_QUEUE_H
#define SV_SYNC_CAPTURE_QUEUE_H

#include <stdatomic.h>

#include "src/base/ring.h"
#include "src/sync/camera_stats.h"
#include "src/sync/frame_length.h"
#include "src/sync/sync.h"

// Synchronization method, that is who makes the cameras expose at the same time: nobody; software,
// by the length of their frames (cameras that cannot are left alone); a trigger line.
typedef enum { SV_SYNC_METHOD_FREE = 0, SV_SYNC_METHOD_FRAME_LENGTH, SV_SYNC_METHOD_TRIGGER } sv_sync_method;

#define SV_CAPTURE_QUEUE_LINE_BYTES 512

typedef struct {
  int n_cameras;
  const sv_camera_caps *caps; // [n_cameras], read by init only
  sv_ns skew_limit_ns;
  int queue_len, cap_ready;
  sv_sync_method method;
  // Is shown every frame that comes, on the capture side's thread, before the frame goes on its
  // way; must be quick. May be NULL.
  void (*on_frame)(void *self, const sv_frame *frame);
  void *on_frame_self;
} sv_capture_queue_cfg;

// One exposure on its way to the user and back. The table of slots owns the frames that are on loan
// from the source until the user has given the slot back; the rings carry indexes of slots.
typedef struct {
  sv_exposure exposure;
  sv_frame *frames;      // [n_cameras]; of a camera that is missing i_camera is -1
  bool is_used;          // set by sv_capture_queue_give_back
  sv_drop_reason reason; // when it was not
} sv_exposure_slot;

typedef struct {
  sv_capture_queue_cfg cfg;
  sv_source source;
  sv_clock clock;
  sv_sync sync;
  sv_frame_length frame_length;
  sv_camera_stat *stats; // [n_cameras]
  sv_camera_caps *caps;  // [n_cameras] a copy, for names
  // [SV_CAPTURE_QUEUE_LINE_BYTES] of statistics, the capture side's until it is ready
  char *line;
  _Atomic int line_state;
  sv_ring events;          // sv_camera_event, to the user
  sv_exposure_slot *slots; // [n_slots]
  int *free;               // [n_free] slots that are the capture side's
  int n_slots, n_free;
  sv_ring ready, done;   // indexes of slots: to the user; from the user
  sv_skew_stats latency; // from a frame's arrival to its dequeue
  // The shortest frame period: when the next frame is there, this one has to be taken. 0: not
  // known.
  sv_ns deadline_ns;
  uint64_t n_missed; // frames that were taken later
  bool is_running;
  _Atomic uint64_t n_device_errors; // of dequeue and requeue
  _Atomic int i_broken;             // camera of the newest one
  _Atomic sv_status broken_status;
} sv_capture_queue;

size_t sv_capture_queue_bytes(const sv_capture_queue_cfg *cfg);
// E_ARG: the cfg is out of range (see sync.h); E_NOMEM.
sv_status sv_capture_queue_init(sv_capture_queue *in, const sv_capture_queue_cfg *cfg,
                                const sv_source *source, const sv_clock *clock, sv_arena *arena) SV_MUST_USE;

// Can the source do what the mode asks for? E_UNSUPPORTED: it has no trigger line, or takes no
// frame lengths.
sv_status sv_capture_queue_check(const sv_capture_queue *in, sv_err *err) SV_MUST_USE;
// Starts the cameras, when the mode suits them.
sv_status sv_capture_queue_start(sv_capture_queue *in, sv_err *err) SV_MUST_USE;
// Waits until until_host_ns at most for a frame, then takes all that are there. OK, AGAIN (none
// came), END; E_DEVICE of one camera (counted; the others go on; the host's clock is moved on by 1
// ms, so that a source that only fails does not stop time). Poses of the rig are filled in here.
sv_status sv_capture_queue_step(sv_capture_queue *in, sv_ns until_host_ns) SV_MUST_USE;
// Gives everything back and stops the cameras: the ledger closes. Exposures that were ready and not
// taken count as dropped for `stopped`. The user gives back its slots before.
sv_status sv_capture_queue_stop(sv_capture_queue *in) SV_MUST_USE;

// The next exposure; the slot is the user's until it is given back. AGAIN: none is ready.
sv_status sv_capture_queue_take(sv_capture_queue *in, sv_exposure_slot **slot) SV_MUST_USE;
// The frames go back to their cameras. Not used: they count as dropped for `overload`.
void sv_capture_queue_give_back(sv_capture_queue *in, sv_exposure_slot *slot, bool is_used);
// The same of an exposure that is not used, for another reason.
void sv_capture_queue_refuse(sv_capture_queue *in, sv_exposure_slot *slot, sv_drop_reason reason);
int sv_capture_queue_n_ready(sv_capture_queue *in);
// " | video0 25.0 fps +0.412 ms dropped 3 (no_partner 2, ...) | ..." is added to out: what a user
// watches. The first call asks for it, the capture side makes it at its next step, and a later call
// brings it. AGAIN: not yet.
sv_status sv_capture_queue_line(sv_capture_queue *in, sv_str *out) SV_MUST_USE;
// The next event of a camera, for the user's side. AGAIN: none. When nobody asks, the newest are
// dropped.
sv_status sv_capture_queue_pop_event(sv_capture_queue *in, sv_camera_event *event) SV_MUST_USE;

#endif
