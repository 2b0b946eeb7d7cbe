// SPDX-License-Identifier: Apache-2.0
// A capture folder as a live source of frames: decoded RGB8 (or RGB16) frames at their times, on a
// clock of its own that continues the capture's host time. `max` jumps from frame to frame (tests
// get the same run each time); `realtime` and factors follow the machine's clock. Use
// sv_replay_clock as the runtime's clock. No heap after init, except the few blocks that
// sv_codec_init takes in it.
#ifndef SV_PLATFORM_REPLAY_REPLAY_H
#define SV_PLATFORM_REPLAY_REPLAY_H

#include "platform/codec/codec.h"
#include "platform/replay/capture.h"
#include "src/port/port.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  char dir[SV_CAPTURE_CAP_PATH];
  double speed;                    // 0: max (virtual clock); 1: realtime; else a factor of it
  int from;                        // first frame of each camera, by its place in the list
  int count;                       // frames of each camera from there; 0: all
  char poses[SV_CAPTURE_CAP_PATH]; // file of the rig's poses, instead of the capture's own; empty:
                                   // none
  int n_buffers;                   // frames of a camera that can be on loan at once, 1..64; 0: 8
} sv_replay_cfg;

// "DIR[,speed=max|realtime|X][,from=N][,count=N][,poses=FILE]" (what follows "replay:"). Names must
// not hold a comma. FILE is relative to the working folder: poses.json of `subview-calibrate pose`
// (capture.h). n_buffers is left at 0.
sv_status sv_replay_parse(const char *spec, sv_replay_cfg *cfg, sv_err *err) SV_MUST_USE;

typedef struct {
  uint64_t n_delivered, n_errors; // errors: delivered with is_error, the file being damaged or
                                  // missing
  uint64_t n_starved;             // all buffers were on loan: lost, as a driver would lose it
} sv_replay_stats;

typedef struct {
  int dir_fd;       // the camera's folder
  int i_next;       // next frame in the capture's list
  uint64_t on_loan; // bit per buffer
  uint8_t *buffers; // [n_buffers][frame_bytes]
  sv_replay_stats stats;
} sv_replay_camera;

typedef struct {
  sv_replay_cfg cfg; // with defaults filled in
  sv_capture capture;
  sv_codec codec;
  sv_replay_camera *cameras; // [n_cameras]
  uint8_t *file;             // [cap_file] the compressed picture
  size_t cap_file;
  bool is_running;
  sv_ns first_ns;   // host time at which the replay starts: arrival of the first frame played
  sv_ns virtual_ns; // the clock of `max`
  sv_ns started_ns; // machine time of start, other speeds
  sv_clock machine; // CLOCK_MONOTONIC
  sv_err last_err;  // why the last frame with is_error is damaged
  sv_err first_err; // and the first one, which is an event: FILE
  sv_camera_event first_bad;
  bool has_event; // it waits to be asked for
} sv_replay;

// Loads the capture and takes all buffers. `self` must not move afterwards.
sv_status sv_replay_init(sv_replay *self, const sv_replay_cfg *cfg, sv_arena *arena, sv_err *err) SV_MUST_USE;
// Each start plays from the beginning, and the clock begins there again. rig_pose answers from the
// capture's poses.
sv_source sv_replay_source(sv_replay *self);
// Frames of the camera that has the fewest: there are not more exposures than these.
int sv_replay_most_exposures(const sv_replay *self);
// From the first frame that is played to the last one that all cameras have, by arrival.
sv_ns sv_replay_span_ns(const sv_replay *self);
sv_clock sv_replay_clock(sv_replay *self);
void sv_replay_close(sv_replay *self); // safe after a failed init

#ifdef __cplusplus
}
#endif
#endif
