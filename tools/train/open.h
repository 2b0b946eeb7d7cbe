// SPDX-License-Identifier: Apache-2.0
// --open: a model in the browser, as one page that needs no network.
#ifndef SV_TOOLS_TRAIN_OPEN_H
#define SV_TOOLS_TRAIN_OPEN_H

#include "tools/lab/lab.h"

// Writes OUT/model.html from OUT/model.ply and opens it by xdg-open. Says what to open where that
// is not installed, or where the model moves. Fails when the page cannot be written.
sv_status lab_open_model(lab_session *se, const lab_options *o, sv_err *err) SV_MUST_USE;

#endif
