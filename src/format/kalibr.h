// SPDX-License-Identifier: Apache-2.0
// Kalibr's camchain.yaml to a rig.
// Reads the part of YAML that Kalibr writes: cameras cam0, cam1, ... at the left margin (in any
// order, as cam10 sorts before cam2), their keys indented below, values as words, [lists], lists of
// lists over several lines, or "- " lists. Keys used: camera_model, intrinsics [fu, fv, pu, pv],
// distortion_model, distortion_coeffs, resolution [w, h], T_cn_cnm1 (4 x 4: point of camera n-1 ->
// point of camera n). Other keys are skipped: cam_overlaps, rostopic, T_cam_imu, timeshift_cam_imu,
// ... (Kalibr's wiki, "yaml formats" and "supported models".)
//   pinhole + radtan [k1, k2, r1, r2]       -> OPENCV4 (OpenCV's k1, k2, p1, p2)
//   pinhole + equidistant [k1, k2, k3, k4]  -> KB4
//   pinhole + none                          -> PINHOLE
// Kalibr uses OpenCV's pixel centres at integers; the principal point is shifted by 0.5 here.
#ifndef SV_FORMAT_KALIBR_H
#define SV_FORMAT_KALIBR_H

#include "src/rig/rig.h"

#ifdef __cplusplus
extern "C" {
#endif

// text[bytes] -> a rig that sv_rig_init made: one sub-view "camN" on camera N for each camera, in
// the order of their numbers, forward model direct. The rig's frame is cam0's. name: of the file,
// for errors. E_FORMAT, E_RANGE, E_UNSUPPORTED (omni, ds, eucm and fov lenses), E_NOT_FOUND (a key
// or a camera of the chain is missing), E_FULL. The rig's content is undefined after a failure.
sv_status sv_kalibr_read(sv_rig *rig, const char *name, const char *text, size_t bytes,
                         sv_err *err) SV_MUST_USE;

#ifdef __cplusplus
}
#endif
#endif
