// SPDX-License-Identifier: Apache-2.0
// Coverage images of footprints and masks of sub-views, 8-bit gray, beside rig.json (host; heap).
#ifndef SV_TOOLS_COMMON_COVERAGE_H
#define SV_TOOLS_COMMON_COVERAGE_H

#include "src/format/rig_file.h"

#ifdef __cplusplus
extern "C" {
#endif

// Loads the images that are named into malloc'ed blocks at footprint.coverage and mask; others
// become NULL (all of each pixel, all pixels). Nothing is loaded after a failure: E_NOT_FOUND,
// E_FORMAT (another size than the footprint's or the sub-view's).
sv_status sv_coverage_load(const char *folder, sv_rig *rig, const sv_coverage_names *names,
                           sv_err *err) SV_MUST_USE;
void sv_coverage_free(sv_rig *rig); // what sv_coverage_load loaded

// Writes one footprint's coverage (not NULL) as a PNG.
sv_status sv_coverage_save(const char *folder, const char *name, const sv_footprint *f,
                           sv_err *err) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
