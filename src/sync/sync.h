// SPDX-License-Identifier: Apache-2.0
// Synchronization: puts the timestamps of all cameras on the host's clock, finds one frame of every
// camera for each instant, and accounts for every frame that is not used.
// Owns the descriptors of frames that wait for their partners, the clock models and the ledger.
// Never copies an image: frames stay on loan from their source, and each one pushed comes back
// once, in an exposure or through sv_sync_pop_return, so that the caller can requeue it.
//
//   while (source has a frame f) {
//     sv_sync_push(&sync, &f);
//     while (sv_sync_pop_exposure(&sync, &exposure, frames) == SV_OK) use, then requeue each frame
//     while (sv_sync_pop_return(&sync, &f) == SV_OK) requeue f
//   }
//   sv_sync_flush(&sync);  and pop_return once more
//
// A source needs about queue_len + 2 buffers a camera: what waits here is not free there.
#ifndef SV_SYNC_SYNC_H
#define SV_SYNC_SYNC_H

#include "src/base/arena.h"
#include "src/port/port.h"
#include "src/rig/rig.h"
#include "src/sync/timestamp_filter.h"
#include "src/sync/clock_model.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum {
#define X(NAME, name) SV_DROP_##NAME,
#include "src/sync/sv_drop.inc"
#undef X
  SV_N_DROPS
} sv_drop_reason;

typedef enum {
#define X(NAME, name) SV_SYNC_EVENT_##NAME,
#include "src/sync/sv_sync_event.inc"
#undef X
  SV_N_SYNC_EVENTS
} sv_sync_event_kind;

const char *sv_drop_name(sv_drop_reason r); // "no_partner"
const char *sv_sync_event_name(sv_sync_event_kind k);

// captured = delivered + pending + the sum of dropped, after every call, per camera. Frames that
// the driver lost are captured (the sensor took them) and dropped for sequence_gap.
typedef struct {
  uint64_t captured, delivered, pending;
  uint64_t dropped[SV_N_DROPS];
} sv_ledger;

bool sv_ledger_is_exact(const sv_ledger *l);
uint64_t sv_ledger_dropped(const sv_ledger *l); // sum over the reasons

typedef struct {
  sv_sync_event_kind kind;
  int i_camera;
  sv_ns host_ns;  // arrival of the frame that told
  int64_t detail; // see sv_sync_event.inc
} sv_sync_event;

// AUTO: stamps of CLOCK_MONOTONIC are host time, all other clocks are estimated.
typedef enum { SV_SYNC_CLOCK_AUTO = 0, SV_SYNC_CLOCK_COMMON, SV_SYNC_CLOCK_ESTIMATE } sv_sync_clock_mode;

typedef struct {
  sv_clock_id clock;     // caps.clock
  sv_stamp_source stamp; // caps.stamp
  sv_ns transport_ns;    // shortest delay from stamp to arrival if known, else 0
  // caps.stamp_noise_ns: by how much stamps scatter (standard deviation); 0: not at all
  sv_ns stamp_noise_ns;
} sv_sync_camera;

// What a camera's caps say of its stamps.
sv_sync_camera sv_sync_camera_of(const sv_camera_caps *caps);

typedef struct {
  int n_cameras;                 // 1..SV_CAP_SUB_VIEWS
  const sv_sync_camera *cameras; // [n_cameras], read by init only
  sv_sync_clock_mode clock_mode;
  // Mid-exposure times of one exposure differ by at most this; best under half a frame time
  sv_ns skew_limit_ns;
  int queue_len;   // frames of one camera that may wait, 2..64
  int min_cameras; // 0 or n_cameras: whole exposures only; less: cameras may be missing
  // A frame waits so long (host time) for a silent camera; 0: 500 ms. A full queue ends the wait
  // earlier. What that camera still brings is late when it belongs to what was given up; it is not
  // where it belongs to a later frame, at any skew limit
  sv_ns max_wait_ns;
  sv_ns step_limit_ns; // 0: 1 s. See clock_model.h
  double max_drift;    // 0: 1e-3
} sv_sync_cfg;

// Skews of the exposures delivered, in bins 1/8 octave wide: the percentiles are upper bin edges,
// at most 12.5 % too large and never over the maximum.
#define SV_SKEW_BINS 512
typedef struct {
  uint64_t n, bins[SV_SKEW_BINS];
  sv_ns max_ns;
} sv_skew_stats;

