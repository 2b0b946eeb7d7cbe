// SPDX-License-Identifier: Apache-2.0
// C only: the runtime's counters are atomic.
// A small run on the simulator with a screen, and a comparison of what the screen shows with what
// the runtime renders. Owns the feed's memory. Never knows whose screen it is.
#ifndef SV_TESTS_COMMON_DISPLAY_RUN_H
#define SV_TESTS_COMMON_DISPLAY_RUN_H

#include "tests/common/world.h"

// Runs to the end, and until the display has taken a frame of the finished model. NULL: no display.
// False: w->err tells why.
bool display_run(world *w, const sv_display *d);
// Pixels of the frame on the screen that are not those of the finished model's rendering, or of the
// cameras' thumbnails; *n_compared is how many there are. -1: the model could not be rendered.
long display_differences(world *w, const sv_display_frame *shown, long *n_compared);

#endif
