// SPDX-License-Identifier: Apache-2.0
// Poses from networks (VGGT, MegaSaM, DUSt3R and MASt3R): what their readers share. The networks
// saw reduced pictures; cameras are those of the pictures as they are. Owns the list of pictures.
#ifndef SV_TOOLS_IMPORT_NETWORK_H
#define SV_TOOLS_IMPORT_NETWORK_H

#include "tools/common/npz.h"
#include "tools/import/import.h"

#ifdef __cplusplus
extern "C" {
#endif

// Pictures in order of their names, PNG and JPEG.
typedef struct {
  char folder[SV_CAP_PATH];
  char prefix[64]; // of names: "STREAM/" when the folder has one folder for each stream; else empty
  sv_names names;
} lab_net_pictures;

// How a network's picture comes from one: u = (u_net - shift) * scale.
typedef struct {
  double scale[2], shift[2];
} lab_net_fit;

typedef struct {
  double k[9]; // intrinsics of the network's picture
  lab_net_fit fit;
  sv_pose cam_from_world;
} lab_net_camera;

// The pictures of --images, else of images/ beside FILE; of --stream, only its. `n` of them are
// expected.
sv_status lab_net_list(lab_net_pictures *p, const lab_options *o, const char *file, size_t n,
                       sv_err *err) SV_MUST_USE;
sv_status lab_net_size(const lab_net_pictures *p, size_t i, lab_peek *out, sv_err *err) SV_MUST_USE;
sv_status lab_net_add(lab_import *im, const lab_net_pictures *p, size_t i, const lab_net_camera *c,
                      sv_err *err) SV_MUST_USE;
// The 4x4 or 3x4 matrix `i` of an array [n][rows][4]. E_FORMAT when it is no rotation.
sv_status lab_net_pose(const char *file, const double m[12], size_t i, sv_pose *out, sv_err *err) SV_MUST_USE;

sv_status lab_import_vggt(lab_import *im, const lab_options *o, sv_err *err) SV_MUST_USE;
sv_status lab_import_megasam(lab_import *im, const lab_options *o, sv_err *err) SV_MUST_USE;
sv_status lab_import_dust3r(lab_import *im, const lab_options *o, sv_err *err) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