void sv_skew_add(sv_skew_stats *s, sv_ns skew_ns); // not negative
// One that was added counts no more. If it was the largest, the maximum becomes the edge of the bin
// of the next.
void sv_skew_remove(sv_skew_stats *s, sv_ns skew_ns);
sv_ns sv_skew_edge_ns(int i_bin);                                    // the largest skew of a bin
sv_ns sv_skew_percentile_ns(const sv_skew_stats *s, double percent); // 0 when there are none

#define SV_SYNC_CAP_EVENTS 64

typedef struct {
  sv_frame frame;
  sv_ns steady_ns;   // its stamp, freed of noise (timestamp_filter.h)
  sv_ns mid_host_ns; // middle of its exposure on the host's clock
} sv_sync_entry;

typedef struct {
  sv_clock_model clock;
  sv_timestamp_filter filter;
  uint32_t filter_sequence; // of its newest frame
  sv_stamp_source stamp;
  sv_sync_entry *queue; // [queue_len], a ring
  int i_head, n_queued;
  bool has_last, has_host;
  uint32_t last_sequence;
  uint64_t seen; // bit k: last_sequence - k came in
  sv_ns last_camera_ns, last_arrival_ns;
  double interval_ns; // of its stamps, a frame; running mean
  int n_odd;          // frames in a row whose spacing is another one
  // That came late by more than a step, with stamps that go on, and are not catching up
  int n_late;
  sv_ns last_mid_host_ns; // of the newest frame with a good stamp
  bool is_closed;
  sv_ns closed_ns; // exposures up to here went without this camera
  sv_ledger ledger;
  uint64_t events[SV_N_SYNC_EVENTS];
} sv_sync_stream;

typedef struct {
  sv_sync_cfg cfg;         // with defaults filled in; cameras is NULL
  sv_sync_stream *streams; // [n_cameras]
  sv_frame *returns;       // [cap_returns], a ring
  int cap_returns, i_return, n_returns;
  sv_sync_event events[SV_SYNC_CAP_EVENTS];
  int i_event, n_events;
  uint64_t n_events_lost; // the oldest are overwritten; the counters of the streams are complete
  sv_ns now_ns;           // newest arrival
  uint32_t n_exposures;
  sv_skew_stats skew;
} sv_sync;

size_t sv_sync_bytes(const sv_sync_cfg *cfg); // 0 when cfg is out of range
sv_status sv_sync_init(sv_sync *s, const sv_sync_cfg *cfg, sv_arena *arena) SV_MUST_USE;

// Takes a frame over. OK: it waits for its partners. DROPPED: it is in the return queue, counted
// with its reason. Not taken over, nothing counted: E_ARG (no such camera), E_FULL (drain
// pop_return first).
sv_status sv_sync_push(sv_sync *s, const sv_frame *frame) SV_MUST_USE;

// The next exposure, in order of time. frames: [n_cameras]; a camera that is missing has i_camera
// -1 and no data. The frames belong to the caller, who requeues them. rig_from_world is set to
// identity. AGAIN: none is ready; E_FULL: drain pop_return first.
sv_status sv_sync_pop_exposure(sv_sync *s, sv_exposure *exposure, sv_frame *frames) SV_MUST_USE;

// An exposure just popped is left out as a whole after all: its frames (still the caller's to
// requeue) count as dropped for this reason, not as delivered.
void sv_sync_refuse(sv_sync *s, const sv_exposure *exposure, sv_drop_reason reason);

// Camera i_camera was told to make each frame longer by so much (shorter: negative) from now on.
void sv_sync_lengthened(sv_sync *s, int i_camera, sv_ns delta_ns);

// The next frame to requeue. AGAIN: none.
sv_status sv_sync_pop_return(sv_sync *s, sv_frame *frame) SV_MUST_USE;

// Ends a capture: whatever waits is dropped for `stopped` and goes to the return queue. E_FULL:
// drain pop_return and call again.
sv_status sv_sync_flush(sv_sync *s) SV_MUST_USE;

sv_status sv_sync_pop_event(sv_sync *s, sv_sync_event *event) SV_MUST_USE; // AGAIN: none
const sv_ledger *sv_sync_ledger(const sv_sync *s, int i_camera);           // NULL: no such camera
sv_ledger sv_sync_ledger_sum(const sv_sync *s);

#ifdef __cplusplus
}
#endif
#endif
