// SPDX-License-Identifier: Apache-2.0
// mrcal's .cameramodel: a Python dict in text, read without Python, heap or recursion. Keys used:
// lensmodel, intrinsics, extrinsics (or rt_cam_ref: Rodrigues vector and translation, camera from
// reference), imagersize. All others are checked for syntax and passed over.
// mrcal's pixel centres are at integers; cx and cy are shifted by 0.5 here, both ways.
#ifndef SV_FORMAT_CAMERAMODEL_H
#define SV_FORMAT_CAMERAMODEL_H

#include "calib/model.h"
#include "src/base/arena.h"
#include "src/base/str.h"
#include "src/base/vec.h"

#ifdef __cplusplus
extern "C" {
#endif

// name: of the file, for errors. E_FORMAT, E_UNSUPPORTED (a lens model that models.inc lacks),
// E_NOT_FOUND (a key is missing), E_RANGE. out parameters are left alone on failure.
sv_status sv_cameramodel_read(const char *name, const char *text, size_t bytes, sv_camera_model *model,
                              sv_pose *cam_from_ref, sv_err *err) SV_MUST_USE;

// The same with room for the control points of
// LENSMODEL_SPLINED_STEREOGRAPHIC_order=.._Nx=.._Ny=.._fov_x_deg=.., which are taken from `splines`
// (NULL: such a model is refused) and stay there. Its key must stand before the intrinsics, as
// mrcal writes it. E_NOMEM, E_SEALED.
sv_status sv_cameramodel_read_splined(const char *name, const char *text, size_t bytes, sv_arena *splines,
                                      sv_camera_model *model, sv_pose *cam_from_ref, sv_err *err) SV_MUST_USE;

// Appends the whole file to out. E_NOMEM when it does not fit (1 KiB does, and 25 bytes
// for each number of a spline).
sv_status sv_cameramodel_write(sv_str *out, const sv_camera_model *model,
                               const sv_pose *cam_from_ref) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
