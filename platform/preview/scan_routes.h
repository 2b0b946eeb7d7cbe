// SPDX-License-Identifier: Apache-2.0
// C only: the feed is.
// Routes of the earlier scans: their list, their files and models in other formats, delete and
// restore. Makes answers, and leaves sending them to server.c. Never decides who may ask.
#ifndef SV_PLATFORM_PREVIEW_SCAN_ROUTES_H
#define SV_PLATFORM_PREVIEW_SCAN_ROUTES_H

#include "platform/preview/access.h"
#include "platform/preview/preview.h"

// GET /scans: the list as JSON. GET /scan/NUMBER/NAME: a file of pv_scan_file_name, or model.splat,
// model.spz and model (compact, for the view), made from model.ply. range: the request's header
// Range, of one range; NULL, or of any other form: all of the file. Only files have ranges.
pv_answer pv_scan_get(pv_source *s, const char *url, const char *range);
// POST /scan/NUMBER/delete /restore /purge. The newest scan stays while the run may write to it.
pv_answer pv_scan_post(pv_source *s, const char *url);

#endif
