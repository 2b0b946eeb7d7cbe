// SPDX-License-Identifier: Apache-2.0
// Photometric calibrations (src/rig/photometry.h) in JSON, as in rig.json and run.json:
//   "photometric": {"corner": R, "color": [9], "falloff": [k1, k2, k3], "color_sigma": [3],
//                   "mix_sigma": S, "falloff_sigma": S}
// Owns nothing. Never reads a file.
#ifndef SV_FORMAT_PHOTOMETRY_JSON_H
#define SV_FORMAT_PHOTOMETRY_JSON_H

#include "src/base/str.h"
#include "src/format/json.h"
#include "src/rig/photometry.h"

#ifdef __cplusplus
extern "C" {
#endif

// The member "photometric" of an object; p stays as it is without one. E_FORMAT and E_RANGE with a
// sentence.
sv_status sv_photometry_json_read(const sv_json *j, int i_object, sv_photometry *p, sv_err *err) SV_MUST_USE;
// The member without a comma before it; nothing for a calibration that is not known.
void sv_photometry_json_write(sv_str *out, const sv_photometry *p);

#ifdef __cplusplus
}
#endif
#endif
