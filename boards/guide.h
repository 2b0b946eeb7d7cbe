// SPDX-License-Identifier: Apache-2.0
// C only: the board's source is.
// Guidance of a recording, which keeps no images: meters each exposure's frames and prints where to
// go next. Owns a decoder for compressed frames and the state of the guidance.
// Never holds the cameras up: exposures that come quickly are not all metered.
#ifndef SV_BOARDS_GUIDE_H
#define SV_BOARDS_GUIDE_H

#include "boards/board_main.h"
#include "src/capture/guidance.h"
#include "src/sync/capture_queue.h"

// What a source tells: its ball, its arc and which way is up. arc_deg 0: the source's, else all
// around.
sv_guidance_cfg guide_cfg(const board_source *s, double arc_deg);

typedef struct {
  const board_source *src;
  sv_guidance guidance;
  sv_sharpness recent;
  sv_convert convert; // of compressed frames
  sv_ns next_ns;      // when an exposure is metered again
} capture_guide;

sv_status guide_init(capture_guide *g, const board_source *src, double arc_deg, sv_arena *arena,
                     sv_err *err) SV_MUST_USE;
// An exposure whose frames are still on loan; it is saved next.
void guide_exposure(capture_guide *g, const sv_exposure_slot *slot, const sv_kernels *k);

#endif
