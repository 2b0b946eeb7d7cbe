// SPDX-License-Identifier: Apache-2.0
// Which Gaussians of a model the training views support: those at the surface in enough of them.
// What stands in front of one camera alone, or between the cameras and the scene, is a floater.
#ifndef SV_TOOLS_PICTURES_SUPPORTED_H
#define SV_TOOLS_PICTURES_SUPPORTED_H

#include "tools/lab/lab.h"

// Removes from m, which is o->model as it was read, the Gaussians that lie on the surface in fewer
// than o->min_views (2) training views of o->data. E_RANGE: none is left.
sv_status lab_keep_supported(lab_model *m, const lab_options *o, lab_session *se, sv_err *err) SV_MUST_USE;

#endif
