// SPDX-License-Identifier: Apache-2.0
// Statistics of each camera for a progress line: frame rate, offset within the last exposure,
// frames dropped and why.
// Owns one record per camera; the counts of drops are the ledger's (sync.h).
// Never influences which frames are used.
#ifndef SV_SYNC_CAMERA_STATS_H
#define SV_SYNC_CAMERA_STATS_H

#include "src/base/str.h"
#include "src/sync/sync.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  uint64_t n_frames;
  sv_ns last_ns;        // arrival
  sv_ns last_stamp_ns;  // on the camera's clock
  double interval_ns;   // running mean over about 16 frames
  double offset_ns;     // middle of its exposure against the mean of the cameras, last exposure
  double offset_max_ns; // largest magnitude so far
} sv_camera_stat;

// A frame of its camera has come from the source; stat is cleared by the caller before the first
// one.
void sv_camera_stat_frame(sv_camera_stat *stat, const sv_frame *frame);
// An exposure has come from sync; stats, frames: [n_cameras].
void sv_camera_stats_exposure(sv_camera_stat *stats, const sv_sync *sync, const sv_exposure *exposure,
                              const sv_frame *frames);
// Frames a second, 0 before the second frame.
double sv_camera_stat_fps(const sv_camera_stat *stat);
// "video0 25.0 fps +0.412 ms dropped 3 (no_partner 2, sequence_gap 1)".
void sv_camera_stats_line(sv_str *out, const sv_camera_stat *stat, const sv_ledger *ledger, const char *name);
// The whole as one line, for as many cameras as fit: " | " in between.
void sv_camera_stats_live(sv_str *out, const sv_camera_stat *stats, const sv_sync *sync,
                          const sv_camera_caps *caps);
// "video0: stalled: no frame came for too long (after 1000 ms)", or the event's own text.
void sv_camera_event_line(sv_str *out, const sv_camera_event *event, const sv_camera_caps *caps,
                          int n_cameras);

#ifdef __cplusplus
}
#endif
#endif
