// SPDX-License-Identifier: Apache-2.0
// C only: the feed is.
// Modes of a session's cameras (size and rate), for the page to choose one. Owns the source string
// that a choice makes. Never opens a camera: it reads what the lists of `subview cameras` tell.
#ifndef SV_BOARDS_MODES_H
#define SV_BOARDS_MODES_H

#include "boards/run_options.h"
#include "src/port/feed.h"

// Modes of the source's first camera, each once: its sizes, with the highest rate and half of it.
// None for sources without a list. Before the run's memory is sealed.
void modes_list(const char *source, sv_feed_modes *out);
// The source string with that mode in the place of its size and rate; the string itself for a mode
// below 0. Valid until the next call.
const char *modes_apply(const char *source, const sv_feed_modes *modes, int i_mode);

#endif
