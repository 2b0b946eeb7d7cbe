// SPDX-License-Identifier: Apache-2.0
// A model and its viewer as one HTML file that needs no server and no network: the page's own
// viewer (platform/preview/page), and the model in its compact form.
#ifndef SV_TOOLS_LAB_EXPORT_HTML_H
#define SV_TOOLS_LAB_EXPORT_HTML_H

#include "tools/lab/lab.h"

// st: the scene's centre and radius. Still models only (E_UNSUPPORTED).
sv_status lab_write_html(const lab_model *m, const lab_settings *st, const char *path,
                         sv_err *err) SV_MUST_USE;

#endif
