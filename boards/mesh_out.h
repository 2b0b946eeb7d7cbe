// SPDX-License-Identifier: Apache-2.0
// C only: the runtime's counters are atomic.
// run --mesh: a triangle mesh of the trained model, saved as mesh.ply beside it. Owns its share of
// the run's memory block, taken before the block is sealed.
// Never changes the model.
#ifndef SV_BOARDS_MESH_OUT_H
#define SV_BOARDS_MESH_OUT_H

#include "src/run/app.h"

typedef struct {
  uint8_t *field; // [field_bytes] of the mesh
  size_t field_bytes;
  float *depth; // [pixels of the largest view]
  int n_vertices, n_triangles;
  double voxel;
} mesh_out;

// Also on a dry arena, which then holds the bytes.
sv_status mesh_out_carve(mesh_out *m, const sv_app_cfg *cfg, sv_arena *arena, sv_err *err) SV_MUST_USE;
// After training. E_RANGE: no surface was seen by enough views.
sv_status mesh_out_save(mesh_out *m, sv_app *app, sv_err *err) SV_MUST_USE;

#endif
