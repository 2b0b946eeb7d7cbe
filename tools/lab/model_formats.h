// SPDX-License-Identifier: Apache-2.0
// Models in the formats of viewers: .splat, SPZ, GLB (src/format has the layouts; here is the
// memory and the compressing).
#ifndef SV_TOOLS_LAB_MODEL_FORMATS_H
#define SV_TOOLS_LAB_MODEL_FORMATS_H

#include "tools/lab/lab.h"
#include <stdbool.h>

#include "src/splat/gaussians.h"

#ifdef __cplusplus
extern "C" {
#endif

sv_status lab_write_splat(const sv_gaussians *g, const char *path, sv_err *err) SV_MUST_USE;
// Both formats say which way is up: the model is turned there from notes->up (src/format/axes.h;
// NULL: the default). version 2, 3 (gzip) or 4 (zstd; E_UNSUPPORTED in a build without libzstd).
sv_status lab_write_spz(const sv_gaussians *g, const sv_model_notes *notes, int version, const char *path,
                        sv_err *err) SV_MUST_USE;
sv_status lab_write_glb(const sv_gaussians *g, const sv_model_notes *notes, const char *path,
                        sv_err *err) SV_MUST_USE;
// PlayCanvas's compressed PLY (export_compressed.c). The model's up must be SV_UP_DEFAULT.
sv_status lab_write_compressed_ply(const sv_gaussians *g, const sv_model_notes *notes, const char *path,
                                   sv_err *err) SV_MUST_USE;

// Is this one of these formats (by its first bytes; .splat by name)?
bool lab_is_viewer_format(const char *path, const void *data, size_t bytes);
// SPZ and GLB, by name, hold a world that was turned upright.
bool lab_is_upright(const char *path);
// Turns such a model back to where up is `up`, or, if that is NULL, to the world of the views, and
// says so.
void lab_turn_back(lab_model *m, lab_session *s, const char *path, const char *up, const lab_views *views);
// Reads it into Gaussians inside a block of malloc (*block, the caller's to free).
// notes: is_mip and unit, as far as the format has them.
sv_status lab_read_viewer_format(sv_gaussians *g, sv_model_notes *notes, void **block,
                                 const sv_file_data *file, sv_err *err) SV_MUST_USE;

// A moving model as numbered still ones in a folder: frame_0000.EXTENSION and on
// (export_frames.c). `write` writes the model as it is at a time.
typedef struct {
  const lab_options *o;
  int n; // at least 2, evenly from time 0 to 1
  const char *folder, *extension;
  sv_status (*write)(const lab_options *o, lab_model *m, lab_session *se, const char *path, sv_err *err);
} lab_frames;
sv_status lab_write_frames(lab_model *m, lab_session *se, const lab_frames *f, sv_err *err) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
// A moving model: base and differences at n_frames times, evenly from 0 to 1 (export_delta.c).
sv_status lab_write_delta(lab_model *m, const lab_session *se, int n_frames, const char *path,
                          sv_err *err) SV_MUST_USE;

#endif
