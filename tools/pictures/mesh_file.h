// SPDX-License-Identifier: Apache-2.0
// A mesh as a file, by the name's end: .ply (binary), .obj (colors behind the positions), .glb
// (glTF 2.0, Y-up). Colors are per vertex.
#ifndef SV_TOOLS_PICTURES_MESH_FILE_H
#define SV_TOOLS_PICTURES_MESH_FILE_H

#include "src/mesh/mesh.h"
#include "src/splat/model_file.h"
#include "tools/common/fileio.h"

bool lab_mesh_is_format(const char *path);
// notes: the up axis of the mesh's world, for .glb, and its unit.
sv_status lab_mesh_write(const sv_mesh *m, const sv_model_notes *notes, const char *path,
                         sv_err *err) SV_MUST_USE;

#endif
