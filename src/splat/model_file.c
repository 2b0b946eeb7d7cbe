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
                      .has_normals = true};
  sv_status s = sv_ply_write_begin(w, sink, &o, err);
  for (int i = 0; s >= 0 && i < g->n; i++) {
    sv_gaussians_get(g, i, &v);
    s = sv_ply_write_gaussian(w, &v, err);
  }
  return s >= 0 ? sv_ply_write_end(w, err) : s;
}

sv_status sv_model_read_ply(sv_gaussians *g, sv_ply *ply, sv_err *err) {
  sv_gaussian v;
  sv_status s = SV_OK;
  if (ply->kind != SV_PLY_GAUSSIANS)
    return sv_fail(err, SV_E_FORMAT, "%s: a point cloud, expected a Gaussian model", ply->name);
  if (ply->n != (uint32_t)g->n)
    return sv_fail(err, SV_E_RANGE, "%s: %u Gaussians, expected %d", ply->name, ply->n, g->n);
  for (int i = 0; s >= 0 && i < g->n; i++) {
    s = sv_ply_read_gaussian(ply, (uint32_t)i, &v, err);
    if (s >= 0) sv_gaussians_put(g, i, &v);
  }
  return s;
}
