// SPDX-License-Identifier: Apache-2.0
// A model as a 3DGS PLY file, in and out.
#ifndef SV_SPLAT_MODEL_FILE_H
#define SV_SPLAT_MODEL_FILE_H

#include <stdbool.h>

#include "src/format/ply.h"
#include "src/splat/gaussians.h"

#ifdef __cplusplus
extern "C" {
#endif

// What a file says beside the Gaussians: trained with anti-aliasing (Brush's "SplatRenderMode:
// mip"), and with this low-pass (0: not said); up in the world (src/format/axes.h; NULL: not said);
// the world's unit; what is behind the Gaussians, 0xRRGGBB.
typedef struct {
  bool is_mip;
  float dilation_px2;
  const char *up;
  sv_unit unit;
  uint32_t background;
} sv_model_notes;
// w: workspace of the call.
sv_status sv_model_write_ply(const sv_gaussians *g, const sv_model_notes *notes, sv_sink sink,
                             sv_ply_writer *w, sv_err *err) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
