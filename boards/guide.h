// SPDX-License-Identifier: Apache-2.0
// C only: the board's source is.
// Guidance of a recording, which keeps no images: meters each exposure's frames, finds where the
// rig is when the source does not tell, and prints where to go next. Owns a decoder for compressed
// frames, one exposure of pictures and the state of odometry and guidance.
// Never holds the cameras up: exposures that come quickly are not all looked at.
#ifndef SV_BOARDS_GUIDE_H
#define SV_BOARDS_GUIDE_H

#include "boards/board_main.h"
#include "src/capture/guidance.h"
#include "src/capture/odometry.h"
#include "src/sync/capture_queue.h"

// What a source tells: its ball, its arc and which way is up. arc_deg 0: the source's, else all
// around.
sv_guidance_cfg guide_cfg(const board_source *s, double arc_deg);

#define GUIDE_CAP_CLOUD 512

typedef struct {
  const board_source *src;
  sv_guidance guidance;
  sv_sharpness recent;
  sv_convert convert; // of compressed frames
  sv_ns next_ns;      // when an exposure is looked at again
  // Where the source tells no poses and the rig can be tracked: odometry, on smaller pictures.
  sv_odometry odometry;
  sv_rig rig;        // of those
  sv_exposures pool; // of one exposure
  sv_point cloud[GUIDE_CAP_CLOUD];
} capture_guide;

sv_status guide_init(capture_guide *g, const board_source *src, double arc_deg, const sv_kernels *k,
                     sv_arena *arena, sv_err *err) SV_MUST_USE;
// An exposure whose frames are still on loan; it is saved next.
void guide_exposure(capture_guide *g, const sv_exposure_slot *slot, const sv_kernels *k);

#endif
