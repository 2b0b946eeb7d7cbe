// SPDX-License-Identifier: Apache-2.0
// Software synchronization of free-running cameras: one camera leads, the others make some frames a
// little longer or shorter until they expose together with it.
// Owns the measured phase and the pending correction of each camera.
// Never talks to a camera: the caller sends the frame lengths. Never changes a timestamp.
//
// For each camera, the phase is the mean over SV_FRAME_LENGTH_MEASURE frames. Then as many frames
// are made longer (or shorter) as remove the phase, together with the drift that the two
// oscillators will add until the next correction; after that frames have their normal length again.
// Both commands reach the camera with the same delay, so the sum is exact even for cameras that set
// lengths in steps of a line. Bounds: no frame changes by more than SV_FRAME_LENGTH_MAX of the
// period; at most two commands per measurement; a rig within the dead band is left alone.
#ifndef SV_SYNC_FRAME_LENGTH_H
#define SV_SYNC_FRAME_LENGTH_H

#include <stdbool.h>
#include <stdint.h>

#include "src/base/arena.h"
#include "src/base/time.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SV_FRAME_LENGTH_MEASURE 16 // frames whose mean is the phase
// frames after a command that may still have the old length: cameras queue them
#define SV_FRAME_LENGTH_SETTLE 8
#define SV_FRAME_LENGTH_MAX    0.01  // largest change of a frame, of the period: 333 us at 30 fps
#define SV_FRAME_LENGTH_BURST  256   // most frames of one correction
#define SV_FRAME_LENGTH_DRIFT  0.001 // largest difference of two oscillators that is followed

typedef struct {
  int n_cameras;
  sv_ns period_ns;    // nominal, of all cameras
  sv_ns dead_band_ns; // 0: 20 us
} sv_frame_length_cfg;

typedef enum {
  SV_FRAME_LENGTH_MEASURING,
  SV_FRAME_LENGTH_CHANGED,
  SV_FRAME_LENGTH_SETTLING
} sv_frame_length_state;

typedef struct {
  bool has_frame, is_off; // off: the camera refused
  bool has_phase;         // a phase was measured before the newest one
  sv_frame_length_state state;
  sv_ns mid_ns;            // of its newest frame
  int n_frames, n_changed; // in this state; length of the correction
  uint32_t i_frame;        // counts all frames
  double sum_ns;           // of the phases measured
  double rate_ns;          // by how much the phase grows in a frame, left alone
  double phase_ns;         // measured last, what was corrected since taken off
  uint32_t i_phase;        // frame at which that was
  sv_ns set_ns;            // length that it was told last
} sv_frame_length_camera;

typedef struct {
  sv_frame_length_cfg cfg;
  sv_frame_length_camera *cameras; // [n_cameras]
  uint64_t n_commands;
} sv_frame_length;

// E_ARG: no cameras, or a period that is not positive.
sv_status sv_frame_length_init(sv_frame_length *f, const sv_frame_length_cfg *cfg,
                               sv_arena *arena) SV_MUST_USE;

// A frame with its mid-exposure on the host's clock. True: the camera is to be told *duration_ns,
// and what came of it goes to sv_frame_length_set.
bool sv_frame_length_frame(sv_frame_length *f, int i_camera, sv_ns mid_ns, sv_ns *duration_ns);
// The length that the camera took; 0: it refused, and is left alone from now on.
void sv_frame_length_set(sv_frame_length *f, int i_camera, sv_ns set_ns);
// The camera or its clock started anew: what was measured is of no use.
void sv_frame_length_forget(sv_frame_length *f, int i_camera);

#ifdef __cplusplus
}
#endif
#endif
