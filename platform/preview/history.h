// SPDX-License-Identifier: Apache-2.0
// C only: the feed is.
// The last seconds of a live run for the page: a snapshot of its history, by ranges and as a
// download, and models of its instants. Makes answers, and leaves sending them to server.c. Never
// decides who may ask.
#ifndef SV_PLATFORM_PREVIEW_HISTORY_H
#define SV_PLATFORM_PREVIEW_HISTORY_H

#include "platform/preview/access.h"
#include "platform/preview/preview.h"

struct MHD_Connection;

// GET /history: asks the runtime for a new snapshot; the state's history.seq then moves on.
// GET /history.svseq?n=SEQ: that snapshot; GET /history.ply?n=SEQ&at=T: its frame at T of 0 to 1.
// 404 for another snapshot than the newest. range: as in scan_routes.h.
pv_answer pv_history_get(pv_source *s, struct MHD_Connection *c, const char *url, const char *range);

#endif
