// SPDX-License-Identifier: Apache-2.0
// Patch matching: when a time is added, its images tell where Gaussians seen at the neighbouring
// time moved (match.c).
#ifndef SV_DYNAMIC_MATCH_H
#define SV_DYNAMIC_MATCH_H

#include "src/dynamic/dynamic.h"

#ifdef __cplusplus
extern "C" {
#endif

// When times are added between the progresses `before` and `progress`, matches their images with
// those of the times next to them, and makes the motion pass there.
sv_status sv_dynamic_match(sv_dynamic *dyn, float before, float progress) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
