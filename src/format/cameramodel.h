// SPDX-License-Identifier: Apache-2.0
// mrcal's .cameramodel: a Python dict in text, read without Python, heap or recursion.
// Keys used: lensmodel, intrinsics, extrinsics (or rt_cam_ref: Rodrigues vector and translation,
// camera from reference), imagersize. Other keys are checked for syntax and skipped. mrcal's pixel
// centres are at integers; cx and cy are shifted by 0.5 here, both ways.
#ifndef SV_FORMAT_CAMERAMODEL_H
#define SV_FORMAT_CAMERAMODEL_H

#include "calib/model.h"
#include "src/base/arena.h"
#include "src/base/file_data.h"
#include "src/base/str.h"
#include "src/base/vec.h"

#ifdef __cplusplus
extern "C" {
#endif

// E_FORMAT, E_UNSUPPORTED (a lens model not in models.inc),
// E_NOT_FOUND (a key is missing), E_RANGE. Outputs do not change on failure.
sv_status sv_cameramodel_read(const sv_file_data *file, sv_camera_model *model, sv_pose *cam_from_ref,
                              sv_err *err) SV_MUST_USE;

// The same, with memory for the control points of
// LENSMODEL_SPLINED_STEREOGRAPHIC_order=.._Nx=.._Ny=.._fov_x_deg=.., which stay in `splines` (NULL:
// such a model is refused). Its key must precede the intrinsics, as mrcal writes it. E_NOMEM,
// E_SEALED.
sv_status sv_cameramodel_read_splined(const sv_file_data *file, sv_arena *splines, sv_camera_model *model,
                                      sv_pose *cam_from_ref, sv_err *err) SV_MUST_USE;

// Appends the whole file to out. E_NOMEM when it does not fit (1 KiB does, and 25 bytes
// for each number of a spline).
sv_status sv_cameramodel_write(sv_str *out, const sv_camera_model *model,
                               const sv_pose *cam_from_ref) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
