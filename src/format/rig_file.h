// SPDX-License-Identifier: Apache-2.0
// A rig on disk: a folder with rig.json and one mrcal .cameramodel for each sub-view.
//   {"version": 1, "name": "bench", "forward": "direct" | "light_field" | "multiplexed",
//    "sub_views": [{"name": "left", "model": "left.cameramodel", "camera": 0,
//                   "footprint": [x, y, w, h]}, ...]}
// "footprint" is the sub-view's rectangle on a shared sensor and optional. With it, "coverage":
// "a.png" may name an 8-bit grey image of its size: the share of 255 of each pixel that the lens
// lights. "mask": "b.png" may name an 8-bit grey image of the sub-view's size, black where its
// image is ignored: housing, own shadow; not for multiplexed rigs. "readout_ms": 20 with "shutter":
// "down" | "up" | "right" | "left" is the time from the first line of the sensor to the last;
// without it the shutter is global. "photometric": {"corner": 0.62, "color": [9 numbers], ...} is
// what its camera makes of the light that the reference camera would show
// (src/format/photometry_json.h). At the top, "trigger" may
// name the cameras' trigger line (src/rig/trigger.h): {"line": "gpio:gpiochip0:17",
// "period_us": 33333, "width_us": 1000, "polarity": "high" | "low",
// "mode": "imx296.trigger_mode:1"}. "scale_sigma": 0.0004 at the top is one standard deviation of
// the rig's lengths, relative.
#ifndef SV_FORMAT_RIG_FILE_H
#define SV_FORMAT_RIG_FILE_H

#include "src/base/str.h"
#include "src/rig/rig.h"

#ifdef __cplusplus
extern "C" {
#endif

// Reads a whole file into buf, like sv_store.read; E_NOT_FOUND, E_NOMEM, E_IO.
typedef struct {
  void *self;
  sv_status (*read)(void *self, const char *name, void *buf, size_t cap, size_t *bytes, sv_err *err);
} sv_file_reader;

// Reads rig.json and its models into a rig that sv_rig_init made. n_cameras: cameras of
// the source, -1 when there is none yet. Scratch holds the files' text and the JSON tokens; it is
// reset to where it was; it must not be the rig's own arena when a lens is splined. The rig's count
// and content are undefined after a failure.
sv_status sv_rig_read(sv_rig *rig, const sv_file_reader *files, int n_cameras, sv_arena *scratch,
                      sv_err *err) SV_MUST_USE;

// Names of coverage images and masks by sub-view; empty where there is none.
typedef struct {
  char name[SV_CAP_SUB_VIEWS][64]; // of coverage
  char mask[SV_CAP_SUB_VIEWS][64];
} sv_coverage_names;

// The same, with the names of coverage images and masks. footprint.coverage and mask stay NULL:
// images are loaded by the caller, who has a decoder (tools/common/coverage.h on hosts). names may
// be NULL; they are checked nevertheless.
sv_status sv_rig_read_coverage(sv_rig *rig, sv_coverage_names *names, const sv_file_reader *files,
                               int n_cameras, sv_arena *scratch, sv_err *err) SV_MUST_USE;

// Appends rig.json to out. Model files are named "<sub-view>.cameramodel"; write those with
// sv_cameramodel_write. E_NOMEM when it does not fit.
sv_status sv_rig_json_write(sv_str *out, const sv_rig *rig) SV_MUST_USE;
// The same with names of coverage images (NULL: none), which the caller writes.
sv_status sv_rig_json_write_coverage(sv_str *out, const sv_rig *rig,
                                     const sv_coverage_names *names) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
