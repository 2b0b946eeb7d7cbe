// SPDX-License-Identifier: Apache-2.0
#include "src/splat/model_file.h"

sv_status sv_model_write_ply(const sv_gaussians *g, const sv_model_notes *notes, sv_sink sink,
                             sv_ply_writer *w, sv_err *err) {
  sv_gaussian v;
  sv_ply_options o = {.n = (uint32_t)g->n,
                      .sh_degree = g->sh_degree,
                      .is_mip = notes->is_mip,
                      .dilation_px2 = notes->dilation_px2,
                      .up = notes->up,
                      .unit = notes->unit,
                      .background = notes->background,
                      .has_normals = true};
  sv_status s = sv_gaussians_check(g, err);
  if (s >= 0) s = sv_ply_write_begin(w, sink, &o, err);
  for (int i = 0; s >= 0 && i < g->n; i++) {
    sv_gaussians_get(g, i, &v);
    s = sv_ply_write_gaussian(w, &v, err);
  }
  return s >= 0 ? sv_ply_write_end(w, err) : s;
}
